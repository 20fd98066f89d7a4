"""Slices follow the session: its hues on the user's Labels layer, and the selected object."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from time import monotonic
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np
from napari.layers import Labels, Layer

from napari_unpack.appearance import tints_of
from napari_unpack.geometry.axes import transform_points
from napari_unpack.layers.label_colormap import LabelColormap, label_colormap
from napari_unpack.layers.placement import data_to_world, units_of

if TYPE_CHECKING:
    import napari

    from napari_unpack.session import Session


# The user's own and the last lent colormap of a layer; viewers that share a layer share these.
_LENT: WeakKeyDictionary[Layer, tuple[LabelColormap, LabelColormap]] = WeakKeyDictionary()


class SliceHues:
    """Lends a colormap to the layers the session's labels came from.

    Parameters
    ----------
    session : Session
        Whose hues.
    sources : sequence of napari layers
        The user's own that the session is of; of these, Labels of its shape are coloured.

    Attributes
    ----------
    painting : bool
        While the layers are given other colours, at which they raise the events of a brush.
    """

    def __init__(self, session: Session, sources: Sequence[Layer]) -> None:
        self._session = session
        self.painting = False
        # Not by its voxels: one stroke before the session is shown would make it another's.
        shape = session.labels.shape
        layers = (x for x in sources if isinstance(x, Labels) and x.data.shape == shape)
        self._brushes = {layer: layer.selected_label for layer in layers}
        if self._brushes:
            session.events.selected.connect(self._choose)

    def paint(self) -> None:
        """Colour the layers in the hues of now."""
        if not self._brushes:
            return
        session = self._session
        tints = tints_of(session.hues, session.ids[-1], mode=session.tint_mode)
        # Opacity as it was chosen: a slice has no depth in which it would add up.
        chosen = session.annotations.colors
        colors = {session.label_of(i): chosen.get(i, tints[i]) for i in session.ids}
        with self._own_work():
            for layer in self._brushes:
                own = own_colormap(layer)
                layer.colormap = label_colormap(colors, np.zeros(4, np.float32))
                _LENT[layer] = own, layer.colormap

    def close(self) -> None:
        """Give every layer its own colormap back."""
        self._session.events.selected.disconnect(self._choose, missing_ok=True)
        with self._own_work():
            for layer, brush in self._brushes.items():
                colormap = own_colormap(layer)
                _LENT.pop(layer, None)
                # A layer made uint8 meanwhile has no label 300 any more.
                if brush > np.iinfo(layer.data.dtype).max:
                    brush = colormap.selection = layer.selected_label
                layer.colormap, layer.selected_label = colormap, brush
        self._brushes = {}

    @contextmanager
    def _own_work(self) -> Generator[None, None, None]:
        self.painting = True
        try:
            yield
        finally:
            self.painting = False

    def _choose(self, ids: frozenset[int]) -> None:
        # With several selected the brush keeps what the user gave it.
        if len(ids) == 1:
            with self._own_work():
                for layer in self._brushes:
                    layer.selected_label = self._session.label_of(next(iter(ids)))


def own_colormap(layer: Labels) -> LabelColormap:
    """Return the colormap a layer has, or has when no session lends it one any more."""
    own, lent = _LENT.get(layer, (None, None))
    # Any other was chosen since.
    return layer.colormap if own is None or layer.colormap is not lent else own


# So long after the user's last scroll the slices are theirs: a hand turns the wheel on.
SCROLL_SECONDS = 0.4


class SliceSteps:
    """Moves the viewer's slices to the object that has become the selected one.

    Parameters
    ----------
    viewer : napari.Viewer
    session : Session
        Whose selection.
    layer : napari layer
        One of ours, which knows how voxels lie in napari's world.

    Attributes
    ----------
    clock : callable
        Returns the time, s.

    Notes
    -----
    In 3D nothing moves, since napari would slice every visible layer anew for nothing; the
    slices go there when 2D is next looked at, and else are where they were: napari would have
    them in the middle of its camera, which is the bag's.
    """

    def __init__(self, viewer: napari.Viewer, session: Session, layer: Layer) -> None:
        self._viewer, self._session, self._layer = viewer, session, layer
        self.clock: Callable[[], float] = monotonic
        self._held = self._moving = False
        self._pending = 0
        self._scrolled = -np.inf
        # Where the slices were when 3D was last looked at; None in 2D.
        self._point: tuple[float, ...] | None = viewer.dims.point
        self._known: frozenset[int] = frozenset(session.selected)
        session.events.selected.connect(self._follow)
        viewer.dims.events.ndisplay.connect(self._catch_up)
        viewer.dims.events.current_step.connect(self._hear)

    def close(self) -> None:
        """Move nothing more."""
        self._session.events.selected.disconnect(self._follow, missing_ok=True)
        self._viewer.dims.events.ndisplay.disconnect(self._catch_up)
        self._viewer.dims.events.current_step.disconnect(self._hear)

    @contextmanager
    def held(self) -> Generator[None, None, None]:
        """Keep the slice meanwhile: what is selected was clicked in it."""
        before, self._held = self._held, True
        try:
            yield
        finally:
            self._held = before

    def _follow(self, ids: frozenset[int]) -> None:
        changed, self._known = ids != self._known, frozenset(ids)
        if not changed:
            return
        self._pending = next(iter(ids)) if len(ids) == 1 and not self._held else 0
        scrolling = self.clock() - self._scrolled < SCROLL_SECONDS
        # What the user scrolls to stays.
        if self._viewer.dims.ndisplay == 2 and scrolling:
            self._pending = 0
        self._catch_up()

    def _catch_up(self, _event: Any = None) -> None:
        dims = self._viewer.dims
        if dims.ndisplay != 2:
            self._point = dims.point
            return
        point, self._point = self._of_pending() or self._point, None
        if point is None:
            return
        # Our own step is no scroll of the user.
        self._moving = True
        try:
            dims.point = point
        finally:
            self._moving = False

    def _of_pending(self) -> tuple[float, ...] | None:
        object_id, self._pending = self._pending, 0
        point = self._viewer.dims.point
        if object_id not in self._session.states or len(point) < 3:
            return None
        boxes = self._session.boxes
        row = boxes.index(object_id)
        # Of the box, which the slice through it always meets.
        middle = (boxes.lower[row] + boxes.upper[row] - 1) // 2
        world = transform_points(data_to_world(self._layer, units_of(self._viewer)), middle)
        return (*point[:-3], *world.tolist())

    def _hear(self, _event: Any = None) -> None:
        if not self._moving:
            self._scrolled = self.clock()
        if self._viewer.dims.ndisplay == 3:
            self._point = self._viewer.dims.point
