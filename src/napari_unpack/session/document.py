"""The parts of a session, and how one state becomes another: commit, enter, undo, and the log."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.appearance import Decorations
from napari_unpack.appearance.tints import Mode
from napari_unpack.geometry.axes import Matrix, Vector, is_integer
from napari_unpack.geometry.length_unit import LengthUnit
from napari_unpack.geometry.transforms import Pose, checked_place
from napari_unpack.geometry.view import Camera, View
from napari_unpack.rendering.validation import MOST_PLANES
from napari_unpack.session import commands
from napari_unpack.session.bag_cut import Cut, without
from napari_unpack.session.commands import RemovalPlan
from napari_unpack.session.errors import listed
from napari_unpack.session.events import LogEntry, SessionEvents
from napari_unpack.session.flights import FlightControl
from napari_unpack.session.history import History, Step
from napari_unpack.session.labels import LabelData, touched_between
from napari_unpack.session.placement import Bag
from napari_unpack.session.queries import Queries
from napari_unpack.session.ray_queries import RayQueries, RenderingQueries
from napari_unpack.session.state import Placement, SessionState, UnpackingRules, ViewState
from napari_unpack.session.validation import (
    checked_array,
    checked_count,
    checked_id,
    checked_ids,
    checked_kind,
    checked_planes,
    checked_size,
)

if TYPE_CHECKING:
    import pandas as pd


class Document:
    """What a session holds; it alone exchanges one state for another.

    Parameters
    ----------
    volume : (Z, Y, X) ndarray
        Density.
    spacing : (3,) ndarray of float64
        Voxel size in mm, z y x.
    label_data : LabelData
    state : SessionState
    view_state : ViewState
    rules : UnpackingRules
    rays : RayQueries, optional
        By default `rendering`'s, others for each revision of the labels.
    clock : callable
        Returns the time in seconds by which flights go.
    """

    def __init__(
        self,
        volume: NDArray[Any],
        spacing: NDArray[np.float64],
        label_data: LabelData,
        state: SessionState,
        view_state: ViewState,
        rules: UnpackingRules,
        rays: RayQueries | None,
        clock: Callable[[], float],
    ) -> None:
        # The backend stands in no key: both give the same results, and "auto" may choose either.
        self.volume, self.spacing, self.backend = volume, spacing, "auto"
        self.state, self.view_state, self.rules = state, view_state, rules
        self._given_rays = rays
        self.hold(label_data)
        self.events, self.history, self.flights = SessionEvents(), History(), FlightControl(clock)
        # A result on occlusion is what an empty queue waits for.
        self.queries = Queries(self, self.fill_queue)
        self.log: list[LogEntry] = []
        self.first_voxel_mm: Vector = np.zeros(3)
        self.scanner_from_scan: Matrix | None = None
        # The result that the log's latest removal rests on: its time is told once.
        self._credited: object = None

    def hold(self, data: LabelData) -> None:
        """Take over labels, with their geometry and the rays through them."""
        self.label_data = data
        # Both keep what they derive from labels, so other labels get others.
        self.bag = Bag(data.labels, data.boxes, self.spacing)
        self.ray_queries = self._given_rays or RenderingQueries(data.labels, self.spacing)

    @property
    def objects(self) -> pd.DataFrame:
        """Facts by ID, with the names people gave; a copy."""
        # Names stand in the state and not in the facts, so that undo brings them back.
        table, names = self.label_data.facts.copy(), self.state.names
        if names:
            table.loc[list(names), "name"] = list(names.values())
        # Columns of these in a table of the user's own stay as they are where nobody wrote here.
        for column, values in (("note", self.state.notes), ("flag", self.state.flags)):
            if values:
                told = dict(table[column]) if column in table else dict.fromkeys(table.index, "")
                table[column] = [values.get(i, told[i]) for i in table.index]
        return table

    def names(self, ids: Iterable[int]) -> list[str]:
        """Return what objects are called, in the order of their IDs."""
        names = self.objects["name"]
        return [str(names[i]) for i in sorted(ids)]

    @property
    def poses(self) -> dict[int, Pose]:
        """Poses in pivot space of unpacked objects that are in sight and not in the air."""
        slots, stretch = self.queries.slots(), self.view_state.camera.stretch
        return {
            i: placement.pose(slots, stretch)
            for i, placement in self.state.placements.items()
            if i not in self.flights and i not in self.state.hidden
        }

    # One state becomes another.

    def commit(
        self, verb: str, new: SessionState, merge: bool = False, data: LabelData | None = None
    ) -> None:
        """Enter a state by a command that can be undone; no step of it where nothing differs.

        Parameters
        ----------
        verb : str
            What is done, for people.
        new : SessionState
        merge : bool
            Make one step of it and the last of the same verb.
        data : LabelData, optional
            The labels then, where they are another's.
        """
        most, stretch = self.label_data.most_objects, self.view_state.camera.stretch
        new = commands.seated(new, self.state, self.queries.slots, stretch, most)
        # Inspecting an object is no part of a step: like turning the bag it changes nothing.
        before, after = (commands.inspect(state, None) for state in (self.state, new))
        # Before entering: those who hear of the change ask what can be undone.
        self.history.push(Step(verb, before, after), merge)
        self.enter(new, data)

    def enter(self, new: SessionState, data: LabelData | None = None) -> None:
        """Pass to another state: start flights, and tell what has changed.

        Parameters
        ----------
        new : SessionState
        data : LabelData, optional
            As for `commit`.
        """
        # States depend on the flights too, so they are asked before anything moves.
        old, states, before = self.state, self.queries.states(), self.queries.slots()
        edited: frozenset[int] = frozenset()
        if new.cut is not old.cut:
            self.see(clipping=self.clipping_with(new.cut))
        self.state = new
        if new.labels_edit is not old.labels_edit:
            # Before the flights, which start from the boxes of the new labels.
            edited = self._follow_labels(old, new, data)
        stretch = self.view_state.camera.stretch
        slots = self.queries.slots()
        self.flights.redirect(new.placements, slots, stretch, bends=True)
        self.flights.follow(old, new, self.bag, (before, slots), stretch)
        now = self.queries.states()
        changed = {i for i, state in now.items() if state is not states.get(i)}
        if edited:
            changed |= edited & self.label_data.known
        # Planned anew, they are elsewhere for all.
        if edited or slots is not before:
            changed.update(new.placements)
        self.events.emit_changes(old, new, edited, changed)

    def _follow_labels(
        self, old: SessionState, new: SessionState, data: LabelData | None
    ) -> frozenset[int]:
        before = self.label_data
        after = self.queries.labels_at(new.labels_edit) if data is None else data
        self.hold(after.after(before))
        touched = touched_between(old.labels_edit, new.labels_edit)
        # What flies shows voxels that may be another object's now.
        self.flights.land(touched)
        self.select(self.view_state.selected & self.label_data.known)
        return touched

    def travel(self, way: Literal["undo", "redo"]) -> str | None:
        """Go a step back or forth; return what it was, None where there is none."""
        ways = self.history.undo, self.history.redo
        go, back = ways if way == "undo" else ways[::-1]
        found = go(self.state)
        if found is None:
            self.events.message.emit(f"There is nothing to {way}.")
            return None
        try:
            # An object looked at alone would cover what undo has changed.
            self.enter(commands.inspect(found[1], None))
        except ValueError:
            # Refused before anything has changed, such as a plane too many: nor did the step.
            back(self.state)
            raise
        return found[0].verb

    def fill_queue(self) -> tuple[int, ...]:
        """Bring the queue up to date; return what it holds."""
        queue = self.queries.filled_queue(self.state.queue, self.queries.packed)
        if queue is not self.state.queue:
            self.enter(replace(self.state, queue=queue))
        return queue.ids

    # Removals, and the log of them.

    def removed(self, plan: RemovalPlan, state: SessionState) -> SessionState:
        """Return a state after a plan, with its removals in the log.

        Parameters
        ----------
        plan : RemovalPlan
        state : SessionState
            That it was made for.
        """
        for removal in plan.removals:
            # The first to leave by a result stands for its rays, wherever they were cast.
            asked = removal.source is not None and removal.source is not self._credited
            self._credited = removal.source or self._credited
            seconds = removal.source.seconds if asked and removal.source else 0.0
            event = "query run" if asked else "queue reuse"
            self.log.append(LogEntry(event, removal.group, removal.packed, removal.ratio, seconds))
        hold = partial(self.bag.placement, self.view_state.camera)
        return commands.remove(state, plan, hold, self.label_data.most_objects)

    # How it is looked at.

    def animate(self, animated: bool) -> None:
        """Have objects fly from now on, or have none fly: what does lands."""
        self.flights.set_pace(animated=animated)
        flying = frozenset() if animated else frozenset(self.flights)
        if self.flights.land(flying):
            self.events.states.emit(flying)

    def see(self, **changes: Any) -> None:
        """Exchange fields of the view state."""
        self.view_state = replace(self.view_state, **changes)

    def lock(self, ids: Iterable[int]) -> None:
        """Have recolouring leave the hues of some objects alone, and of no others."""
        # What was locked and is gone since stays so: undo may bring it back.
        known = self.label_data.known | self.view_state.locked_hues
        self.see(locked_hues=frozenset(checked_ids(ids, known, "locked_hues")))

    def look(self, camera: Camera, view: View) -> None:
        """Take over a camera and the view it stands for.

        Parameters
        ----------
        camera : Camera
        view : View
        """
        # Turning never mirrors; the viewer's transform does, and sprites are mirrored with the bag.
        if np.linalg.det(camera.stretch @ self.view_state.camera.stretch) < 0:
            mirror = commands.mirrors()
            self.state = mirror(self.state)
            self.history.every(mirror)
        self.see(view=view, camera=camera)
        if self.flights:
            # Perspective and stretch move the places beside the bag. No bends: at every frame of a
            # drag one would be added, and the bag itself changes at once too.
            self.flights.redirect(self.state.placements, self.queries.slots(), camera.stretch)
        self.events.view.emit(camera)

    def resize(self, wanted: Sequence[int]) -> None:
        """Take over the window's height and width in pixels."""
        size = checked_size(wanted)
        if size == self.view_state.canvas_size:
            return
        self.see(canvas_size=size)
        # Slots are planned for the window: another size moves all that is out.
        out = self.state.placements
        self.flights.redirect(out, self.queries.slots(), self.view_state.camera.stretch)
        if out:
            self.events.states.emit(frozenset(out))

    def clip(self, planes: ArrayLike | None) -> None:
        """Take other clipping planes; told as a change of the transfer function.

        Parameters
        ----------
        planes : (N, 2, 3) array_like, optional
        """
        # No signal of its own: who draws must cast anew, as for other opacities.
        wanted, before = checked_planes(planes), self.view_state.clipping
        self.see(clipping=wanted)
        cut = self.state.cut.kept(wanted, self.spacing, self.label_data.labels.shape)
        self.state = replace(self.state, cut=cut)
        if not np.array_equal(wanted, before):
            self.events.transfer_function.emit(self.state.transfer_function)

    def clipping_with(self, cut: Cut) -> NDArray[np.float64]:
        """Return the clipping planes with another cutting plane and clipping box.

        Raises
        ------
        ValueError
            If there are too many planes then.
        """
        shape = self.label_data.labels.shape
        others = without(self.view_state.clipping, self.state.cut.rows(self.spacing, shape))
        planes = np.concatenate([others, cut.rows(self.spacing, shape)])
        if len(planes) > MOST_PLANES:
            raise ValueError(
                f"There is room for {MOST_PLANES} clipping planes, and there would be "
                f"{len(planes)}: take some away first."
            )
        return checked_planes(planes)

    def decorate(self, decorations: Decorations) -> None:
        """Take another background, box and scale bar; what is told of lengths stays."""
        checked_kind(decorations, Decorations, "decorations")
        before = self.view_state.decorations
        kept = replace(decorations, unit=before.unit, measurements=before.measurements)
        self.see(decorations=kept)
        self.events.surroundings.emit(kept)

    def measure_in(self, wanted: LengthUnit | str) -> None:
        """Tell lengths in another unit, given whole or by its name; told as surroundings."""
        unit, around = wanted, self.view_state.decorations
        if isinstance(unit, str):
            unit = LengthUnit.voxels(self.spacing) if unit == "voxels" else LengthUnit(unit)
        checked_kind(unit, LengthUnit, "length_unit")
        if unit != around.unit:
            self.see(decorations=replace(around, unit=unit))
            self.events.surroundings.emit(self.view_state.decorations)

    def show_measurements(self, shown: bool) -> None:
        """Draw what was measured, or not; told as surroundings."""
        self.see(decorations=replace(self.view_state.decorations, measurements=shown))
        self.events.surroundings.emit(self.view_state.decorations)

    def set_tints(self, mode: Mode) -> None:
        """Make tints of hues another way; told as a change of hues."""
        if mode != self.view_state.tint_mode:
            self.see(tint_mode=mode)
            self.events.hues.emit(dict(self.state.hues))

    def set_unlabelled(self, shown: bool) -> None:
        """Show or hide matter without a label; told as a change of the transfer function."""
        if shown != self.view_state.show_unlabelled:
            self.see(show_unlabelled=shown)
            self.events.transfer_function.emit(self.state.transfer_function)

    def select(self, wanted: frozenset[int]) -> None:
        """Select objects, and only these."""
        if wanted != self.view_state.selected:
            self.see(selected=wanted)
            self.events.selected.emit(wanted)

    def set_rules(self, rules: UnpackingRules) -> None:
        """Take other rules; the queue is emptied, so that it is filled by them."""
        checked_kind(rules, UnpackingRules, "rules")
        if rules != self.rules:
            self.rules = rules
            self.enter(replace(self.state, queue=replace(self.state.queue, groups=())))

    # What verbs are given.

    def checked(self, ids: int | Iterable[int], name: str = "ids") -> list[int]:
        """Return known IDs as a list; see `checked_ids`.

        Parameters
        ----------
        ids : int or iterable of int
        name : str
            Of the argument, for the message.
        """
        return checked_ids(ids, self.label_data.known, name)

    def one(self, object_id: int) -> int:
        """Return a known ID; see `checked_id`."""
        return checked_id(object_id, self.label_data.known)

    def how_many_or_which(self, n_or_ids: int | Iterable[int]) -> int | list[int]:
        """Return a number of at least 1, or known IDs."""
        # One number is how many; a single ID comes in a list.
        if is_integer(n_or_ids):
            return checked_count(int(n_or_ids))
        return self.checked(n_or_ids, "n_or_ids")

    def buried(self, object_id: int) -> int:
        """Return the ID of an object in the bag.

        Raises
        ------
        ValueError
            If it is not there, or is hidden.
        """
        known = self.one(object_id)
        if known not in self.queries.packed:
            hidden = known in self.state.hidden
            why = "is hidden: show it first" if hidden else "is not in the bag: put it back first"
            raise ValueError(f"{listed(self.names([known]))} {why}")
        return known

    def outside(self, object_id: int) -> Placement:
        """Return the placement of an unpacked object.

        Raises
        ------
        ValueError
            If it is not outside the bag.
        """
        if self.one(object_id) not in self.state.placements:
            name = listed(self.names([object_id]))
            raise ValueError(f"{name} is not unpacked: unpack it first")
        return self.state.placements[object_id]


def begin_at(document: Document, first_voxel_mm: ArrayLike) -> None:
    """Take over where a bag begins in the scan it was cut out of, z y x; `ValueError` if nowhere.

    Parameters
    ----------
    document : Document
    first_voxel_mm : (3,) array_like of float
    """
    document.first_voxel_mm = checked_array(first_voxel_mm, (3,), "first_voxel_mm")


def lie_in(document: Document, scanner: ArrayLike | None) -> None:
    """Take over where surfaces of a bag belong; `ValueError` if it does more than turn and move.

    Parameters
    ----------
    document : Document
    scanner : (4, 4) array_like of float, optional
    """
    name = "scanner_from_scan"
    given = None if scanner is None else checked_array(scanner, (4, 4), name)
    document.scanner_from_scan = checked_place(given, name)
