"""Two balls joined by a bar, a slab and a cube: what repairs and brushes are tried on."""

import numpy as np

BELL, CUBE, SLAB = 1, 2, 3


def bells() -> tuple[np.ndarray, np.ndarray]:
    """Two balls joined by a bar (1) before a slab (3), and a cube (2) beside them."""
    z, y, x = np.indices((40, 40, 72))
    labels = np.zeros(z.shape, np.uint16)
    for middle in (16, 44):
        labels[(z - 12) ** 2 + (y - 20) ** 2 + (x - middle) ** 2 < 100] = BELL
    labels[10:15, 18:23, 16:44] = BELL
    labels[4:16, 14:26, 58:70] = CUBE
    labels[26:34, 6:36, 6:60] = SLAB
    volume = np.where(labels > 0, 800 + 200 * labels, 0).astype(np.uint16)
    return volume, labels
