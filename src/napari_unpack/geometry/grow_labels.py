"""Labels for display: objects grown into the unlabelled fringe around them.

A segmentation's masks end where the density falls below its threshold, but the interpolated
density fades out a voxel or two further, and that fading fringe is what makes a ray-cast surface
smooth (Li et al. 2012, section 4.1). Left without a label it would stay behind as a grey shell
when its object is hidden or unpacked.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from napari_unpack.kernels import njit


def grow_labels(labels: NDArray[np.uint16], voxels: int = 2) -> NDArray[np.uint16]:
    """Let every object claim the unlabelled voxels near it.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of uint16
        Object IDs, 0 unlabelled. Not changed.
    voxels : int
        Rounds of growth; each claims the 6-neighbours of the last. 0 returns a copy.

    Returns
    -------
    (Z, Y, X) ndarray of uint16
        Labelled voxels keep their label. Where several objects reach a voxel in the same
        round the smallest ID gets it.
    """
    grown = np.ascontiguousarray(labels).copy()
    for _ in range(voxels):
        source = grown
        grown = source.copy()
        _grow(source, grown)
    return grown


@njit(cache=True, nogil=True)
def _grow(source, grown):  # type: ignore[no-untyped-def]
    depth, height, width = source.shape
    for z in range(depth):
        for y in range(height):
            for x in range(width):
                if source[z, y, x]:
                    continue
                best = 0
                if z > 0:
                    best = _smaller(best, source[z - 1, y, x])
                if z + 1 < depth:
                    best = _smaller(best, source[z + 1, y, x])
                if y > 0:
                    best = _smaller(best, source[z, y - 1, x])
                if y + 1 < height:
                    best = _smaller(best, source[z, y + 1, x])
                if x > 0:
                    best = _smaller(best, source[z, y, x - 1])
                if x + 1 < width:
                    best = _smaller(best, source[z, y, x + 1])
                if best:
                    grown[z, y, x] = best


@njit(cache=True, inline="always")
def _smaller(best, label):  # type: ignore[no-untyped-def]
    if label and (best == 0 or label < best):
        return label
    return best
