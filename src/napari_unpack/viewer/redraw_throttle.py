"""One redraw an image while the bag is turned: redraws in between would show nothing new."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic

from napari_unpack.layers.compat import RedrawHook
from napari_unpack.layers.packed_layer import PackedLayer
from napari_unpack.layers.view_camera import Frame
from napari_unpack.viewer.scheduler import Scheduler

# A redraw is put off at most so long: whatever else is in the scene turns with the bag.
LONGEST_MS = 100

# Movement that counts as none, of the height of the view: a tenth of a pixel of 1000.
STILL = 1e-4


class RedrawThrottle:
    """Puts off redraws of a canvas while the image of a turned bag is on its way.

    Parameters
    ----------
    hook : RedrawHook
        Asks before the canvas asks for a redraw.
    scheduler : Scheduler
    layer : PackedLayer
        Shows the image of the bag.
    waits : callable
        Returns whether an image of the bag is being cast on the processor and the one before
        has been drawn, while nothing else moves.
    set_view : callable
        Given such a frame instead of a redraw, so that the next image is of the newest camera.

    Notes
    -----
    Without a graphics card a redraw takes the two cores as long as half an image does, and
    after a turn, which the image before cannot follow, it shows nothing. Pans and zooms, which
    it can, are redrawn at once.
    """

    def __init__(
        self,
        hook: RedrawHook,
        scheduler: Scheduler,
        layer: PackedLayer,
        waits: Callable[[], bool],
        set_view: Callable[[Frame], None],
    ) -> None:
        self._hook, self._scheduler, self._layer = hook, scheduler, layer
        self._waits, self._set_view = waits, set_view
        self._asked_at = 0.0
        hook.install(self._asked)

    def close(self) -> None:
        """Put off nothing more."""
        self._forget()
        self._hook.remove()

    def _asked(self) -> None:
        if self._hook.is_drawing:
            return
        if self._left_ms() > 0 and self._waits():
            # Not at once: napari tells the camera piece by piece.
            self._asked_at = monotonic()
            self._scheduler.debounce(0, self._decide)
        else:
            self._redraw()

    def _decide(self) -> None:
        # Drawn meanwhile for another reason.
        if self._layer.drawn_at > self._asked_at:
            return
        left, frame = self._left_ms(), self._layer.frame_now()
        if frame is None or left <= 0 or not self._waits() or not turned(self._layer.frame, frame):
            self._redraw()
            return
        self._set_view(frame)
        # At the latest then: overlays and napari's own layers turn with the bag.
        self._scheduler.throttle(left, self._redraw)

    def _left_ms(self) -> int:
        return LONGEST_MS - round(1000 * (monotonic() - self._layer.drawn_at))

    def _redraw(self) -> None:
        self._forget()
        self._hook.redraw()

    def _forget(self) -> None:
        self._scheduler.forget(self._decide)
        self._scheduler.forget(self._redraw)


def turned(before: Frame | None, now: Frame | None) -> bool:
    """Return whether all that has changed between two frames is how the bag is turned.

    Parameters
    ----------
    before, now : Frame or None
    """
    if before is None or now is None or before.size != now.size or now.same_as(before):
        return False
    a, b = before.camera, now.camera
    return bool(
        abs(a.center - b.center).max() <= STILL * b.height
        and abs(a.height - b.height) <= STILL * b.height
        and abs(a.fov - b.fov) <= STILL
    )
