"""Pulling objects out voxel by voxel, with nothing of ours: the twin of ray casting.

Shared by tests. Every voxel centre of an object goes along D until it is out of the volume; the
voxels it passes are looked up.
"""

from __future__ import annotations

import numpy as np

STEP = 0.25
"""Voxel edges between two looks."""


def met_on_the_way(labels, ids, direction, spacing=(1.0, 1.0, 1.0)):
    """Return the IDs of other objects that a set of objects meets when pulled along D.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int
    ids : iterable of int
        Pulled out together; they do not stand in each other's way.
    direction : (3,) array_like
        D in world.
    spacing : (3,) sequence of float
        Voxel size in mm.
    """
    points = np.argwhere(np.isin(labels, list(ids))).astype(float)
    way = np.asarray(direction, float) / np.asarray(spacing, float)
    way *= STEP / np.linalg.norm(way)
    top = np.array(labels.shape) - 1
    # Air around the objects is passed by unseen.
    full = np.argwhere(labels > 0)
    low, high = full.min(axis=0), full.max(axis=0)
    met, own = set(), set(ids) | {0}
    while len(points):
        points = points + way
        voxels = np.rint(points).astype(np.int64)
        gone = ((way > 0) & (voxels > high) | (way < 0) & (voxels < low)).any(axis=1)
        gone |= ((voxels < 0) | (voxels > top)).any(axis=1)
        points, voxels = points[~gone], voxels[~gone]
        met.update(set(labels[tuple(voxels.T)].tolist()) - own)
    return met


def free_by_sweep(labels, direction, spacing=(1.0, 1.0, 1.0)):
    """Return the objects that meet no other when pulled along D alone.

    As `met_on_the_way` of each by itself, but all go at once, which is quicker.
    """
    points = np.argwhere(labels > 0)
    owners = labels[tuple(points.T)]
    low, high = points.min(axis=0), points.max(axis=0)
    free = np.zeros(int(labels.max()) + 1, bool)
    free[owners] = True
    points = points.astype(float)
    way = np.asarray(direction, float) / np.asarray(spacing, float)
    way *= STEP / np.linalg.norm(way)
    while len(points):
        points += way
        voxels = np.rint(points).astype(np.int64)
        gone = ((voxels > high) | (voxels < low)).any(axis=1)
        others = labels[tuple(voxels[~gone].T)]
        free[owners[~gone][(others != 0) & (others != owners[~gone])]] = False
        left = ~gone & free[owners]
        points, owners = points[left], owners[left]
    return set(np.flatnonzero(free).tolist())
