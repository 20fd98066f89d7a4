"""What the stage borrows from a viewer, and gives back exactly as it was.

The user's own volumes while the stage is on: out of the way in 3D, as they were in slices.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
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


CAMERA_FIELDS = ("center", "zoom", "angles", "perspective", "orientation")

SCALE_FIELDS = ("visible", "colored", "color")


@dataclass(frozen=True, eq=False)
class SavedViewerState:
    """State of a viewer before the stage.

    Parameters
    ----------
    volumes : OwnVolumes
        The user's volumes, hidden where they would cover the stage.
    selection : tuple of layers
        What was selected.
    active : layer or None
        The active layer.
    ndisplay : int
        Dimensions displayed.
    camera : dict
        Fields of the camera.
    background : object
        The canvas's own background colour, or None for the theme's.
    scale_bar : dict
        Fields of the scale bar.
    """

    volumes: OwnVolumes
    selection: tuple[Any, ...]
    active: Any
    ndisplay: int
    camera: dict[str, Any]
    background: Any
    scale_bar: dict[str, Any]

    @classmethod
    def from_viewer(cls, viewer: Any, sources: Sequence[Any]) -> SavedViewerState:
        """Write down how a viewer is, and hide its volumes."""
        selection = viewer.layers.selection
        return cls(
            volumes=OwnVolumes(viewer, sources),
            selection=tuple(selection),
            active=selection.active,
            ndisplay=int(viewer.dims.ndisplay),
            camera={name: getattr(viewer.scene.camera, name) for name in CAMERA_FIELDS},
            background=viewer.canvas.background_color_override,
            scale_bar={
                name: getattr(viewer.canvas.overlays.scale_bar, name) for name in SCALE_FIELDS
            },
        )

    def give_back(self, viewer: Any) -> None:
        """Make the viewer as it was; layers that are gone by now are left out."""
        self.volumes.let_go()
        viewer.canvas.background_color_override = self.background
        viewer.canvas.overlays.scale_bar.update(self.scale_bar)
        viewer.dims.ndisplay = self.ndisplay
        viewer.scene.camera.update(self.camera)
        # Only now: who looked at slices need not wait for a volume in 3D.
        self.volumes.give_back()
        viewer.layers.selection.clear()
        viewer.layers.selection.update(x for x in self.selection if x in viewer.layers)
        if self.active is not None and self.active in viewer.layers:
            viewer.layers.selection.active = self.active
            viewer.layers.selection.update(x for x in self.selection if x in viewer.layers)
