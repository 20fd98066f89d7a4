"""One redraw a picture while the bag is turned: redraws in between would show nothing new."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic
from typing import Any

from napari_unpack.layers.compat import is_drawing
from napari_unpack.layers.packed_layer import PackedLayer
from napari_unpack.layers.view_camera import Frame
from napari_unpack.viewer.jobs import single_shot, stop

LONGEST_MS = 100
"""A redraw is put off at most so long: whatever else is in the scene turns with the bag."""

STILL = 1e-4
"""Of the height of the view: a tenth of a pixel."""


class RedrawThrottle:
    """Puts off redraws of a canvas while the picture of a turned bag is on its way.

    Parameters
    ----------
    canvas : vispy.scene.SceneCanvas or None
        None, a viewer without a window, needs no pacing.
    layer : PackedLayer
        Shows the picture of the bag.
    waits : callable
        Returns whether a picture of the bag is being cast on the processor and the one before
        has been drawn, while nothing else moves.
    look : callable
        Given such a frame instead of a redraw, so that the next picture is of the newest camera.

    Notes
    -----
    Without a graphics card a redraw takes the two cores as long as half a picture does, and
    after a turn, which the picture before cannot follow, it shows nothing. Pans and zooms, which
    it can, are redrawn at once.
    """

    def __init__(
        self,
        canvas: Any,
        layer: PackedLayer,
        waits: Callable[[], bool],
        look: Callable[[Frame], None],
    ) -> None:
        self._canvas, self._layer = canvas, layer
        self._waits, self._look = waits, look
        self._asked_at = 0.0
        self._soon = single_shot(self._decide)
        self._late = single_shot(self._redraw)
        if canvas is not None:
            self._update = canvas.update
            canvas.update = self._asked

    def close(self) -> None:
        """Put off nothing more."""
        stop(self._soon)
        stop(self._late)
        if self._canvas is not None and vars(self._canvas).get("update") == self._asked:
            del self._canvas.update

    def _asked(self, node: Any = None) -> None:
        if is_drawing(self._canvas):
            return
        if self._left_ms() > 0 and self._waits():
            # Not at once: the camera is told piece by piece.
            self._asked_at = monotonic()
            self._soon.start(0)
        else:
            self._redraw()

    def _decide(self) -> None:
        if self._layer.drawn_at > self._asked_at:
            return
        left, frame = self._left_ms(), self._layer.frame_now()
        if left <= 0 or not self._waits() or not turned(self._layer.frame, frame):
            self._redraw()
            return
        self._look(frame)
        if not self._late.isActive():
            self._late.start(left)

    def _left_ms(self) -> int:
        return LONGEST_MS - round(1000 * (monotonic() - self._layer.drawn_at))

    def _redraw(self) -> None:
        stop(self._soon)
        stop(self._late)
        self._update()


def turned(before: Frame | None, now: Frame | None) -> bool:
    """Return whether all that has changed between two frames is how the bag is turned."""
    if before is None or now is None or before.size != now.size or now.same_as(before):
        return False
    a, b = before.camera, now.camera
    return bool(
        abs(a.center - b.center).max() <= STILL * b.height
        and abs(a.height - b.height) <= STILL * b.height
        and abs(a.fov - b.fov) <= STILL
    )
