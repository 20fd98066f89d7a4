"""What a controller borrows from a viewer, and gives back exactly as it was."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from napari.layers import Image, Labels, Layer

from napari_unpack.geometry.axes import Matrix, transform_points

if TYPE_CHECKING:
    import napari
    from napari.components import Camera, LayerList


def to_the_end(*steps: Callable[[], Any]) -> None:
    """Take all steps in turn, also those after one that fails; errors are raised at the end.

    Parameters
    ----------
    *steps : callable
        Any may fail: events of napari's and of sessions call other plugins and scripts.
    """
    with ExitStack() as stack:
        for step in reversed(steps):
            stack.callback(step)


class HiddenVolumes:
    """Images and Labels of a viewer, which napari would draw through the bag's image in 3D.

    Parameters
    ----------
    viewer : napari.Viewer
        Its volumes are hidden from now on, unless it shows slices.
    sources : sequence of napari layers
        What the controller was opened from, of whatever kind; slices show them where none was
        shown.
    packed : napari layer
        Of the controller: made active in 3D in place of a hidden one.
    """

    def __init__(self, viewer: napari.Viewer, sources: Sequence[Layer], packed: Layer) -> None:
        self._viewer, self._packed = viewer, packed
        layers = dict.fromkeys((*sources, *filter(_is_volume, viewer.layers)))
        self._before = {layer: bool(layer.visible) for layer in layers}
        self._in_slices = dict(self._before)
        # Empty slices would look like a fault.
        if not any(self._before[layer] for layer in sources):
            self._in_slices |= dict.fromkeys(sources, True)
        self._sliced, self._active = False, packed
        self._show(dict.fromkeys(layers, False))
        viewer.dims.events.ndisplay.connect(self._follow)

    def close(self) -> None:
        """Follow the viewer no more."""
        self._viewer.dims.events.ndisplay.disconnect(self._follow)

    def give_back(self) -> None:
        """Show what was shown before; layers that are gone by now are left out."""
        self._show(self._before)

    def _follow(self, _event: Any = None) -> None:
        sliced = self._viewer.dims.ndisplay == 2
        # napari tells of every change of its dims, also of none.
        if sliced == self._sliced:
            return
        self._sliced = sliced
        selection = self._viewer.layers.selection
        if sliced:
            active = selection.active
            self._active = self._packed if active in {*self._in_slices, None} else active
            # An eye that was opened in 3D stays open.
            self._in_slices = {x: old or bool(x.visible) for x, old in self._in_slices.items()}
            self._show(self._in_slices)
        else:
            # What the user switched on and off in slices holds when they come back.
            self._in_slices = {layer: bool(layer.visible) for layer in self._in_slices}
            self._show(dict.fromkeys(self._in_slices, False))
            # The active layer gets the keys: Ctrl+Z would take a stroke out of labels unseen.
            if selection.active in self._in_slices:
                there = self._active in self._viewer.layers
                selection.active = self._active if there else self._packed

    def _show(self, shown: Mapping[Layer, bool]) -> None:
        there = self._viewer.layers
        steps = (partial(setattr, x, "visible", on) for x, on in shown.items() if x in there)
        to_the_end(*steps)


def _is_volume(layer: Layer) -> bool:
    return isinstance(layer, Image | Labels) and layer.ndim > 2


@dataclass(frozen=True)
class SavedView:
    """How a napari camera looks.

    Parameters
    ----------
    center, zoom, angles, perspective
        As napari's camera has them.
    """

    center: tuple[float, float, float] | tuple[float, float]
    zoom: float
    angles: tuple[float, float, float]
    perspective: float

    @classmethod
    def of(cls, camera: Camera) -> SavedView:
        """Return how a camera looks now."""
        return cls(camera.center, camera.zoom, camera.angles, camera.perspective)

    def moved(self, new_from_old: Matrix) -> SavedView:
        """Return what shows the same where all has moved and grown.

        Parameters
        ----------
        new_from_old : (4, 4) ndarray of float64
            Of points as napari's camera has them.
        """
        center = transform_points(new_from_old, np.array([0.0, *self.center])[-3:])
        grown = abs(float(np.linalg.det(new_from_old[:3, :3]))) ** (1 / 3)
        z, y, x = center.tolist()
        return replace(self, center=(z, y, x), zoom=self.zoom / grown)

    def give_back(self, camera: Camera) -> None:
        """Have a camera look so again."""
        camera.update(vars(self))


@dataclass(frozen=True, eq=False)
class SavedViewerState:
    """State of a viewer before a session was opened on it.

    Parameters
    ----------
    volumes : HiddenVolumes
    selection : tuple of layers
        What was selected.
    active : layer or None
        The active layer.
    ndisplay : int
        Dimensions displayed.
    order : tuple of int
        Of the last three axes; in the end it stays as a person has set it.
    view : SavedView
    orientation : tuple of str
        Of the camera's axes.
    background : object
        The canvas's own background colour, or None for the theme's.
    scale_bar : dict
        Fields of the scale bar.
    """

    volumes: HiddenVolumes
    selection: tuple[Layer, ...]
    active: Layer | None
    ndisplay: int
    order: tuple[int, ...]
    view: SavedView
    orientation: Any
    background: Any
    scale_bar: dict[str, Any]

    @classmethod
    def from_viewer(
        cls, viewer: napari.Viewer, sources: Sequence[Layer], packed: Layer
    ) -> SavedViewerState:
        """Write down how a viewer is, and hide its volumes.

        Parameters
        ----------
        viewer, sources, packed : see `HiddenVolumes`
        """
        selection, camera = viewer.layers.selection, viewer.scene.camera
        bar = viewer.canvas.overlays.scale_bar
        return cls(
            volumes=HiddenVolumes(viewer, sources, packed),
            selection=tuple(selection),
            active=selection.active,
            ndisplay=int(viewer.dims.ndisplay),
            order=_order(viewer),
            view=SavedView.of(camera),
            orientation=camera.orientation,
            background=viewer.canvas.background_color_override,
            scale_bar={"visible": bar.visible, "colored": bar.colored, "color": bar.color},
        )

    def give_back(self, viewer: napari.Viewer) -> None:
        """Make the viewer as it was; layers that are gone by now are left out."""
        camera = viewer.scene.camera
        to_the_end(
            self.volumes.close,
            partial(setattr, viewer.canvas, "background_color_override", self.background),
            partial(viewer.canvas.overlays.scale_bar.update, self.scale_bar),
            # Before the camera: napari fits the view anew when the dimensions change, and goes to
            # the slice in the middle of the bag.
            partial(setattr, viewer.dims, "ndisplay", self.ndisplay),
            partial(setattr, viewer.dims, "point", viewer.dims.point),
            partial(setattr, camera, "orientation", self.orientation),
            partial(self.view.give_back, camera),
            # By other axes the same numbers are another place.
            *([] if _order(viewer) == self.order else [viewer.fit_to_view]),
            # Only now: slices that are looked at need not wait for a volume in 3D.
            self.volumes.give_back,
            partial(self._select, viewer.layers),
        )

    def _select(self, layers: LayerList) -> None:
        selection = layers.selection
        selection.clear()
        selection.update(x for x in self.selection if x in layers)
        # Making a layer active deselects the others.
        if self.active is not None and self.active in layers:
            selection.active = self.active
            selection.update(x for x in self.selection if x in layers)


def _order(viewer: napari.Viewer) -> tuple[int, ...]:
    """Return z, y, x (0, 1, 2) in the viewer's order, whatever axes stand before them."""
    dims = viewer.dims
    axes = [int(axis) - dims.ndim + 3 for axis in dims.order[-3:]]
    # A viewer of pictures alone has no z yet.
    return (*range(3 - len(axes)), *axes)
