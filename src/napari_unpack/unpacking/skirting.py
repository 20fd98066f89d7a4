"""The way from beside the bag to a slot that does not lead through the bag.

A slot may lie on the other side of the bag than the one an object leaves by. So it goes on along
D until it is clear of a ball around the bag, and then round the ball.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from napari_unpack.geometry.axes import Vector

STRAIGHT_UNTIL = 0.5
TURNING_FROM = 0.2
"""Parts of the way: on along D until the first, round the bag from the second."""


@dataclass(frozen=True, eq=False)
class Ball:
    """What nobody may fly through.

    Parameters
    ----------
    center : (3,) ndarray of float64
        Of the bag, world mm.
    radius : float
        Of the bag and of whoever flies together, mm of pivot space.
    """

    center: Vector
    radius: float


def skirt(
    start: Vector, along: Vector, target: Vector, center: Vector, radius: float, gone: float
) -> Vector:
    """Return a place on the way round a ball, all in pivot space, mm.

    Parameters
    ----------
    start : (3,) ndarray of float64
        Where the way begins.
    along : (3,) ndarray of float64
        D, a unit vector.
    target : (3,) ndarray of float64
        Where it ends.
    center, radius
        The ball.
    gone : float
        How much of the way is behind, 0 to 1.

    Returns
    -------
    (3,) ndarray of float64

    Notes
    -----
    Directions from the centre are interpolated along the arc between them, distances from it
    linearly. Towards the opposite side the arc passes on the viewer's side.
    """
    out = 1.0 - max(0.0, 1.0 - gone / STRAIGHT_UNTIL) ** 2
    first = start + out * _way_out(start - center, along, radius) * along - center
    last = target - center
    turned = float(np.clip((gone - TURNING_FROM) / (1.0 - TURNING_FROM), 0.0, 1.0))
    turned = turned * turned * (3.0 - 2.0 * turned)
    near, far = float(np.linalg.norm(first)), float(np.linalg.norm(last))
    if min(near, far) < 1e-9 * radius:
        return center + (1.0 - turned) * first + turned * last
    a, b = first / near, last / far
    side = b - (a @ b) * a
    if np.linalg.norm(side) < 1e-3:
        # Towards the viewer, or down where that is the way already.
        towards = np.eye(3)[0] if abs(a[0]) < 0.9 else np.eye(3)[1]
        side = towards - (a @ towards) * a
    side = side / np.linalg.norm(side)
    angle = turned * float(np.arctan2(np.linalg.norm(b - (a @ b) * a), a @ b))
    arc = np.cos(angle) * a + np.sin(angle) * side
    distance = (1.0 - turned) * near + turned * far
    place: Vector = center + distance * arc
    return place if turned < 1.0 else target.copy()


def _way_out(start: Vector, along: Vector, radius: float) -> float:
    """Return how far it is along a unit vector until out of a ball about the origin, mm."""
    towards = float(start @ along)
    inside = radius**2 - float(start @ start)
    return 0.0 if inside <= 0.0 else float(np.sqrt(towards**2 + inside)) - towards
