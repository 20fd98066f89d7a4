"""The user's own volumes while the stage is on: out of the way in 3D, as they were in slices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from napari.layers import Image, Labels


class OwnVolumes:
    """Images and Labels of a viewer, which napari would draw through the bag's picture in 3D.

    Parameters
    ----------
    viewer : napari.Viewer
        Whose volumes are hidden from now on, unless it shows slices.
    sources : sequence of napari layers
        What the stage was opened from, of whatever kind; slices show them where none was shown.
    """

    def __init__(self, viewer: Any, sources: Sequence[Any]) -> None:
        self._viewer = viewer
        layers = dict.fromkeys((*sources, *filter(_is_volume, viewer.layers)))
        self._before = {layer: bool(layer.visible) for layer in layers}
        self._in_slices = dict(self._before)
        if not any(self._before[layer] for layer in sources):
            self._in_slices |= dict.fromkeys(sources, True)
        self._sliced = False
        self._show(dict.fromkeys(layers, False))
        viewer.dims.events.ndisplay.connect(self._follow)

    def let_go(self) -> None:
        """Follow the viewer no more."""
        self._viewer.dims.events.ndisplay.disconnect(self._follow)

    def give_back(self) -> None:
        """Show what was shown before; layers that are gone by now are left out."""
        self._show(self._before)

    def _follow(self, _event: Any = None) -> None:
        sliced = self._viewer.dims.ndisplay == 2
        if sliced == self._sliced:
            return
        self._sliced = sliced
        if sliced:
            self._show(self._in_slices)
        else:
            self._in_slices = {layer: bool(layer.visible) for layer in self._in_slices}
            self._show(dict.fromkeys(self._in_slices, False))

    def _show(self, shown: dict[Any, bool]) -> None:
        for layer, visible in shown.items():
            if layer in self._viewer.layers:
                layer.visible = visible


def _is_volume(layer: Any) -> bool:
    return isinstance(layer, Image | Labels) and layer.ndim > 2
