"""Where a picture made for one camera stands when another camera looks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from napari_unpack.geometry.view import Camera
from napari_unpack.rendering.visuals.places import PivotPlace
from napari_unpack.session.picture_patch import Patch


@dataclass(frozen=True)
class PicturePlace(PivotPlace):
    """A rectangle in the pivot plane of the camera that a picture was cast for.

    Parameters
    ----------
    center, half, ndc_depth
        As for `PivotPlace`, in the pivot space of the camera that looks now.
    plane : float
        Where pixels stand that have no depth of their own, mm behind the picture's own pivot
        plane.
    """

    plane: float = 0.0

    @property
    def t(self) -> float:
        """Depth of what has none of its own, mm from the pivot plane of the camera."""
        return self.plane - float(self.center[0])

    @property
    def t_origin(self) -> float:
        """What to add to the picture's depths, mm."""
        return -float(self.center[0])


class Placed(Protocol):
    """A rectangle of a picture: a `Patch`, or one that is still to be cast."""

    @property
    def row(self) -> int:
        """First row of the whole picture."""

    @property
    def col(self) -> int:
        """First column of the whole picture."""

    @property
    def size(self) -> tuple[int, int]:
        """Height and width, pixels."""

    @property
    def plane(self) -> float:
        """Depth t of what has none of its own, mm."""


def picture_place(
    patch: Placed, made_for: Camera, size: tuple[int, int], seen_by: Camera
) -> PicturePlace:
    """Place a patch of a picture where it belongs under the camera that looks now.

    Parameters
    ----------
    patch : Patch or Window
        Where the pixels are in the whole picture.
    made_for : Camera
        The camera the picture was cast for.
    size : (int, int)
        Height and width of the whole picture, pixels.
    seen_by : Camera
        The camera that looks now.

    Returns
    -------
    PicturePlace

    Notes
    -----
    Under the same camera this is the patch's window, exactly; after a zoom or a pan the old
    picture follows at once, while the new one is being cast. A turn it cannot follow.
    """
    mm = made_for.height / size[0]
    height, width = patch.size
    towards, down, right = seen_by.linear @ (made_for.center - seen_by.center)
    return PicturePlace(
        center=(
            float(towards),
            float(down) + (patch.row + (height - size[0]) / 2) * mm,
            float(right) + (patch.col + (width - size[1]) / 2) * mm,
        ),
        half=(height * mm / 2, width * mm / 2),
        plane=patch.plane,
    )


def sprite_place(patch: Patch, center: tuple[float, float, float], mm: float) -> PivotPlace:
    """Place a sprite's patch in pivot space.

    Parameters
    ----------
    patch : Patch
        Of `session.pictures.sprite_patch`: row and col count from the object's centre.
    center : (float, float, float)
        Where that centre is, pivot space mm.
    mm : float
        Size of a pixel, mm.

    Returns
    -------
    PivotPlace
    """
    height, width = patch.rgba.shape[:2]
    return PivotPlace(
        center=(
            float(center[0]),
            float(center[1]) + (patch.row - 0.5 + height / 2) * mm,
            float(center[2]) + (patch.col - 0.5 + width / 2) * mm,
        ),
        half=(height * mm / 2, width * mm / 2),
    )
