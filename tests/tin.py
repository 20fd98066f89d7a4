"""A closed tin with things in it, for tests of what is looked at alone."""

from __future__ import annotations

import numpy as np


def tin() -> tuple[np.ndarray, np.ndarray]:
    """Make a tin (1) with two things of other densities in it, one label; a block (2) beside.

    Returns
    -------
    (20, 30, 40) ndarray of float32
        Densities.
    (20, 30, 40) ndarray of uint16
        Labels.
    """
    volume, labels = np.zeros((20, 30, 40), np.float32), np.zeros((20, 30, 40), np.uint16)
    labels[4:16, 5:25, 5:25], volume[4:16, 5:25, 5:25] = 1, 1000
    volume[7:13, 8:14, 8:14], volume[7:13, 16:22, 16:22] = 3000, 3100
    labels[4:16, 5:25, 25:35], volume[4:16, 5:25, 25:35] = 2, 1500
    return volume, labels
