"""The ground of a session: the bag, the camera, the situation, flights, undo."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.appearance import TransferFunction, golden_hue
from napari_unpack.appearance.tints import Mode
from napari_unpack.geometry.axes import checked_spacing
from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.geometry.transforms import Pose
from napari_unpack.geometry.view import Camera, View
from napari_unpack.session.asking import Casters, imaging_casters
from napari_unpack.session.events import SessionEvents
from napari_unpack.session.history import History, Step
from napari_unpack.session.labels import LabelData, object_table, touched_between
from napari_unpack.session.placement import Bag, launch
from napari_unpack.session.state import ObjectState, Placement, SessionState
from napari_unpack.session.validation import (
    checked_labels,
    checked_planes,
    checked_volume,
)
from napari_unpack.unpacking import Flight, Slots, arrange

if TYPE_CHECKING:
    import pandas as pd


class SessionCore:
    """What a session knows, and how it passes from one situation to the next.

    Parameters
    ----------
    volume : (Z, Y, X) array_like
        Density of any real dtype.
    labels : (Z, Y, X) array_like of int
        Object IDs, 0 background, of at most 65,535 objects. Where one is above 65,535 the
        session numbers the objects anew; `label_of` gives the ID of old.
    spacing : (3,) array_like
        Voxel size in mm, z y x.
    objects : DataFrame, optional
        Facts by ID; completed with what is missing.
    casters : Casters, optional
        The ray casting passes, by default those of `rendering`.
    clock : callable, optional
        Returns the time in seconds by which flights go.

    Attributes
    ----------
    animated : bool
        False: verbs finish at once. True: objects fly until `land`.
    seconds : float
        What one flight takes.
    backend : {"auto", "cpu", "gl"}
        Who casts rays for this session's questions.
    tint_mode : {"perceptual", "safe", "hsv"}
        How hues become tints; "hsv" is the paper's, "safe" for who confuses red and green.

    Raises
    ------
    TypeError
        If volume or labels hold no numbers of the right kind.
    ValueError
        If the volume is not 3D, empty, constant or without finite values, the labels have
        another shape or no object, or the spacing is not positive.
    """

    def __init__(
        self,
        volume: ArrayLike,
        labels: ArrayLike,
        spacing: ArrayLike = (1.0, 1.0, 1.0),
        objects: pd.DataFrame | None = None,
        casters: Casters | None = None,
        clock: Callable[[], float] = perf_counter,
    ) -> None:
        self.volume = checked_volume(volume)
        checked, self._given_ids = checked_labels(labels, self.volume.shape)
        self.spacing = checked_spacing(spacing)
        boxes = label_boxes(checked)
        facts = object_table(self.volume, checked, boxes, self.spacing, objects, self._given_ids)
        self._given_casters = casters
        self.clock = clock
        self.animated = False
        self.seconds = 1.2
        self.backend = "auto"
        self._tint_mode: Mode = "perceptual"
        self._show_unlabelled = False
        self._clipping = checked_planes(None)
        self.events = SessionEvents()
        # Tables by ID and slots grow with the labels and never shrink: a worker may still cast
        # labels that have been repaired since.
        self._top, self._most = 0, 0
        self._hold(LabelData(checked, boxes, facts))
        self._situation = SessionState(
            TransferFunction.default_for(self.volume), {i: golden_hue(i) for i in self._ids}
        )
        self._prepared: LabelData | None = None
        self._edition = 0
        self._history = History()
        self._flights: dict[int, Flight] = {}
        self._selected: frozenset[int] = frozenset()
        self._canvas_size = (768, 1024)
        self._view = View()
        self._camera = self._view.camera(self.labels.shape, self.spacing)
        # What is derived is kept with the count of changes it was made at: workers ask for it
        # too, and one overtaken by a change must leave nothing stale behind.
        self._changes = 0
        self._states: tuple[int, dict[int, ObjectState]] = (-1, {})
        self._tints: tuple[int, NDArray[np.float32]] = (-1, np.zeros((0, 4), np.float32))
        self._tints_alone: tuple[int, dict[int, NDArray[np.float32]]] = (-1, {})
        self._slots: tuple[object, Slots] | None = None

    def _hold(self, contents: LabelData) -> None:
        """Take over labels, and all that follows from them."""
        self._contents = contents
        self.labels, self.boxes, self._facts = contents.labels, contents.boxes, contents.facts
        self.bag = Bag(self.labels, self.boxes, self.spacing)
        self.casters = self._given_casters or imaging_casters(
            self.labels, self.spacing, lambda: self.backend, lambda: self._clipping
        )
        self._ids = tuple(int(i) for i in self.boxes.ids)
        self._known = frozenset(self._ids)
        self._top = max(self._top, self._ids[-1])
        self._most = max(self._most, len(self._ids))

    @property
    def display_labels(self) -> NDArray[np.uint16]:
        """Labels grown into the fringe around objects, for pictures; (Z, Y, X) uint16."""
        return self._contents.display

    @property
    def ids(self) -> tuple[int, ...]:
        """Every object, ascending."""
        return self._ids

    def label_of(self, object_id: int) -> int:
        """Return the ID an object has in the labels as given: what people are shown."""
        return object_id if self._given_ids is None else int(self._given_ids[object_id])

    @property
    def objects(self) -> pd.DataFrame:
        """Facts by ID, with the names people gave; a copy."""
        table = self._facts.copy()
        names = self._situation.names
        if names:
            table.loc[list(names), "name"] = list(names.values())
        return table

    @property
    def states(self) -> dict[int, ObjectState]:
        """Where every object is, by ID; treat as read-only."""
        now, kept = self._changes, self._states
        if kept[0] != now:
            kept = self._states = now, {i: self._state(i) for i in self._ids}
        return kept[1]

    @property
    def flights(self) -> Mapping[int, Flight]:
        """Flights in the air, by ID."""
        return self._flights

    @property
    def poses(self) -> dict[int, Pose]:
        """Poses in pivot space of unpacked objects that are in sight and not in the air."""
        slots = self.slots
        return {
            i: placement.pose(slots, self._camera.stretch)
            for i, placement in self._situation.out.items()
            if i not in self._flights and i not in self._situation.hidden
        }

    @property
    def hues(self) -> dict[int, float]:
        """Hue in [0, 1) by ID; a copy."""
        return dict(self._situation.hues)

    @property
    def view(self) -> View:
        """The view as it was asked for."""
        return self._view

    @view.setter
    def view(self, view: View) -> None:
        if not isinstance(view, View):
            raise TypeError(f"view must be a View, got {view!r}")
        self._camera = view.camera(self.labels.shape, self.spacing, self._camera.stretch)
        self._view = view
        self.events.view.emit(self._camera)

    @property
    def camera(self) -> Camera:
        """The view with nothing left open."""
        return self._camera

    def look(self, camera: Camera) -> None:
        """Take over a camera from whoever draws."""
        if np.linalg.det(camera.stretch @ self._camera.stretch) < 0:
            out = {i: placement.mirrored() for i, placement in self._situation.out.items()}
            self._situation = replace(self._situation, out=out)
        self._camera = camera
        z, y, x = (float(v) for v in camera.center)
        self._view = View(
            _triple(camera.direction), _triple(camera.up), (z, y, x), camera.height, camera.fov
        )
        self.events.view.emit(camera)

    def overview(self) -> Camera:
        """Return the camera turned as now that holds the bag and all slots beside it.

        The slots stand clear of the bag at every turn about this camera's centre.
        """
        camera = self._camera
        return replace(camera, center=self.bag.center, height=self.slots.height_mm)

    @property
    def canvas_size(self) -> tuple[int, int]:
        """Height and width of the window in pixels; slots are planned for it."""
        return self._canvas_size

    @canvas_size.setter
    def canvas_size(self, size: Sequence[int]) -> None:
        height, width = (int(v) for v in size)
        if min(height, width) < 1:
            raise ValueError(f"canvas_size must be at least (1, 1) pixels, got {size!r}")
        if (height, width) == self._canvas_size:
            return
        self._canvas_size = height, width
        for i, placement in self._situation.out.items():
            if i in self._flights:
                self._flights[i] = self._flights[i].toward(self._pose(placement))
        self._tell_states(self._situation.out)

    @property
    def slots(self) -> Slots:
        """Where unpacked objects wait, planned for all of them at once."""
        radius = self.bag.radius_in(self._camera.stretch)
        key = (self._canvas_size, self._camera.fov, self._most, radius)
        if self._slots is None or self._slots[0] != key:
            self._slots = key, arrange(self._most, radius, self._canvas_size, self._camera.fov)
        return self._slots[1]

    @property
    def history(self) -> History:
        """Steps done and undone."""
        return self._history

    def undo(self) -> str | None:
        """Take back the last step; return what it was, None where there was none."""
        return self._travel(self._history.undo(self._situation), "undo")

    def redo(self) -> str | None:
        """Do the step last taken back again; return what it was, None where there was none."""
        return self._travel(self._history.redo(self._situation), "redo")

    def land(self, object_id: int) -> None:
        """End a flight: the object is where it was going. Does nothing where there is none."""
        if self._flights.pop(object_id, None) is not None:
            self._tell_states([object_id])

    def _travel(self, found: tuple[Step, SessionState] | None, way: str) -> str | None:
        if found is None:
            self.events.message.emit(f"There is nothing to {way}.")
            return None
        step, situation = found
        self._enter(replace(situation, inspected=None))
        return step.verb

    def _do(self, verb: str, situation: SessionState, merge: bool = False) -> None:
        """Enter a situation by a command that can be undone.

        Looking at an object alone is no part of it: like turning the bag it changes nothing.
        """
        before, after = (replace(s, inspected=None) for s in (self._situation, situation))
        self._history.push(Step(verb, before, after), merge)
        self._enter(situation)

    def _enter(self, situation: SessionState) -> None:
        """Pass to another situation: start flights, and tell what has changed."""
        before, states = self._situation, self.states
        self._situation = situation
        edited = self._follow_labels(before, situation)
        self._refly(before, situation)
        self._changes += 1
        changed = {i for i, state in self.states.items() if state is not states.get(i)}
        changed |= {
            i for i, placement in situation.out.items() if before.out.get(i) is not placement
        }
        changed |= {i for i, _ in situation.names.items() ^ before.names.items()}
        changed |= situation.good ^ before.good
        changed |= {i for i, _ in situation.studies.items() ^ before.studies.items()}
        if edited:
            self.events.labels.emit(edited)
            # Slots may have been planned anew.
            changed.update(situation.out, edited & self._known)
        if situation.hues is not before.hues:
            self.events.hues.emit(dict(situation.hues))
        if situation.transfer_function is not before.transfer_function:
            self.events.transfer_function.emit(situation.transfer_function)
        self._tell_states(changed)
        if situation.queue is not before.queue or situation.direction != before.direction:
            self.events.queue.emit(situation.queue.ids)

    def _follow_labels(self, before: SessionState, after: SessionState) -> frozenset[int]:
        """Make the labels those of a situation; return the objects touched."""
        if after.edit is before.edit:
            return frozenset()
        old, prepared = self._contents, self._prepared
        self._prepared = None
        fits = prepared is not None and prepared.edit is after.edit
        self._hold(prepared if fits and prepared is not None else old.at(after.edit))
        self._contents.keep(old)
        touched = touched_between(before.edit, after.edit)
        for i in touched:
            self._flights.pop(i, None)
        gone = self._selected - self._known
        if gone:
            self._selected -= gone
            self.events.selected.emit(self._selected)
        self._forget_answers()
        return touched

    def _forget_answers(self) -> None:
        """Forget what was found out about other labels."""
        self._edition += 1

    def _refly(self, before: SessionState, after: SessionState) -> None:
        for i in list(self._flights):
            if i in after.hidden or i == after.inspected:
                del self._flights[i]
        moved = [i for i in {**after.out, **before.out} if (i in before.out) != (i in after.out)]
        if not self.animated:
            for i in moved:
                self._flights.pop(i, None)
            return
        now = self.clock()
        starting: dict[bool, dict[int, Placement]] = {False: {}, True: {}}
        for i in moved:
            if i in before.hidden or i in after.hidden:
                continue
            back = i in before.out
            placement = (before if back else after).out[i]
            if i not in self._flights:
                starting[back][i] = placement
            elif self._flights[i].back != back:
                self._flights[i] = self._flights[i].reversed(now).toward(self._pose(placement))
        for back, placements in starting.items():
            order = reversed(list(placements.items())) if back else placements.items()
            stretch = self._camera.stretch
            flights = launch(self.bag, dict(order), self.slots, stretch, now, self.seconds, back)
            self._flights.update(flights)

    def _pose(self, placement: Placement) -> Pose:
        return placement.pose(self.slots, self._camera.stretch)

    def _state(self, object_id: int) -> ObjectState:
        flight = self._flights.get(object_id)
        if flight is None:
            return self._situation.state(object_id)
        return ObjectState.FLYING_BACK if flight.back else ObjectState.FLYING_OUT

    def _tell_states(self, ids: Iterable[int]) -> None:
        self._changes += 1
        changed = frozenset(ids)
        if changed:
            self.events.states.emit(changed)


def _triple(vector: NDArray[np.float64]) -> tuple[float, float, float]:
    z, y, x = (float(v) for v in vector)
    return z, y, x
