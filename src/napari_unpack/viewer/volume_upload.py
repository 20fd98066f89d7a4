"""Volumes on their way to the graphics card, piece by piece, while the CPU's image stays."""

from __future__ import annotations

from collections.abc import Callable

from napari_unpack.layers.packed_layer import PackedLayer, do_nothing
from napari_unpack.rendering.scene import Scene
from napari_unpack.rendering.subvolumes import Subvolume
from napari_unpack.tasks import Task
from napari_unpack.viewer.canvas_backend import CanvasBackend
from napari_unpack.viewer.packed_renderer import PackedRenderer
from napari_unpack.viewer.scheduler import Scheduler, Worker


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
    packed_renderer : PackedRenderer
        Makes volumes ready, and refines its image once all repaired labels are there.
    """

    def __init__(
        self,
        canvas_backend: CanvasBackend,
        scheduler: Scheduler,
        packed: PackedLayer,
        backend_changed: Callable[[bool], None],
        packed_renderer: PackedRenderer,
    ) -> None:
        self._canvas_backend, self._scheduler, self._packed = canvas_backend, scheduler, packed
        self._backend_changed, self._packed_renderer = backend_changed, packed_renderer
        self._sending = self._relabelled = self._closed = False
        packed.on_draw = self._send

    @property
    def busy(self) -> bool:
        """Whether pieces are on their way, or wait for a canvas that will be drawn."""
        canvas = self._canvas_backend
        return self._sending or canvas.probing or (canvas.waiting and self._packed.visible)

    def resume(self) -> None:
        """Have the canvas drawn if anything waits to be sent."""
        if self._canvas_backend.waiting:
            self._packed.repaint()

    def make_ready(self, scene: Scene, relabelled: bool = False) -> None:
        """Make a volume ready in a worker, and send it.

        Parameters
        ----------
        scene : Scene
        relabelled : bool, optional
            Refine the image once all labels are there; at once if nothing waits.
        """

        def supply(subvolume: Subvolume) -> None:
            before = self._canvas_backend.active
            self._canvas_backend.supply(subvolume)
            self._backend_changed(before)
            self.resume()
            if relabelled:
                self._relabelled = self._canvas_backend.waiting and self._canvas_backend.active
                if not self._relabelled:
                    self._packed_renderer.refine()

        # Growing the labels into fringes takes up to a second.
        task = Task("volume", lambda _: self._packed_renderer.subvolume(scene))
        self._scheduler.submit(task, Worker.REFINE, supply)

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
        # Refined piece by piece the image would mix old labels and new.
        if self._relabelled and not self._canvas_backend.waiting:
            self._relabelled = False
            self._packed_renderer.refine()
