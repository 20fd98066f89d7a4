"""How an unpacked object is held up: its broad side to the viewer, seen a little aslant."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from napari_unpack.geometry.axes import Matrix
from napari_unpack.geometry.transforms import rotation_about
from napari_unpack.unpacking.oriented_box import OrientedBox

SLANT = (18.0, -24.0)
"""Degrees by which the top and a side are turned to the viewer, so that depth shows."""


def broad_side(box: OrientedBox, seen: ArrayLike, slant: tuple[float, float] = SLANT) -> Matrix:
    """Return the turn that shows an object's largest face, nearest to how it is seen now.

    Parameters
    ----------
    box : OrientedBox
        Around the object, (stretched) world.
    seen : (3, 3) array_like
        From world axes to pivot axes, as the object is seen now (the camera's rotation).
    slant : (float, float)
        Degrees about the axes right and down.

    Returns
    -------
    (3, 3) ndarray of float64
        From world axes to pivot axes (towards the viewer, down, right).
    """
    now = np.asarray(seen, dtype=np.float64)
    best, fit = now, -np.inf
    for towards in (box.axes[2], -box.axes[2]):
        for right in (box.axes[0], -box.axes[0], box.axes[1], -box.axes[1]):
            # In (towards, down, right), down = right x towards keeps the turn proper.
            turn = np.stack([towards, np.cross(right, towards), right])
            alike = float((turn * now).sum())
            if alike > fit + 1e-9:
                best, fit = turn, alike
    about_right = rotation_about((0.0, 0.0, 1.0), np.radians(slant[0]))
    about_down = rotation_about((0.0, 1.0, 0.0), np.radians(slant[1]))
    return about_right @ about_down @ best


def picture_size(points: ArrayLike, rotation: Matrix, spacing: ArrayLike) -> tuple[float, float]:
    """Return width and height in mm of the picture of points held at a turn.

    Parameters
    ----------
    points : (n, 3) array_like
        Voxel centres, world mm.
    rotation : (3, 3) ndarray of float64
        From world axes to pivot axes, a stretch of the bag included.
    spacing : (3,) array_like
        Voxel size in mm, added around the centres.

    Returns
    -------
    width, height : float
    """
    extent = np.ptp(np.asarray(points, dtype=np.float64) @ rotation.T, axis=0)
    extent += np.abs(rotation) @ np.asarray(spacing, dtype=np.float64)
    return float(extent[2]), float(extent[1])
