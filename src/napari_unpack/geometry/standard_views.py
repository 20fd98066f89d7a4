"""The six sides of a bag to look at it from, however it lies and however it is shown."""

from __future__ import annotations

from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from napari_unpack.geometry.axes import Matrix, Vector, unit
from napari_unpack.geometry.view import STEEPEST


class Side(Enum):
    """Where one stands, and what is up in the image then; both along front, up and right."""

    FRONT = (1, 0, 0), (0, 1, 0)
    BACK = (-1, 0, 0), (0, 1, 0)
    LEFT = (0, 0, -1), (0, 1, 0)
    RIGHT = (0, 0, 1), (0, 1, 0)
    TOP = (0, 1, 0), (-1, 0, 0)
    BOTTOM = (0, -1, 0), (1, 0, 0)


# Cosine of 20 degrees: a box around soft things leans by less, and by chance.
UPRIGHT = 0.94


def upright(bag_up: ArrayLike, gravity_up: ArrayLike) -> Vector:
    """Return the bag's up, or up itself where the bag hardly leans: slices are square to that.

    Parameters
    ----------
    bag_up, gravity_up : (3,) array_like
        World.
    """
    own, plumb = unit(bag_up), unit(gravity_up)
    return plumb if own @ plumb > UPRIGHT else own


def bag_axes(up: ArrayLike, stretch: Matrix) -> Matrix:
    """Return the bag's front, up and right as it is shown, rows of (3, 3).

    Parameters
    ----------
    up : (3,) array_like
        The bag's up, world: the normal of what lies level in it.
    stretch : (3, 3) ndarray of float64
        How the bag is stretched or mirrored (`Camera.stretch`); the axes are of that world.

    Notes
    -----
    Front is +z, or +y where that is up. Right is what is at the right as one looks at the front,
    also of a mirrored bag.
    """
    # The stretch is symmetric; normals go the other way than points.
    above = unit(np.linalg.solve(stretch, np.asarray(up, dtype=np.float64)))
    ahead = unit(stretch[:, 0])
    if abs(ahead @ above) > STEEPEST:
        ahead = unit(stretch[:, 1])
    front = unit(ahead - (ahead @ above) * above)
    # Towards, down, right is right-handed (CONVENTIONS).
    return np.stack([front, above, np.cross(front, -above)])


def facing(towards: ArrayLike, up: ArrayLike) -> Matrix:
    """Return the rotation of a camera, (3, 3) from (stretched) world axes to pivot axes.

    Parameters
    ----------
    towards : (3,) array_like
        Where the viewer stands, seen from the bag; stretched world.
    up : (3,) array_like
        Up in the image, as far as that is possible.
    """
    near, above = unit(towards), np.asarray(up, dtype=np.float64)
    down = -unit(above - (above @ near) * near)
    return np.stack([near, down, np.cross(near, down)])


def seen_from(side: Side, axes: Matrix) -> Matrix:
    """Return the rotation of a camera that stands at a side.

    Parameters
    ----------
    side : Side
    axes : (3, 3) ndarray of float64
        From `bag_axes`.
    """
    towards, up = side.value
    return facing(np.array(towards) @ axes, np.array(up) @ axes)


def seen_along(direction: ArrayLike, axes: Matrix) -> Matrix:
    """Return the rotation of a camera towards which things leave that go along a direction.

    Parameters
    ----------
    direction : (3,) array_like
        Of the stretched world.
    axes : (3, 3) ndarray of float64
        From `bag_axes`.
    """
    towards = unit(direction)
    # From straight above or below the bag's up is no direction in the image: its back stands in.
    steep = abs(towards @ axes[1]) > STEEPEST
    return facing(towards, -np.sign(towards @ axes[1]) * axes[0] if steep else axes[1])
