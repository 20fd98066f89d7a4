"""napari's brush, or what else the active layer does with the mouse."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import napari

# napari's mode in which a layer leaves the mouse to the view.
PANNING = "pan_zoom"


class Brush:
    """Put down while clicks are ours, or they would paint as well; taken up again after.

    Parameters
    ----------
    viewer : napari.Viewer
    """

    def __init__(self, viewer: napari.Viewer) -> None:
        self._viewer = viewer
        self._before: tuple[napari.layers.Layer, str] | None = None

    @property
    def in_hand(self) -> bool:
        """Whether a drag would paint or draw, and not turn or pan the view."""
        active = self._viewer.layers.selection.active
        return active is not None and str(getattr(active, "mode", PANNING)) != PANNING

    def put_down(self) -> None:
        """Leave the mouse to the view."""
        layer = self._viewer.layers.selection.active
        if layer is not None and self.in_hand:
            self._before = layer, str(layer.mode)
            layer.mode = PANNING

    def take_up(self) -> None:
        """Have the layer do again what it did, unless it does something else by now."""
        before, self._before = self._before, None
        if before is None or before[0] not in self._viewer.layers:
            return
        layer, mode = before
        if layer.mode == PANNING:
            layer.mode = mode
