"""One object studied alone: framed large, turned by hand, back to its place at the end."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from napari_unpack.geometry.axes import Matrix
from napari_unpack.geometry.transforms import Pose
from napari_unpack.geometry.view import Camera

SECONDS = 0.35
SHARE_OF_VIEW = 0.72
"""How much of the view's shorter side the object's bounding sphere fills."""


@dataclass(frozen=True, eq=False)
class Inspection:
    """An object on its way to the middle of the view, there, or on its way back.

    Parameters
    ----------
    object_id : int
    home : Pose
        Where it waits otherwise, pivot space.
    diameter : float
        Diagonal of its box, mm, at scale 1.
    rotation : (3, 3) ndarray of float64
        How it is turned now.
    since : float
        When it began to come, or to go, s.
    leaving : bool
        Whether it is on its way back.

    Notes
    -----
    notes/readings.md 15: the object turns, not the camera. The framed pose follows the camera,
    so zooming zooms it.
    """

    object_id: int
    home: Pose
    diameter: float
    rotation: Matrix
    since: float
    height: float
    leaving: bool = False

    def pose(self, now: float, aspect: float) -> Pose:
        """Return where it is now.

        Parameters
        ----------
        now : float
            s, on the clock of `since`.
        aspect : float
            Width of the view over its height.
        """
        gone = float(np.clip((now - self.since) / SECONDS, 0.0, 1.0))
        eased = gone * gone * (3.0 - 2.0 * gone)
        fraction = 1.0 - eased if self.leaving else eased
        framed = Pose(np.zeros(3), self.rotation, self.framed_scale(aspect))
        return replace(self.home, rotation=self.rotation).toward(framed, fraction)

    def framed_scale(self, aspect: float) -> float:
        """Return the enlargement at which it fills its share of the view."""
        return SHARE_OF_VIEW * self.height * min(1.0, aspect) / self.diameter

    def still(self, now: float) -> bool:
        """Tell whether it has arrived."""
        return now >= self.since + SECONDS

    def turned(self, rotation: Matrix) -> Inspection:
        """Return it turned by a rotation of pivot space."""
        return replace(self, rotation=rotation @ self.rotation)

    def left(self, now: float) -> Inspection:
        """Return it on its way back from now on."""
        return replace(self, since=now, leaving=True)


def inspection_of(
    object_id: int, home: Pose, diameter: float, camera: Camera, now: float
) -> Inspection:
    """Begin an inspection: the object keeps its turn, the view of now is to be filled."""
    return Inspection(object_id, home, diameter, home.rotation, now, camera.height)
