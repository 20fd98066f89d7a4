"""Pictures that the canvas's own GL casts at the moment they are drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

from napari_unpack.geometry.view import Camera
from napari_unpack.layers.picture_place import picture_place
from napari_unpack.layers.shots import FRONT
from napari_unpack.rendering.visuals.cards import Card
from napari_unpack.rendering.visuals.pictures import Picture

WIDEN = 64
"""Windows are widened to multiples of so many pixels, so that few frame buffers serve all."""


@dataclass(frozen=True)
class Window:
    """A rectangle of a picture, placed as a `Patch` is.

    Parameters
    ----------
    row, col : int
        Its first pixel; may be negative.
    size : (int, int)
        Height and width, pixels.
    plane : float
        t of the middle of what is shown, mm.
    """

    row: int
    col: int
    size: tuple[int, int]
    plane: float

    @classmethod
    def around(cls, window: tuple[int, int, int, int], plane: float) -> Window:
        """Return (row, col, height, width) widened to the right and down."""
        row, col, height, width = window
        return cls(row, col, (-(-height // WIDEN) * WIDEN, -(-width // WIDEN) * WIDEN), plane)


@dataclass(eq=False)
class LiveShot:
    """A picture for one camera, cast when it is first drawn.

    Parameters
    ----------
    window : Window
        The part of the picture that is cast.
    camera : Camera
        The camera it is for.
    size : (int, int)
        Height and width of the whole picture, pixels.
    develop : callable
        Casts it; called once, with the canvas's context current. None: it could not be cast.
    in_front : bool
        Draw it before everything else instead of where it is.
    """

    window: Window
    camera: Camera
    size: tuple[int, int]
    develop: Callable[[], Picture | None]
    in_front: bool = False
    ready: bool = field(default=False, init=False)
    _picture: Picture | None = field(default=None, init=False)

    thumbnail: None = field(default=None, init=False)
    """Nothing is read back from the graphics card for the layer list."""

    def card(self, seen_by: Camera, opacity: float = 1.0) -> Card | None:
        """Return the card that shows it under a camera; None where it could not be cast."""
        if not self.ready:
            self._picture, self.ready = self.develop(), True
        if self._picture is None:
            return None
        place = picture_place(self.window, self.camera, self.size, seen_by)
        if self.in_front:
            place = replace(place, ndc_depth=FRONT)
        return Card(self._picture, place, opacity)
