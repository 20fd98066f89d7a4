"""What is known of a bag from its voxels alone: who touches whom, and who can leave."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Labels = NDArray[np.integer]


def contacts(labels: Labels) -> dict[tuple[int, int], int]:
    """Count the voxel faces that objects share, by (a, b) with a < b; pairs apart are left out."""
    found: dict[tuple[int, int], int] = {}
    for axis in range(3):
        moved = np.moveaxis(labels, axis, 0)
        a, b = moved[:-1], moved[1:]
        touch = (a != b) & (a != 0) & (b != 0)
        # Both orders of a pair count as one.
        pairs = np.sort(np.stack([a[touch], b[touch]], axis=1).astype(np.int64), axis=1)
        kinds, counts = np.unique(pairs, axis=0, return_counts=True)
        for (low, high), faces in zip(kinds.tolist(), counts.tolist(), strict=True):
            found[low, high] = found.get((low, high), 0) + faces
    return found


def removable(labels: Labels, axis: int, sign: int) -> set[int]:
    """Find the objects that can be moved out along an axis without meeting another.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int
        Object IDs, 0 background, which is no obstacle.
    axis : int
        0, 1 or 2: z, y or x.
    sign : int
        +1 towards larger indices, -1 towards smaller.

    Returns
    -------
    set of int
        IDs all of whose voxels see, on their way out, nothing but background and the object
        itself.

    Raises
    ------
    ValueError
        If the labels are not 3D, or the axis or the sign is none of these.

    Notes
    -----
    One sweep from the exit inwards that remembers, for every line, two different IDs met so
    far: a voxel is barred exactly where one of them is not its own.
    """
    if labels.ndim != 3:
        raise ValueError(f"labels must be 3D (z, y, x), got {labels.ndim} dimensions")
    if axis not in (0, 1, 2):
        raise ValueError(f"axis must be 0, 1 or 2 (z, y, x), got {axis!r}")
    if sign not in (1, -1):
        raise ValueError(f"sign must be 1 or -1, got {sign!r}")
    planes = np.moveaxis(labels, axis, 0)
    # From the exit inwards: what was met before is what stands in the way.
    if sign > 0:
        planes = planes[::-1]
    # Two different IDs are enough: whichever object comes next, one of them is not its own.
    one = np.zeros(planes.shape[1:], labels.dtype)
    two = np.zeros_like(one)
    present: set[int] = set()
    barred: set[int] = set()
    for plane in planes:
        full = plane != 0
        stopped = full & (((one != 0) & (one != plane)) | (two != 0))
        present.update(np.unique(plane[full]).tolist())
        barred.update(np.unique(plane[stopped]).tolist())
        second = full & (one != 0) & (one != plane) & (two == 0)
        two[second] = plane[second]
        first = full & (one == 0)
        one[first] = plane[first]
    return present - barred
