"""What the stage borrows from a viewer, and gives back exactly as it was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

CAMERA_FIELDS = ("center", "zoom", "angles", "perspective", "orientation")

SCALE_FIELDS = ("visible", "colored", "color")


@dataclass(frozen=True, eq=False)
class Borrowed:
    """State of a viewer before the stage.

    Parameters
    ----------
    visible : tuple of (layer, bool)
        The user's source layers and whether each was shown.
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

    visible: tuple[tuple[Any, bool], ...]
    selection: tuple[Any, ...]
    active: Any
    ndisplay: int
    camera: dict[str, Any]
    background: Any
    scale_bar: dict[str, Any]

    @classmethod
    def from_viewer(cls, viewer: Any, sources: Sequence[Any]) -> Borrowed:
        """Write down how a viewer is."""
        selection = viewer.layers.selection
        return cls(
            visible=tuple((layer, bool(layer.visible)) for layer in sources),
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
        for layer, visible in self.visible:
            if layer in viewer.layers:
                layer.visible = visible
        viewer.canvas.background_color_override = self.background
        viewer.canvas.overlays.scale_bar.update(self.scale_bar)
        viewer.dims.ndisplay = self.ndisplay
        viewer.scene.camera.update(self.camera)
        viewer.layers.selection.clear()
        viewer.layers.selection.update(x for x in self.selection if x in viewer.layers)
        if self.active is not None and self.active in viewer.layers:
            viewer.layers.selection.active = self.active
            viewer.layers.selection.update(x for x in self.selection if x in viewer.layers)
