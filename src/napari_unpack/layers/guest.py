"""What the stage borrows from a viewer, and gives back exactly as it was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from napari_unpack.layers.own_volumes import OwnVolumes

CAMERA_FIELDS = ("center", "zoom", "angles", "perspective", "orientation")

SCALE_FIELDS = ("visible", "colored", "color")


@dataclass(frozen=True, eq=False)
class Borrowed:
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
    def from_viewer(cls, viewer: Any, sources: Sequence[Any]) -> Borrowed:
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
