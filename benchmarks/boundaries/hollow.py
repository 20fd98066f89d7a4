"""The air inside objects, which is no object's for the network; filling gives it back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

AIR = 60.0
"""No matter is as light."""


def hollow(density: NDArray[np.float32], labels: NDArray[np.int32]) -> None:
    """Take the labels from the air inside objects, in place.

    The voids of cloth are smaller than 3 x 3 x 3 voxels and stay.

    Parameters
    ----------
    density : (Z, Y, X) ndarray of float32
        Sharp.
    labels : (Z, Y, X) ndarray of int32
    """
    air = (density < AIR).view(np.uint8)
    labels[maximum_filter(minimum_filter(air, 3), 3) > 0] = 0
