"""What a picture of a moving object is asked with."""

from __future__ import annotations

from dataclasses import dataclass

from napari_unpack.geometry.transforms import Pose


@dataclass(frozen=True, eq=False)
class Moving:
    """One object to be cast where it is now.

    Parameters
    ----------
    pose : Pose
        Where, in the pivot space of the camera.
    in_front : bool
        Draw it before everything else instead of where it is.
    sharp : bool
        It does not move: cast all its pixels.
    """

    pose: Pose
    in_front: bool = False
    sharp: bool = False
