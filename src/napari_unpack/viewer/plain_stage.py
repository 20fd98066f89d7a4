"""A session on a viewer whose napari cannot show our layers: one Labels layer in our hues."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from napari.layers import Labels
from napari.utils.colormaps import DirectLabelColormap

from napari_unpack.geometry.axes import Matrix
from napari_unpack.geometry.view import Camera
from napari_unpack.layers import compat
from napari_unpack.layers.placement import napari_from_world, placement_of, units_of
from napari_unpack.layers.view_camera import camera_in_session
from napari_unpack.viewer import controller
from napari_unpack.viewer.background_queries import AtRest
from napari_unpack.viewer.canvas_backend import BACKENDS
from napari_unpack.viewer.controller import ControllerEvents, SessionController
from napari_unpack.viewer.jobs import Jobs
from napari_unpack.viewer.viewer_state import SavedViewerState

OPACITY = 0.9


class PlainStage:
    """What a `SessionController` does, without flights, sprites and inspection.

    Parameters
    ----------
    viewer, session, sources
        As for `SessionController`.

    Notes
    -----
    Touches public napari alone. Packed objects show in their hues, all others are transparent;
    nothing of the labels is edited.
    """

    inspected = 0
    flying = False
    casts_with = "cpu"

    def __init__(self, viewer: Any, session: Any, sources: Sequence[Any] = ()) -> None:
        self.viewer = compat.unwrap(viewer)
        self.session = session
        self.sources = tuple(compat.unwrap(layer) for layer in sources)
        self.recolor_at_rest = True
        self.seconds = float(session.seconds)
        self.events = ControllerEvents()
        self._backend = "auto"
        self._borrowed: SavedViewerState | None = None
        self._before = "auto"
        spacing = np.asarray(session.spacing, dtype=np.float64)
        self.packed = Labels(
            session.labels, name="Packed", opacity=OPACITY, **placement_of(self.sources, spacing)
        )
        self.packed.spacing = spacing
        self.packed.editable = False
        self._jobs = Jobs(("rest", "queue"), self.events.message.emit)
        self._at_rest = AtRest(session, self._jobs, lambda: self.recolor_at_rest, lambda: None)

    @property
    def layers(self) -> tuple[Labels]:
        """The one layer."""
        return (self.packed,)

    @property
    def is_open(self) -> bool:
        """Whether the stage is on."""
        return self._borrowed is not None

    @property
    def backend(self) -> str:
        """Who would cast; napari draws everything here."""
        return self._backend

    @backend.setter
    def backend(self, backend: str) -> None:
        if backend not in BACKENDS:
            raise ValueError(f'backend must be "auto", "cpu" or "gl", got {backend!r}')
        self._backend = backend

    def open(self) -> None:
        """Put the session on the viewer, and say what is missing."""
        if self.is_open:
            return
        viewer = self.viewer
        self._borrowed = SavedViewerState.from_viewer(viewer, self.sources)
        # The session's questions are answered in threads, where GL has no context.
        self._before, self.session.backend = self.session.backend, "cpu"
        viewer.dims.ndisplay = 3
        viewer.add_layer(self.packed)
        for signal, slot in self._wires():
            signal.connect(slot)
        viewer.layers.events.removed.connect(self._on_removed)
        viewer.scene.camera.events.connect(self._moved)
        controller.look_through(viewer, self.session, self.packed)
        self._paint()
        self._moved()
        self.events.message.emit(
            f"{compat.problem()} Objects are shown as a Labels layer, without flights and sprites."
        )

    def close(self) -> None:
        """Take the session off the viewer and make everything as it was; once is enough."""
        if self._borrowed is None:
            return
        borrowed, self._borrowed = self._borrowed, None
        for signal, slot in self._wires():
            signal.disconnect(slot, missing_ok=True)
        self.viewer.layers.events.removed.disconnect(self._on_removed)
        self.viewer.scene.camera.events.disconnect(self._moved)
        self._at_rest.close()
        self._jobs.close()
        self.session.backend = self._before
        if self.packed in self.viewer.layers:
            self.viewer.layers.remove(self.packed)
        borrowed.give_back(self.viewer)
        self.events.closed.emit()

    def unpack(self, n_or_ids: int | Iterable[int] = 1) -> Any:
        """Take free objects out, or these; see `Session.unpack`."""
        wanted = int(n_or_ids) if isinstance(n_or_ids, int | np.integer) else tuple(n_or_ids)
        controller.know_who_leaves(self.session, self._jobs, wanted, self.events.looking.emit)
        return self.session.unpack(wanted)

    def restore(self, n_or_ids: int | Iterable[int] = 1) -> Any:
        """Put the latest back, or these; see `Session.restore`."""
        return self.session.restore(n_or_ids)

    def reveal(self, object_id: int, direction: Any = None) -> Any:
        """Take out what frees a buried object, and it as well; see `Session.reveal`."""
        return self.session.reveal(object_id, direction)

    def inspect(self, object_id: int) -> None:
        """Select an object, which is all that can be shown of it here."""
        self.session.select([object_id])

    def leave(self) -> None:
        """Do nothing: there is no inspection here."""

    def put_back(self) -> None:
        """End an inspection."""
        self.session.leave()

    def rotation_of(self, _object_id: int) -> Matrix:
        """Return how an object is held: as the bag is."""
        rotation: Matrix = self.session.camera.rotation
        return rotation

    def go_to(self, step: int, flying: bool = False) -> int:
        """Run the unpacking to a step; see `Session.go_to`."""
        return int(self.session.go_to(step))

    def undo(self) -> Any:
        """Take back the last step."""
        return controller.travel(self.session, self._jobs, "undo")

    def redo(self) -> Any:
        """Do the step taken back again."""
        return controller.travel(self.session, self._jobs, "redo")

    def look_from(self, camera: Camera) -> None:
        """Set the viewer's camera to one of the session's."""
        controller.point_camera(self.viewer, self.packed, camera)

    def finish(self) -> None:
        """Do nothing: there are no flights here."""

    def frame_bag(self) -> None:
        """Show the whole bag."""
        self.viewer.reset_view()

    def settle(self, seconds: float = 10.0) -> bool:
        """Wait, handling events, until hues and queue are known; return whether they are."""
        return controller.wait_until(
            lambda: not (self._jobs.busy or self._at_rest.waiting), seconds
        )

    def _wires(self) -> list[tuple[Any, Any]]:
        events = self.session.events
        return [
            (events.labels, self._on_labels),
            (events.states, self._on_states),
            (events.hues, self._paint),
            (events.selected, self._mark),
        ]

    def _on_labels(self) -> None:
        self.packed.data = self.session.labels
        self._on_states()

    def _on_states(self) -> None:
        self._paint()
        self._at_rest.moved()

    def _on_removed(self, event: Any) -> None:
        if event.value is self.packed:
            self.close()

    def _paint(self) -> None:
        """Give the layer the session's hues; what is not packed becomes transparent."""
        tints = self.session.packed_tints()
        colors: dict[int | None, Any] = {None: np.zeros(4, np.float32)}
        colors |= {int(i): tints[i] for i in np.flatnonzero(tints[:, 3] > 0) if i}
        self.packed.colormap = DirectLabelColormap(color_dict=colors)

    def _mark(self) -> None:
        for object_id in self.session.selected:
            self.packed.selected_label = object_id

    def _moved(self, _event: Any = None) -> None:
        """Tell the session where the viewer looks from, which hues and queue depend on."""
        seen = self.viewer.scene.camera
        camera = Camera.looking(
            seen.view_direction,
            seen.up_direction,
            seen.center,
            self.viewer.canvas.size[0] / seen.zoom,
            float(seen.perspective),
        )
        world = napari_from_world(self.packed, units_of(self.viewer))
        self.session.look(camera_in_session(camera, world))
        self._at_rest.moved()


def controller_class() -> type[SessionController] | type[PlainStage]:
    """Return the stage that this napari can show."""
    return SessionController if compat.supported() else PlainStage
