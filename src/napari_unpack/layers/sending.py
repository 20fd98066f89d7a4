"""Send volumes to the graphics card piece by piece, while the CPU's picture stays."""

from __future__ import annotations

from collections.abc import Callable

from qtpy.QtCore import QTimer

from napari_unpack.layers.packed import PackedLayer
from napari_unpack.layers.studio import Studio


class Sending:
    """Sends one piece each time the canvas is drawn, since only then GL may be spoken to.

    Parameters
    ----------
    studio : Studio
        Who has what is to be sent.
    packed : PackedLayer
        Whose drawing is waited for.
    caster_changed : callable
        Given, after a piece, whether GL cast before it.
    refine : callable
        Called once all labels that were repaired are there.
    """

    def __init__(
        self,
        studio: Studio,
        packed: PackedLayer,
        caster_changed: Callable[[bool], None],
        refine: Callable[[], None],
    ) -> None:
        self._studio, self._packed = studio, packed
        self._caster_changed, self._refine = caster_changed, refine
        self._sending = self._relabelled = self._closed = False
        packed.on_draw = self._send

    @property
    def busy(self) -> bool:
        """Whether pieces are on their way, or wait for a canvas that will be drawn."""
        return self._sending or (self._studio.waiting and self._packed.visible)

    def go_on(self) -> None:
        """Have the canvas drawn if anything waits to be sent."""
        if self._studio.waiting:
            self._packed.repaint()

    def refine_when_sent(self) -> None:
        """Have the picture refined once everything is there; at once if nothing waits."""
        self._relabelled = self._studio.waiting and self._studio.active
        if not self._relabelled:
            self._refine()

    def close(self) -> None:
        """Send nothing more."""
        self._closed = True
        self._packed.on_draw = _nothing

    def _send(self) -> None:
        # The canvas is being drawn: what follows waits until it is done.
        if self._studio.waiting:
            before, self._sending = self._studio.active, True
            self._studio.send()
            QTimer.singleShot(0, lambda: self._sent(before))

    def _sent(self, before: bool) -> None:
        self._sending = False
        if self._closed:
            return
        self._caster_changed(before)
        self.go_on()
        if self._relabelled and not self._studio.waiting:
            self._relabelled = False
            self._refine()


def _nothing() -> None:
    """Do nothing."""
