"""The session: virtual unpacking of one bag, without a screen or with one."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.appearance import Decorations, TransferFunction, golden_hue
from napari_unpack.appearance.tints import Mode
from napari_unpack.geometry.axes import Matrix, Vector, checked_spacing, unit
from napari_unpack.geometry.boxes import LabelBoxes, label_boxes
from napari_unpack.geometry.transforms import Pose
from napari_unpack.geometry.view import Camera, View
from napari_unpack.rendering.object_style import ObjectStyle
from napari_unpack.rendering.scene import Scene
from napari_unpack.session import commands
from napari_unpack.session.commands import RemovalPlan
from napari_unpack.session.errors import (
    NOTHING_UNPACKABLE,
    NobodyFreeError,
    least_occluded_sentence,
    listed,
)
from napari_unpack.session.events import LogEntry, SessionEvents
from napari_unpack.session.flights import FlightControl
from napari_unpack.session.history import History, Step
from napari_unpack.session.label_edits import EditedLabels, LabelEditor
from napari_unpack.session.labels import LabelData, object_table, touched_between
from napari_unpack.session.object_state import ObjectState
from napari_unpack.session.placement import Bag
from napari_unpack.session.queries import Queries
from napari_unpack.session.ray_queries import RayQueries, RenderingQueries
from napari_unpack.session.scene_description import SceneDescription
from napari_unpack.session.state import Group, Placement, SessionState, UnpackingRules, ViewState
from napari_unpack.session.validation import (
    checked_count,
    checked_ids,
    checked_labels,
    checked_planes,
    checked_volume,
)
from napari_unpack.tasks import Task, no_progress
from napari_unpack.unpacking import Queue, Slots, named
from napari_unpack.unpacking.direction_survey import BestDirection, RevealPlan
from napari_unpack.unpacking.occlusion import Rule

if TYPE_CHECKING:
    import pandas as pd

NO_STYLE = ObjectStyle()


class Session:
    """A bag being unpacked: what is where, what leaves next, and the verbs that change it.

    Pure state: no window, no GL.

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
    casters : RayQueries, optional
        What casts the rays, by default `rendering`.
    clock : callable, optional
        Returns the time in seconds by which flights go.

    Attributes
    ----------
    backend : {"auto", "cpu", "gl"}
        What casts rays for this session's queries.
    queries : Queries
        All that is derived, with tasks for what takes longer than a moment.
    label_editor : LabelEditor
        Tasks that edit the labels.
    flights : FlightControl
        Flights in the air, by ID.
    history : History
        Steps done and undone.
    log : list of LogEntry
        Every removal so far.
    events : SessionEvents

    Raises
    ------
    TypeError
        If volume or labels hold no numbers of the right kind.
    ValueError
        If the volume is not 3D, empty, constant or without finite values, the labels have
        another shape or no object, or the spacing is not positive.

    Notes
    -----
    Li et al. 2012, section 5. Verbs that cannot do what they are told raise `ValueError` with a
    sentence and change nothing; what is merely already so is no error.
    """

    def __init__(
        self,
        volume: ArrayLike,
        labels: ArrayLike,
        spacing: ArrayLike = (1.0, 1.0, 1.0),
        objects: pd.DataFrame | None = None,
        casters: RayQueries | None = None,
        clock: Callable[[], float] = perf_counter,
    ) -> None:
        density = checked_volume(volume)
        checked, given_ids = checked_labels(labels, density.shape)
        mm = checked_spacing(spacing)
        boxes = label_boxes(checked)
        facts = object_table(density, checked, boxes, mm, objects, given_ids)
        data = LabelData(checked, boxes, facts, given_ids)
        hues = {i: golden_hue(i) for i in data.ids}
        state = SessionState(TransferFunction.default_for(density), hues)
        view = View()
        view_state = ViewState(view, view.camera(checked.shape, mm))
        self._begin(density, mm, data, state, view_state, UnpackingRules(), casters, clock)

    @classmethod
    def of_parts(
        cls,
        volume: NDArray[Any],
        spacing: NDArray[np.float64],
        label_data: LabelData,
        state: SessionState,
        view_state: ViewState,
        rules: UnpackingRules,
        casters: RayQueries | None = None,
    ) -> Session:
        """Return the session that has these parts, with nothing to undo.

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
        casters : RayQueries, optional
            As for `Session`.
        """
        made = cls.__new__(cls)
        made._begin(volume, spacing, label_data, state, view_state, rules, casters, perf_counter)
        return made

    def _begin(
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
        self.volume, self.spacing, self.backend = volume, spacing, "auto"
        self._state, self._view_state, self._rules = state, view_state, rules
        self._given_rays = rays
        self._hold(label_data)
        self.events, self.history, self.flights = SessionEvents(), History(), FlightControl(clock)
        self.queries = Queries(self, self.unpackable)
        self.label_editor = LabelEditor(self, self._commit_labels)
        self._scene_description = SceneDescription()
        self.log: list[LogEntry] = []
        # The result that the log's latest removal rests on, and after which removal it was last
        # said that nothing is unpackable: both are said once, not for every removal.
        self._credited: object = None
        self._told_stuck: tuple[object, object] | None = None

    def _hold(self, data: LabelData) -> None:
        """Take over labels, with their geometry and the rays through them."""
        self._label_data = data
        self.bag = Bag(data.labels, data.boxes, self.spacing)
        self.ray_queries = self._given_rays or RenderingQueries(data.labels, self.spacing)

    # The parts, and what they hold.

    @property
    def state(self) -> SessionState:
        """What undo brings back."""
        return self._state

    @property
    def view_state(self) -> ViewState:
        """How it is looked at; not undoable."""
        return self._view_state

    @property
    def label_data(self) -> LabelData:
        """Labels and what follows from them."""
        return self._label_data

    @property
    def labels(self) -> NDArray[np.uint16]:
        """Object IDs, (Z, Y, X) uint16; never written to."""
        return self._label_data.labels

    @property
    def boxes(self) -> LabelBoxes:
        """Boxes of the objects, voxels."""
        return self._label_data.boxes

    @property
    def display_labels(self) -> NDArray[np.uint16]:
        """Labels grown into the fringe around objects, for pictures; (Z, Y, X) uint16."""
        return self._label_data.display

    @property
    def ids(self) -> tuple[int, ...]:
        """Every object, ascending."""
        return self._label_data.ids

    def label_of(self, object_id: int) -> int:
        """Return the ID an object has in the labels as given: what people are shown."""
        return self._label_data.label_of(object_id)

    @property
    def objects(self) -> pd.DataFrame:
        """Facts by ID, with the names people gave; a copy."""
        table, names = self._label_data.facts.copy(), self._state.names
        if names:
            table.loc[list(names), "name"] = list(names.values())
        return table

    def names(self, ids: Iterable[int]) -> list[str]:
        """Return what objects are called, in the order of their IDs."""
        names = self.objects["name"]
        return [str(names[i]) for i in sorted(ids)]

    @property
    def states(self) -> dict[int, ObjectState]:
        """Where every object is, by ID; treat as read-only."""
        return self.queries.states()

    @property
    def slots(self) -> Slots:
        """Where unpacked objects wait, planned for all of them at once."""
        return self.queries.slots()

    @property
    def poses(self) -> dict[int, Pose]:
        """Poses in pivot space of unpacked objects that are in sight and not in the air."""
        slots, stretch, hidden = self.slots, self.camera.stretch, self._state.hidden
        return {
            i: placement.pose(slots, stretch)
            for i, placement in self._state.placements.items()
            if i not in self.flights and i not in hidden
        }

    # Flights.

    @property
    def animated(self) -> bool:
        """False: verbs finish at once. True: objects fly until `land`."""
        return self.flights.animated

    @animated.setter
    def animated(self, animated: bool) -> None:
        self.flights.animated = animated

    @property
    def seconds(self) -> float:
        """What one flight takes."""
        return self.flights.seconds

    @seconds.setter
    def seconds(self, seconds: float) -> None:
        self.flights.seconds = seconds

    @property
    def clock(self) -> Callable[[], float]:
        """Returns the time in seconds by which flights go."""
        return self.flights.clock

    @clock.setter
    def clock(self, clock: Callable[[], float]) -> None:
        self.flights.clock = clock

    def land(self, object_id: int) -> None:
        """End a flight: the object is where it was going. Does nothing where there is none."""
        if self.flights.land([object_id]):
            self.events.states.emit(frozenset([object_id]))

    # How it is looked at; nothing here can be undone.

    @property
    def view(self) -> View:
        """The view as it was asked for."""
        return self._view_state.view

    @view.setter
    def view(self, view: View) -> None:
        if not isinstance(view, View):
            raise TypeError(f"view must be a View, got {view!r}")
        camera = view.camera(self.labels.shape, self.spacing, self.camera.stretch)
        self._see(view=view, camera=camera)
        self.events.view.emit(camera)

    @property
    def camera(self) -> Camera:
        """The view with nothing left open."""
        return self._view_state.camera

    def look(self, camera: Camera) -> None:
        """Take over the camera that draws."""
        if np.linalg.det(camera.stretch @ self.camera.stretch) < 0:
            self._state = commands.mirror(self._state)
        direction, up, center = (_triple(v) for v in (camera.direction, camera.up, camera.center))
        view = View(direction, up, center, camera.height, camera.fov)
        self._see(view=view, camera=camera)
        self.events.view.emit(camera)

    def overview(self) -> Camera:
        """Return the camera turned as now that holds the bag and all slots beside it.

        The slots stand clear of the bag at every turn about this camera's centre.
        """
        return replace(self.camera, center=self.bag.center, height=self.slots.height_mm)

    @property
    def canvas_size(self) -> tuple[int, int]:
        """Height and width of the window in pixels; slots are planned for it."""
        return self._view_state.canvas_size

    @canvas_size.setter
    def canvas_size(self, size: Sequence[int]) -> None:
        height, width = (int(v) for v in size)
        if (height, width) == self.canvas_size:
            return
        self._see(canvas_size=(height, width))
        out = self._state.placements
        self.flights.redirect(out, self.slots, self.camera.stretch)
        if out:
            self.events.states.emit(frozenset(out))

    @property
    def selected(self) -> frozenset[int]:
        """IDs selected in the picture or in the table."""
        return self._view_state.selected

    def select(self, ids: int | Iterable[int] = ()) -> None:
        """Select objects, and only these."""
        self._select(frozenset(self._checked(ids)))

    def _select(self, wanted: frozenset[int]) -> None:
        if wanted != self.selected:
            self._see(selected=wanted)
            self.events.selected.emit(wanted)

    @property
    def clipping(self) -> NDArray[np.float64]:
        """Planes that cut the packed bag open, (N, 2, 3): point and normal, voxels z y x.

        What lies behind one, (p - point) . normal < 0, is not shown; nothing else changes, so
        that what is cut away still blocks. Setting it takes None for no plane, and is told as a
        change of the transfer function.
        """
        return self._view_state.clipping

    @clipping.setter
    def clipping(self, planes: ArrayLike | None) -> None:
        wanted = checked_planes(planes)
        if not np.array_equal(wanted, self.clipping):
            self._see(clipping=wanted)
            self.events.transfer_function.emit(self.transfer_function)

    @property
    def decorations(self) -> Decorations:
        """Background, box and scale bar of every picture."""
        return self._view_state.decorations

    @decorations.setter
    def decorations(self, decorations: Decorations) -> None:
        self._see(decorations=decorations)
        self.events.surroundings.emit(decorations)

    @property
    def tint_mode(self) -> Mode:
        """How hues become tints: "perceptual", "hsv" as in the paper, or "safe".

        "safe" is for people who confuse red and green. Setting it is told as a change of hues.
        """
        return self._view_state.tint_mode

    @tint_mode.setter
    def tint_mode(self, mode: Mode) -> None:
        if mode != self.tint_mode:
            self._see(tint_mode=mode)
            self.events.hues.emit(self.hues)

    @property
    def show_unlabelled(self) -> bool:
        """Whether matter that belongs to no object shows, thinly.

        Setting it is told as a change of the transfer function: all must be cast anew.
        """
        return self._view_state.show_unlabelled

    @show_unlabelled.setter
    def show_unlabelled(self, shown: bool) -> None:
        if bool(shown) != self.show_unlabelled:
            self._see(show_unlabelled=bool(shown))
            self.events.transfer_function.emit(self.transfer_function)

    @property
    def locked_hues(self) -> frozenset[int]:
        """Objects whose hue recolouring leaves alone."""
        return self._view_state.locked_hues

    @locked_hues.setter
    def locked_hues(self, ids: Iterable[int]) -> None:
        self._see(locked_hues=frozenset(ids))

    @property
    def hue_margin(self) -> float:
        """Fraction of every hue arc left empty; neighbours are at least hue_margin / C apart."""
        return self._view_state.hue_margin

    @hue_margin.setter
    def hue_margin(self, margin: float) -> None:
        self._see(hue_margin=margin)

    @property
    def away_from_table(self) -> Vector:
        """What is up: unit vector in world, by default -y; a viewer sets what it shows as up.

        Where the bag is shown stretched or mirrored it is the normal of what lies level there.
        """
        return self._view_state.up

    @away_from_table.setter
    def away_from_table(self, up: Sequence[float] | Vector) -> None:
        self._see(up=unit(up, "away_from_table"))

    def _see(self, **changes: Any) -> None:
        self._view_state = replace(self._view_state, **changes)

    # Colours, names, what is in sight.

    @property
    def transfer_function(self) -> TransferFunction:
        """The master transfer function; setting it can be undone."""
        return self._state.transfer_function

    @transfer_function.setter
    def transfer_function(self, transfer_function: TransferFunction) -> None:
        if not isinstance(transfer_function, TransferFunction):
            raise TypeError(
                f"transfer_function must be a TransferFunction, got {transfer_function!r}"
            )
        new = replace(self._state, transfer_function=transfer_function)
        self._commit("transfer function", new, merge=True)

    def style(self, object_id: int) -> ObjectStyle:
        """Return the opacity and the cut an object has of its own."""
        return self._state.styles.get(object_id, NO_STYLE)

    def set_style(self, object_id: int, style: ObjectStyle | None) -> None:
        """Give an object an opacity or a cut of its own; the bag shows nothing of it.

        Parameters
        ----------
        object_id : int
        style : ObjectStyle or None
            None takes both away. Successive changes are one step of undo.
        """
        (object_id,) = self._checked(object_id, "object_id")
        new = commands.set_style(self._state, object_id, style)
        self._commit(f"style {object_id}", new, merge=True)

    def transfer_function_of(self, object_id: int) -> TransferFunction:
        """Return the transfer function an object is shown with outside the bag.

        Its own, or the master's; where that would show next to nothing of it, with a minimum
        opacity.
        """
        return self.scene().transfer_function_of(object_id)

    def packed_tints(self) -> NDArray[np.float32]:
        """Return the (M, 4) float32 tints of what is packed; zero for all else. Read-only.

        Row 0, matter without a label, is zero unless `show_unlabelled`.
        """
        return self.scene().packed_tints

    def solo_tints(self, object_id: int) -> NDArray[np.float32]:
        """Return the (M, 4) float32 tints that show one object alone.

        Its alpha is above 1 where the object's typical density is so faint under the master
        transfer function that it could not be made out on its own.
        """
        return self.scene().tints_alone(object_id)

    def scene(self) -> Scene:
        """Return what images show of this session now; cheap, on the main thread."""
        return self._scene_description.of(self)

    @property
    def hues(self) -> dict[int, float]:
        """Hue in [0, 1) by ID; a copy."""
        return dict(self._state.hues)

    def recolor(self, keep: bool = True, undoable: bool = True) -> dict[int, float]:
        """Give what is packed hues that its neighbours in this view do not have.

        Parameters
        ----------
        keep : bool
            Keep hues that still separate; False starts afresh.
        undoable : bool
            False where the camera came to rest and nobody asked.

        Returns
        -------
        dict of int to float
            All hues.
        """
        self.apply_hues(self.queries.hues(keep), undoable)
        return self.hues

    def apply_hues(self, hues: Mapping[int, float], undoable: bool = True) -> None:
        """Take over new hues; objects not among them keep theirs.

        Parameters
        ----------
        hues : mapping of int to float
            In [0, 1), by ID.
        undoable : bool
        """
        self._checked(hues, "hues")
        merged = {**self._state.hues, **hues}
        if not self._view_state.recolored:
            self._see(recolored=True)
        if merged == self._state.hues:
            return
        new = replace(self._state, hues=merged)
        if undoable:
            self._commit("recolor", new)
        else:
            self._enter(new)

    def rename(self, object_id: int, name: str) -> None:
        """Give an object a name.

        Parameters
        ----------
        object_id : int
        name : str

        Raises
        ------
        ValueError
            If there is no such object or the name is blank.
        """
        (object_id,) = self._checked(object_id, "object_id")
        if not name.strip():
            raise ValueError("name must not be blank")
        self._commit("rename", commands.rename(self._state, object_id, name.strip()))

    @property
    def examples(self) -> frozenset[int]:
        """The objects marked as examples of whole ones, to train the confidence on."""
        return self._state.examples & self._label_data.known

    def mark_examples(self, ids: int | Iterable[int], examples: bool = True) -> None:
        """Mark objects as examples of whole ones, or take the mark away.

        Parameters
        ----------
        ids : int or iterable of int
        examples : bool
        """
        wanted, now = frozenset(self._checked(ids)), self._state.examples
        after = now | wanted if examples else now - wanted
        if after != now:
            new = replace(self._state, examples=after)
            self._commit("mark" if examples else "unmark", new)

    def hide(self, ids: int | Iterable[int]) -> None:
        """Put objects out of sight, in the bag or outside; a flight of theirs ends."""
        fresh = [i for i in self._checked(ids) if i not in self._state.hidden]
        if fresh:
            self._commit("hide", commands.hide(self._state, fresh))

    def show(self, ids: int | Iterable[int] | None = None) -> None:
        """Bring objects into sight again where they were, by default all."""
        wanted = self.ids if ids is None else self._checked(ids)
        if self._state.hidden.intersection(wanted):
            self._commit("show", commands.show(self._state, wanted))

    def isolate(self, ids: int | Iterable[int]) -> None:
        """Show these objects and hide all others.

        Raises
        ------
        ValueError
            If no object is given, or one that is not of this session.
        """
        wanted, known = self._checked(ids), self._label_data.known
        if not wanted:
            raise ValueError("ids must name at least one object to isolate, got none")
        if known.difference(wanted) != self._state.hidden:
            self._commit("isolate", commands.isolate(self._state, wanted, known))

    # What may leave, and along which way.

    @property
    def rules(self) -> UnpackingRules:
        """The rules by which objects may leave; not undoable.

        Setting others empties the queue, so that it is filled by these.
        """
        return self._rules

    @rules.setter
    def rules(self, rules: UnpackingRules) -> None:
        if rules != self._rules:
            self._rules = rules
            self._enter(replace(self._state, queue=replace(self._state.queue, groups=())))

    @property
    def rule(self) -> Rule:
        """What counts as unpackable; see `UnpackingRules`."""
        return self._rules.rule

    @rule.setter
    def rule(self, rule: Rule) -> None:
        self.rules = replace(self._rules, rule=rule)

    @property
    def tolerance(self) -> float:
        """Share of an object that may be blocked and it still counts as unpackable."""
        return self._rules.tolerance

    @tolerance.setter
    def tolerance(self, tolerance: float) -> None:
        self.rules = replace(self._rules, tolerance=float(tolerance))

    @property
    def max_group_size(self) -> int:
        """Interlocked groups of up to so many leave together; a larger one stays."""
        return self._rules.max_group_size

    @max_group_size.setter
    def max_group_size(self, most: int) -> None:
        self.rules = replace(self._rules, max_group_size=int(most))

    @property
    def take_least_occluded(self) -> bool:
        """What happens where nothing is unpackable: True takes the least occluded, False raises."""
        return self._rules.take_least_occluded

    @take_least_occluded.setter
    def take_least_occluded(self, least: bool) -> None:
        self.rules = replace(self._rules, take_least_occluded=bool(least))

    @property
    def direction(self) -> str | tuple[float, float, float] | None:
        """D as asked for: None (opposite of the view), "up" (the bag's), or world (z, y, x)."""
        return self._state.direction

    @direction.setter
    def direction(self, direction: str | Sequence[float] | None) -> None:
        wanted: str | tuple[float, float, float] | None
        if direction is None or (isinstance(direction, str) and direction in ("view", "up")):
            wanted = "up" if direction == "up" else None
        else:
            wanted = _triple(named(direction))
        if wanted != self._state.direction:
            self._commit("direction", replace(self._state, direction=wanted))

    @property
    def unpack_direction(self) -> Vector:
        """D now: unit vector in world, along which objects leave."""
        return self.queries.direction

    @property
    def queue(self) -> Queue:
        """The queue as it stands; `unpackable` brings it up to date."""
        return self._state.queue

    def unpackable(self) -> Group:
        """Return the objects that can leave now, the next one first; casts rays if it must.

        Where nothing is unpackable that is the least occluded object, or none, as
        `take_least_occluded` says.
        """
        queue = self.queries.filled_queue(self._state.queue, self.queries.packed)
        if queue is not self._state.queue:
            self._enter(replace(self._state, queue=queue))
        return queue.ids

    def unpackable_groups(self) -> tuple[Group, ...]:
        """Return what can leave now as far as that is known, groups whole; casts no rays."""
        return self.queries.unpackable_groups()

    def least_occluded_object(self) -> tuple[int, float] | None:
        """Return the object least occluded along D and its ratio, None while that is unknown."""
        return self.queries.least_occluded()

    def best_direction(self, ask: bool = False) -> BestDirection | None:
        """Return the direction of 26 along which the most objects can leave now.

        Parameters
        ----------
        ask : bool
            Cast rays where that is not known yet; else None is returned then.

        Returns
        -------
        BestDirection or None
            None also where nothing is unpackable along any of them. Ties go to the one nearest D.
        """
        if ask:
            self.queries.survey()
        return self.queries.best_direction()

    def reveal_plan(self, object_id: int) -> RevealPlan:
        """Return the least that must leave for a buried object to leave, and along which way.

        Of D and 26 directions; ties go to D. Casts rays where that is not known yet.

        Raises
        ------
        ValueError
            If the object is not packed, or there is no table of blockers.
        """
        return self.queries.reveal_plan(self._buried(object_id))

    # Out of the bag and back.

    def unpack(self, n_or_ids: int | Iterable[int] = 1) -> Group:
        """Take objects out of the bag.

        Parameters
        ----------
        n_or_ids : int or iterable of int
            How many from the head of the queue, or which objects. Objects that hold together
            leave together, so more may leave than were asked for.

        Returns
        -------
        tuple of int
            What left, in order. Objects already outside or hidden are passed over.

        Raises
        ------
        NobodyFreeError
            If nothing is unpackable and `take_least_occluded` is False (a ValueError).
        BlockedError
            If a chosen object is blocked by one that was not chosen (a ValueError).
        ValueError
            If an ID is unknown or the number is below 1.
        """
        which, old = self._how_many_or_which(n_or_ids), self._state
        if isinstance(which, int):
            new = self._removed_next(which, old)
        else:
            new = self._removed(self.queries.removal_plan(which), old)
        left = tuple(i for i in new.placements if i not in old.placements)
        if not left:
            self.events.message.emit("There is nothing left to unpack.")
            return ()
        self._commit("unpack", commands.inspect(new, None))
        return left

    def reveal(
        self, object_id: int, direction: str | Sequence[float] | Vector | None = None
    ) -> Group:
        """Take out the smallest set of objects that frees a buried one, and it as well.

        Parameters
        ----------
        object_id : int
            A packed object.
        direction : str or (3,) sequence of float, optional
            Along which they leave: by default D, which stays as it is; "any" takes the one of
            26 along which the fewest leave (see `reveal_plan`).

        Returns
        -------
        tuple of int
            What left, in order.

        Raises
        ------
        ValueError
            If the object is not packed, or there is no table of blockers.
        """
        object_id = self._buried(object_id)
        if direction is None:
            along = self.unpack_direction
        elif isinstance(direction, str):
            along = (
                self.reveal_plan(object_id).direction if direction == "any" else named(direction)
            )
        else:
            along = named(tuple(direction))
        plan = self.queries.reveal_removals(object_id, along)
        self._commit("reveal", commands.inspect(self._removed(plan, self._state), None))
        return plan.ids

    def force_unpack(self, object_id: int) -> None:
        """Take an object out whatever it meets, as the lid of a container is taken off.

        Raises
        ------
        ValueError
            If the object is not packed.
        """
        plan = self.queries.forced_removal(self._buried(object_id))
        self._commit("take off", self._removed(plan, self._state))

    def restore(self, n_or_ids: int | Iterable[int] = 1) -> Group:
        """Put objects back into the bag, at the head of the queue.

        Parameters
        ----------
        n_or_ids : int or iterable of int
            How many of the latest, or which objects. Objects that left as a group return as
            one. Objects in the bag are passed over.

        Returns
        -------
        tuple of int
            What returned, in order.

        Raises
        ------
        ValueError
            If an ID is unknown or the number is below 1.
        """
        seen = [i for i in reversed(self._state.placements) if i not in self._state.hidden]
        which = self._how_many_or_which(n_or_ids)
        wanted = seen[:which] if isinstance(which, int) else [i for i in seen if i in which]
        back = commands.returning(self._state, wanted)
        if not back:
            self.events.message.emit("There is nothing to restore.")
            return ()
        self._commit("restore", commands.restore(self._state, back))
        return back

    @property
    def steps(self) -> tuple[Group, ...]:
        """Removals known: those done, then those `go_to` has taken back."""
        return (*self._state.removals, *(tuple(removal) for removal in self._state.undone))

    @property
    def step(self) -> int:
        """How many removals are done."""
        return len(self._state.removals)

    def go_to(self, step: int) -> int:
        """Take back or repeat removals until so many are done; 0 is the packed bag.

        Parameters
        ----------
        step : int
            Beyond the removals known, the next to leave are unpacked as by `unpack`.

        Returns
        -------
        int
            How many are done now; fewer than asked for where nothing is left that can leave.

        Raises
        ------
        ValueError
            If the step is negative.

        Notes
        -----
        Repeated removals end in the same places, turned by hand or not. Successive calls are
        one step of undo.
        """
        if step < 0:
            raise ValueError(f"step must not be negative, got {step!r}")
        new = commands.go_to(self._state, int(step))
        known = self._label_data.known
        try:
            while len(new.removals) < step and new.packed(known):
                new = self._removed_next(1, new)
        except NobodyFreeError as error:
            self.events.message.emit(str(error))
        if new.removals != self._state.removals:
            self._commit("scrub", new, merge=True)
        return self.step

    def inspect(self, object_id: int) -> None:
        """Look at one object alone; a flight of its own ends, another inspection too.

        Not undoable: looking changes nothing. Undo and redo end it.

        Raises
        ------
        ValueError
            If there is no such object, or it is hidden.
        """
        (object_id,) = self._checked(object_id, "object_id")
        if object_id in self._state.hidden:
            raise ValueError(f"{listed(self.names([object_id]))} is hidden: show it first")
        if object_id != self._state.inspected:
            self._enter(commands.inspect(self._state, object_id))

    def leave(self) -> None:
        """End the inspection: the object is again where it was."""
        if self._state.inspected is not None:
            self._enter(commands.inspect(self._state, None))

    def place(self, object_id: int, pose: Pose) -> None:
        """Put an unpacked object somewhere else; successive moves are one step of undo.

        Parameters
        ----------
        object_id : int
        pose : Pose
            In pivot space.

        Raises
        ------
        ValueError
            If it is not outside the bag.
        """
        object_id, placement = self._outside(object_id)
        stretch = self.camera.stretch
        placed = commands.place(
            placement,
            pose,
            self.slots.window_mm,
            lambda rotation: self.bag.picture(object_id, rotation, stretch),
        )
        new = commands.move(self._state, object_id, placed)
        self._commit(f"move {object_id}", new, merge=True)

    def pose_turned(self, object_id: int, rotation: Matrix) -> Pose:
        """Return the pose an unpacked object would have, held another way in its place.

        Its picture keeps its size, unless it would stand out of its place so.

        Parameters
        ----------
        object_id : int
        rotation : (3, 3) ndarray of float64
            From (stretched) world axes to pivot axes.

        Raises
        ------
        ValueError
            If it is not outside the bag.
        """
        return self._turned(object_id, rotation).pose(self.slots, self.camera.stretch)

    def turn(self, object_id: int, rotation: Matrix) -> None:
        """Hold an unpacked object another way; successive turns and moves are one step.

        Parameters
        ----------
        object_id : int
        rotation : (3, 3) ndarray of float64
            From (stretched) world axes to pivot axes.

        Raises
        ------
        ValueError
            If it is not outside the bag.
        """
        new = commands.move(self._state, object_id, self._turned(object_id, rotation))
        self._commit(f"move {object_id}", new, merge=True)

    # The labels.

    def split(self, object_id: int, a: Sequence[int], b: Sequence[int]) -> int:
        """Split an object so that each part holds one of two voxels.

        Parameters
        ----------
        object_id : int
        a, b : (3,) sequence of int
            Voxels of it, z y x.

        Returns
        -------
        int
            The new object; the larger part keeps the ID.

        Raises
        ------
        ValueError
            If there is no such object, it is outside the bag, or the voxels are not in it.
        """
        return self._edited(self.label_editor.split_task(object_id, a, b)).new[0]

    def merge(self, ids: Iterable[int]) -> int:
        """Make one object of several; return its ID, the largest's.

        Raises
        ------
        ValueError
            If there are fewer than two, one is unknown, or one is outside the bag.
        """
        wanted = self._checked(ids)
        self._edited(self.label_editor.merge_task(wanted))
        return next(i for i in wanted if i in self._label_data.known)

    def delete(self, ids: int | Iterable[int]) -> None:
        """Make background of objects.

        Raises
        ------
        ValueError
            If none is given or left, one is unknown, or one is outside the bag.
        """
        self._edited(self.label_editor.delete_task(ids))

    def own_labels(self, others: Iterable[NDArray[Any]]) -> None:
        """Keep labels that nobody else can write to, where one of these arrays is ours as well."""
        now = self._label_data
        kept = [now.labels] if now.previous is None else [now.labels, now.previous.labels]
        if any(np.may_share_memory(theirs, ours) for theirs in others for ours in kept):
            self._hold(replace(now, labels=now.labels.copy(), previous=None))

    def use_oracle(
        self, oracle: Callable[[Any], float] | None, scores: Mapping[int, float]
    ) -> None:
        """Take another confidence for the table and for edits to come.

        Parameters
        ----------
        oracle : callable or None
            Returns the confidence of a `segmentation.Region`; None is the one that ships.
        scores : mapping of int to float
            The confidence of every object by it.
        """
        self.label_editor.oracle = oracle
        self._label_data = self._label_data.rescored(scores)

    # Undo, and how one state becomes another.

    def undo(self) -> str | None:
        """Take back the last step; return what it was, None where there was none."""
        return self._travel(self.history.undo(self._state), "undo")

    def redo(self) -> str | None:
        """Do the step last taken back again; return what it was, None where there was none."""
        return self._travel(self.history.redo(self._state), "redo")

    def _travel(self, found: tuple[Step, SessionState] | None, way: str) -> str | None:
        if found is None:
            self.events.message.emit(f"There is nothing to {way}.")
            return None
        step, state = found
        self._enter(commands.inspect(state, None))
        return step.verb

    def _commit(self, verb: str, new: SessionState, merge: bool = False) -> None:
        """Enter a state by a command that can be undone.

        Inspecting an object is no part of it: like turning the bag it changes nothing.
        """
        before, after = (commands.inspect(state, None) for state in (self._state, new))
        self.history.push(Step(verb, before, after), merge)
        self._enter(new)

    def _commit_labels(self, verb: str, new: SessionState, data: LabelData) -> None:
        before, after = (commands.inspect(state, None) for state in (self._state, new))
        self.history.push(Step(verb, before, after))
        self._enter(new, data)

    def _enter(self, new: SessionState, data: LabelData | None = None) -> None:
        """Pass to another state: start flights, and tell what has changed."""
        old, states = self._state, self.states
        edited: frozenset[int] = frozenset()
        self._state = new
        if new.labels_edit is not old.labels_edit:
            edited = self._follow_labels(old, new, data)
        self.flights.follow(old, new, self.bag, self.slots, self.camera.stretch)
        changed = {i for i, state in self.states.items() if state is not states.get(i)}
        if edited:
            # Slots may have been planned anew.
            changed.update(new.placements, edited & self._label_data.known)
        self.events.emit_changes(old, new, edited, changed)

    def _follow_labels(
        self, old: SessionState, new: SessionState, data: LabelData | None
    ) -> frozenset[int]:
        """Make the labels those of a state; return the objects touched."""
        before = self._label_data
        after = self.queries.labels_at(new.labels_edit) if data is None else data
        self._hold(after.after(before))
        touched = touched_between(old.labels_edit, new.labels_edit)
        self.flights.land(touched)
        self._select(self.selected & self._label_data.known)
        return touched

    def _removed(self, plan: RemovalPlan, state: SessionState) -> SessionState:
        """Return a state after a plan, with its removals in the log."""
        for removal in plan.removals:
            # The first to leave by a result stands for its rays, wherever they were cast.
            asked = removal.source is not None and removal.source is not self._credited
            self._credited = removal.source or self._credited
            seconds = removal.source.seconds if asked and removal.source else 0.0
            event = "query run" if asked else "queue reuse"
            self.log.append(LogEntry(event, removal.group, removal.packed, removal.ratio, seconds))
        slots = self._label_data.most_objects
        return commands.remove(state, plan, partial(self.bag.placement, self.camera), slots)

    def _removed_next(self, count: int, state: SessionState) -> SessionState:
        """Return a state after the next so many have left; say where one had to be forced."""
        plan = self.queries.removal_plan(count, state)
        told = self._told_stuck
        silent = told is not None and told[0] is state.placements and told[1] == state.direction
        for removal in plan.removals:
            if removal.least_occluded and not silent:
                (name,) = self.names(removal.group)
                sentence = least_occluded_sentence(name, removal.ratio)
                self.events.message.emit(f"{NOTHING_UNPACKABLE}; {sentence}: it leaves.")
            silent = removal.least_occluded
        new = self._removed(plan, state)
        self._told_stuck = (new.placements, new.direction) if silent else None
        return new

    def _edited(self, task: Task[EditedLabels | None]) -> EditedLabels:
        edited = task.run(no_progress)
        assert edited is not None, "a split, a merge and a deletion always change something"
        self.label_editor.apply(edited)
        return edited

    # What verbs are given.

    def _checked(self, ids: int | Iterable[int], name: str = "ids") -> list[int]:
        return checked_ids(ids, self._label_data.known, name)

    def _how_many_or_which(self, n_or_ids: int | Iterable[int]) -> int | list[int]:
        if isinstance(n_or_ids, int | np.integer):
            return checked_count(int(n_or_ids))
        return self._checked(n_or_ids, "n_or_ids")

    def _buried(self, object_id: int) -> int:
        (object_id,) = self._checked(object_id, "object_id")
        if object_id not in self.queries.packed:
            name = listed(self.names([object_id]))
            raise ValueError(f"{name} is not in the bag: put it back first")
        return object_id

    def _outside(self, object_id: int) -> tuple[int, Placement]:
        (object_id,) = self._checked(object_id, "object_id")
        if object_id not in self._state.placements:
            name = listed(self.names([object_id]))
            raise ValueError(f"{name} is not unpacked: unpack it first")
        return object_id, self._state.placements[object_id]

    def _turned(self, object_id: int, rotation: Matrix) -> Placement:
        object_id, placement = self._outside(object_id)
        picture = self.bag.picture(object_id, rotation, self.camera.stretch)
        return placement.turned(rotation, picture)


def _triple(vector: NDArray[np.float64]) -> tuple[float, float, float]:
    z, y, x = (float(v) for v in vector)
    return z, y, x
