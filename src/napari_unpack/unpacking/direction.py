"""D, the direction in which objects leave."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from napari_unpack.geometry.axes import Vector, fixed, triple, unit
from napari_unpack.geometry.view import GRAVITY_UP, Camera
from napari_unpack.unpacking.oriented_box import OrientedBox

# The six axes by name, world z y x.
AXES: dict[str, tuple[float, float, float]] = {
    "+z": (1.0, 0.0, 0.0),
    "-z": (-1.0, 0.0, 0.0),
    "+y": (0.0, 1.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "+x": (0.0, 0.0, 1.0),
    "-x": (0.0, 0.0, -1.0),
}


def towards_viewer(camera: Camera) -> Vector:
    """Return the opposite of the direction of looking: the paper's choice and our default."""
    return -camera.direction


def bag_up(box: OrientedBox, table: Sequence[float] = GRAVITY_UP) -> Vector:
    """Return up of a bag lying on its largest face.

    Parameters
    ----------
    box : OrientedBox
        Around everything in the bag.
    table : (3,) sequence of float
        Away from the table, world; by default -y.

    Returns
    -------
    (3,) ndarray of float64
        Normal of the largest face with the sign that points away from the table. Where the bag
        stands on edge (the normal is level) the largest component is negative, so that the sign
        does not hang on rounding.

    Notes
    -----
    Li et al. 2012, section 5.1: "the up direction when a suitcase lies on its largest surface".
    """
    normal = unit(box.normal, "normal")
    rise = float(normal @ unit(table, "table"))
    # Within a twentieth of a degree of level the sign would be noise.
    if abs(rise) < 1e-3:
        rise = -float(normal[int(np.abs(normal).argmax())])
    return fixed(normal if rise > 0 else -normal)


def checked_direction(
    direction: str | Sequence[float] | None,
) -> str | tuple[float, float, float] | None:
    """Return D as asked for: None (opposite of the view), "up" (the bag's), or world (z, y, x).

    Raises
    ------
    ValueError
        As `named`; "view" is None.
    """
    if direction is None or (isinstance(direction, str) and direction in ("view", "up")):
        return "up" if direction == "up" else None
    return triple(named(direction))


def named(direction: str | Sequence[float]) -> Vector:
    """Return the unit vector of an axis's name or of three numbers.

    Raises
    ------
    ValueError
        If the name is unknown or the vector is not three finite numbers, not all zero.
    """
    if isinstance(direction, str):
        if direction not in AXES:
            raise ValueError(
                f"direction must be one of {', '.join(AXES)}, 'view', 'up' or three numbers "
                f"(z, y, x), got {direction!r}"
            )
        return np.array(AXES[direction])
    return unit(direction, "direction")
