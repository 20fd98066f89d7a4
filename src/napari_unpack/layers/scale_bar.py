"""The scale bar in the 3D view: the same as in pictures and films, in the session's unit."""

from __future__ import annotations

from dataclasses import replace

from napari_unpack.appearance import Decorations
from napari_unpack.appearance.decorations import scale_mark
from napari_unpack.layers.rendered_image import to_bytes
from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.gl.depth_quads import ImageTexture, Quad, ScreenPlace

# Before all, so that nothing of the scene hides it.
NEAREST = -1.0


class ScaleBar:
    """Draws the bar; writes it anew only for another zoom, size of the canvas or unit."""

    def __init__(self) -> None:
        self._drawn: tuple[object, Quad] | None = None

    def quads(self, frame: Frame, around: Decorations) -> list[Quad]:
        """Return the bar's quad; none where no bar is wanted.

        Parameters
        ----------
        frame : Frame
            What the canvas shows.
        around : Decorations
        """
        if not around.scale:
            return []
        wanted = frame.camera.height, frame.size, around.ink, around.unit
        if self._drawn is None or self._drawn[0] != wanted:
            rgba, row, col = scale_mark(frame.camera, frame.size, around.ink, around.unit)
            place = ScreenPlace.of_pixels(row, col, rgba.shape[:2], frame.size)
            quad = Quad(ImageTexture(to_bytes(rgba)), replace(place, ndc_depth=NEAREST))
            self._drawn = wanted, quad
        return [self._drawn[1]]
