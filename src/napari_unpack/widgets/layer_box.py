"""A drop-down list of the viewer's layers that keeps itself up to date."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from qtpy.QtCore import Signal
from qtpy.QtWidgets import QComboBox


class LayerBox(QComboBox):
    """Choose one of the viewer's layers.

    `chosen` is emitted when the chosen layer changes, by hand or because layers came and went.

    Parameters
    ----------
    viewer : napari.Viewer
    accepts : callable
        Takes a layer, tells whether to list it.
    none : str, optional
        Text of a first entry that means no layer.
    prefers : callable, optional
        Takes a layer, tells whether it is a good first choice.
    """

    chosen = Signal()

    def __init__(
        self,
        viewer: Any,
        accepts: Callable[[Any], bool],
        none: str | None = None,
        prefers: Callable[[Any], bool] | None = None,
    ) -> None:
        super().__init__()
        self._viewer = viewer
        self._accepts = accepts
        self._none = none
        self._prefers = prefers
        self._layers: list[Any] = []
        self._named: list[Any] = []
        # Long layer names must not widen the panel.
        self.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.setMinimumContentsLength(8)
        for event in (viewer.layers.events.inserted, viewer.layers.events.removed):
            event.connect(self.refresh)
        viewer.layers.events.reordered.connect(self.refresh)
        self.currentIndexChanged.connect(lambda _: self.chosen.emit())
        self.refresh()

    @property
    def layer(self) -> Any:
        """The chosen layer, or None."""
        index = self.currentIndex() - (self._none is not None)
        return self._layers[index] if 0 <= index < len(self._layers) else None

    def choose(self, layer: Any) -> None:
        """Choose a listed layer; one that is not listed, or None, means the first entry."""
        position = next((k for k, each in enumerate(self._layers) if each == layer), None)
        first = 0 if self.count() else -1
        self.setCurrentIndex(first if position is None else position + (self._none is not None))

    def refresh(self, _event: Any = None) -> None:
        """List the viewer's layers anew, keeping the choice where it is still there."""
        kept = self.layer
        self._unlink()
        self._layers = [plain(layer) for layer in self._viewer.layers if self._accepts(layer)]
        blocked = self.blockSignals(True)
        self.clear()
        if self._none is not None:
            self.addItem(self._none)
        self.addItems([str(layer.name) for layer in self._layers])
        self.choose(kept if kept in self._layers else self._first_choice())
        self.blockSignals(blocked)
        for layer in self._layers:
            layer.events.name.connect(self.refresh)
            self._named.append(layer)
        if self.layer is not kept:
            self.chosen.emit()

    def _first_choice(self) -> Any:
        if self._none is not None or self._prefers is None:
            return None
        return next(filter(self._prefers, self._layers), None)

    def close_links(self) -> None:
        """Stop listening to the viewer."""
        self._unlink()
        for event in ("inserted", "removed", "reordered"):
            getattr(self._viewer.layers.events, event).disconnect(self.refresh)

    def _unlink(self) -> None:
        for layer in self._named:
            layer.events.name.disconnect(self.refresh)
        self._named.clear()


def plain(layer: Any) -> Any:
    """Return the layer itself where the viewer's public proxy handed out a proxy of it."""
    return getattr(layer, "__wrapped__", layer)


def is_users(layer: Any) -> bool:
    """Tell the user's own layers from those of our stage."""
    return not type(plain(layer)).__module__.startswith("napari_unpack")
