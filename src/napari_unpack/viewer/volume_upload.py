"""Volumes on their way to the graphics card, piece by piece, while the CPU's image stays."""

from __future__ import annotations

from collections.abc import Callable

from napari_unpack.layers.packed_layer import PackedLayer, do_nothing
from napari_unpack.viewer.canvas_backend import CanvasBackend
from napari_unpack.viewer.scheduler import Scheduler


class VolumeUpload:
    """Sends one piece each time the canvas is drawn, since only then GL may be spoken to.

    Parameters
    ----------
    canvas_backend : CanvasBackend
        Has what is to be sent.
    scheduler : Scheduler
    packed : PackedLayer
        A piece is sent whenever it is drawn.
    backend_changed : callable
        Given, after a piece, whether the canvas cast before it.
    refine : callable
        Called once all labels that were repaired are there.
    """

    def __init__(
        self,
        canvas_backend: CanvasBackend,
        scheduler: Scheduler,
        packed: PackedLayer,
        backend_changed: Callable[[bool], None],
        refine: Callable[[], None],
    ) -> None:
        self._canvas_backend, self._scheduler, self._packed = canvas_backend, scheduler, packed
        self._backend_changed, self._refine = backend_changed, refine
        self._sending = self._relabelled = self._closed = False
        packed.on_draw = self._send

    @property
    def busy(self) -> bool:
        """Whether pieces are on their way, or wait for a canvas that will be drawn."""
        return self._sending or (self._canvas_backend.waiting and self._packed.visible)

    def resume(self) -> None:
        """Have the canvas drawn if anything waits to be sent."""
        if self._canvas_backend.waiting:
            self._packed.repaint()

    def refine_when_sent(self) -> None:
        """Have the image refined once everything is there; at once if nothing waits."""
        self._relabelled = self._canvas_backend.waiting and self._canvas_backend.active
        if not self._relabelled:
            self._refine()

    def close(self) -> None:
        """Send nothing more."""
        self._closed = True
        self._packed.on_draw = do_nothing

    def _send(self) -> None:
        # The canvas is being drawn: what follows waits until it is done.
        if self._canvas_backend.waiting:
            before, self._sending = self._canvas_backend.active, True
            self._canvas_backend.send()
            self._scheduler.soon(lambda: self._sent(before))

    def _sent(self, before: bool) -> None:
        self._sending = False
        if self._closed:
            return
        self._backend_changed(before)
        self.resume()
        if self._relabelled and not self._canvas_backend.waiting:
            self._relabelled = False
            self._refine()
