"""How deep the voxels of labels lie."""

from __future__ import annotations

from typing import Any

import edt
import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.common.validation import Spacing
from napari_unpack.thread_count import thread_count

# More win little on labels of a bag, and other work waits for a processor too.
MOST_THREADS = 2


def label_depths(
    labels: NDArray[np.integer[Any]],
    spacing: Spacing = (1.0, 1.0, 1.0),
    black_border: bool = True,
) -> NDArray[np.float32]:
    """Return the distance of each voxel to the nearest of another label, mm.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int
        0 is background.
    spacing : (float, float, float) of mm, z y x
    black_border : bool
        Beyond the volume there is background too.

    Returns
    -------
    (Z, Y, X) ndarray of float32
        0 in the background.
    """
    # All of Python waits for it: no longer than need be.
    threads = min(MOST_THREADS, thread_count())
    depths: NDArray[np.float32] = edt.edt(
        labels, anisotropy=spacing, black_border=black_border, parallel=threads
    )
    return depths
