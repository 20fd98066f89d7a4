"""The session: virtual unpacking of one bag, without a screen or with one."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.appearance import TransferFunction, golden_hue
from napari_unpack.geometry.axes import Matrix, Vector, checked_spacing, triple, unit
from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.geometry.transforms import Pose
from napari_unpack.geometry.view import Camera, View
from napari_unpack.rendering.backends import checked_backend
from napari_unpack.rendering.object_style import ObjectStyle
from napari_unpack.rendering.scene import Scene
from napari_unpack.session import commands, validation
from napari_unpack.session.annotations import Annotations
from napari_unpack.session.bag_cut import Cutting
from napari_unpack.session.colors import first_transfer_function
from napari_unpack.session.containers import OpenedBags
from napari_unpack.session.delegates import Read, Setting
from napari_unpack.session.directions import resolved
from napari_unpack.session.document import Document, begin_at, lie_in
from napari_unpack.session.errors import NobodyFreeError, listed
from napari_unpack.session.label_edits import EditedLabels, LabelEditor
from napari_unpack.session.labels import LabelData, Rating, object_table
from napari_unpack.session.measurements import Measurements
from napari_unpack.session.ray_queries import RayQueries
from napari_unpack.session.review import Review
from napari_unpack.session.scene_description import SceneDescription
from napari_unpack.session.state import Group, Placement, SessionState, UnpackingRules, ViewState
from napari_unpack.tasks import Task, no_progress
from napari_unpack.unpacking.direction import checked_direction
from napari_unpack.unpacking.direction_survey import BestDirection, RevealPlan

if TYPE_CHECKING:
    import pandas as pd

NO_STYLE = ObjectStyle()


class Session:
    """A bag being unpacked: what is where, what leaves next, and the verbs that change it.

    Parameters
    ----------
    volume : (Z, Y, X) array_like
        Density of any real dtype.
    labels : (Z, Y, X) array_like of int
        Object IDs, 0 background, of at most 65,535 objects. Where one is above 65,535 the
        session numbers the objects anew; `label_of` gives the ID of old. Neither volume nor
        uint16 labels are copied: give copies if you write to yours later (see `label_editor`).
    spacing : (3,) array_like
        Voxel size in mm, z y x.
    objects : DataFrame, optional
        Facts by ID, in the index or a column `id` or `label`; completed with what is missing.
    casters : RayQueries, optional
        What casts the rays, by default `rendering`.
    clock : callable, optional
        Returns the time in seconds by which flights go.

    Attributes
    ----------
    queries : Queries
        All that is derived, with tasks for what takes longer than a moment.
    label_editor : LabelEditor
        Tasks that edit the labels.
    annotations : Annotations
        Colours, notes and flags that a person gave objects.
    measurements : Measurements
    cutting : Cutting
        The cutting plane and the clipping box, which are among `clipping`.
    assumed : tuple of str
        As in a `Scan`: what its file does not say.
    opened_bags : OpenedBags
    review : Review
    flights, history, events
        What is in the air, by ID; steps done and undone; signals.
    log : list of LogEntry
        Every removal so far.

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
        density = validation.checked_volume(volume)
        checked, given_ids = validation.checked_labels(labels, density.shape)
        mm = checked_spacing(spacing)
        boxes = label_boxes(checked)
        facts = object_table(density, checked, boxes, mm, objects, given_ids)
        data = LabelData(checked, boxes, facts, given_ids)
        # Good for no view in particular, until one is chosen by what touches in it.
        hues = {i: golden_hue(i) for i in data.ids}
        state = SessionState(first_transfer_function(density, checked), hues)
        view = View()
        view_state = ViewState(view, view.camera(checked.shape, mm))
        rules = UnpackingRules()
        self._take(Document(density, mm, data, state, view_state, rules, casters, clock))

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
        volume, spacing, label_data, state, view_state, rules, casters
            Checked, and not measured anew as `__init__` would.
        """
        made, parts = cls.__new__(cls), (volume, spacing, label_data, state, view_state, rules)
        made._take(Document(*parts, casters, perf_counter))
        return made

    def __reduce__(self) -> str:
        """Refuse copies, which would share parts with it."""
        raise TypeError("a session cannot be copied: save_session and open_session make another")

    def _take(self, document: Document) -> None:
        self._doc = document
        self.volume, self.spacing = document.volume, document.spacing
        self.events, self.history = document.events, document.history
        self.flights, self.queries, self.log = document.flights, document.queries, document.log
        self.label_editor, self.annotations = LabelEditor(document), Annotations(document)
        self.measurements, self.cutting = Measurements(document), Cutting(document)
        self.assumed: tuple[str, ...] = ()
        self._scene_description, self.opened_bags = SceneDescription(), OpenedBags()
        self.review = Review(document, self.label_editor)

    # The parts, and what they hold.

    backend = Setting(
        lambda s: s._doc.backend,
        lambda s, v: setattr(s._doc, "backend", checked_backend(v)),
    )
    """What casts rays for this session's queries: "auto", "cpu" or "gl"."""
    bag = Read(lambda s: s._doc.bag)
    """The bag's geometry."""
    ray_queries = Read(lambda s: s._doc.ray_queries)
    """What casts the rays."""
    state = Read(lambda s: s._doc.state)
    """What undo brings back (`SessionState`)."""
    view_state = Read(lambda s: s._doc.view_state)
    """How it is looked at (`ViewState`); not undoable."""
    label_data = Read(lambda s: s._doc.label_data)
    """Labels and what follows from them (`LabelData`)."""
    labels = Read(lambda s: s._doc.label_data.labels)
    """Object IDs, (Z, Y, X) uint16; never written to."""
    boxes = Read(lambda s: s._doc.label_data.boxes)
    """Boxes of the objects, voxels."""
    display_labels = Read(lambda s: s._doc.label_data.display)
    """Labels grown into the fringe around objects, for images; (Z, Y, X) uint16."""
    ids = Read(lambda s: s._doc.label_data.ids)
    """Every object, ascending."""
    states = Read(lambda s: s.queries.states())
    """Where every object is (`ObjectState`), by ID; treat as read-only."""
    slots = Read(lambda s: s.queries.slots())
    """Where unpacked objects wait: more slots, in steps, as more of them are out."""
    hues = Read(lambda s: dict(s._doc.state.hues))
    """Hue in [0, 1) by ID; a copy."""
    objects = Read(lambda s: s._doc.objects)
    """Facts by ID, with the names people gave; a copy."""
    poses = Read(lambda s: s._doc.poses)
    """Poses in pivot space of unpacked objects that are in sight and not in the air."""
    queue = Read(lambda s: s._doc.state.queue)
    """The queue as it stands; `unpackable` brings it up to date."""
    examples = Read(lambda s: s._doc.state.examples & s._doc.label_data.known)
    """The objects marked as examples of whole ones, to train the confidence on."""
    unpack_direction = Read(lambda s: s.queries.direction)
    """D now: unit vector in world, along which objects leave."""
    step = Read(lambda s: len(s._doc.state.removals))
    """How many removals are done."""
    steps = Read(lambda s: (*s._doc.state.removals, *(tuple(gone) for gone in s._doc.state.undone)))
    """Removals known: those done, then those `go_to` has taken back."""

    # Settings; none can be undone.

    animated = Setting(lambda s: s.flights.animated, lambda s, v: s._doc.animate(v))
    """True: objects fly until `land`. False: verbs finish at once, and what flies lands."""
    seconds = Setting(lambda s: s.flights.seconds, lambda s, v: s.flights.set_pace(seconds=v))
    """What one flight takes."""
    clock = Setting(lambda s: s.flights.clock, lambda s, v: s.flights.set_pace(clock=v))
    """Returns the time in seconds by which flights go."""
    rules = Setting(lambda s: s._doc.rules, lambda s, v: s._doc.set_rules(v))
    """The rules by which objects may leave; setting others empties the queue."""
    rule = Setting(lambda s: s.rules.rule, lambda s, v: s._set_rules(rule=v))
    """What counts as unpackable; this and the next three are of `UnpackingRules`."""
    tolerance = Setting(lambda s: s.rules.tolerance, lambda s, v: s._set_rules(tolerance=v))
    """Share of an object that may be blocked and it still counts as unpackable."""
    max_group_size = Setting(
        lambda s: s.rules.max_group_size, lambda s, v: s._set_rules(max_group_size=v)
    )
    """Interlocked groups of up to so many leave together; a larger one stays."""
    take_least_occluded = Setting(
        lambda s: s.rules.take_least_occluded, lambda s, v: s._set_rules(take_least_occluded=v)
    )
    """Where nothing is unpackable: True takes the least occluded object, False raises."""
    canvas_size = Setting(lambda s: s._doc.view_state.canvas_size, lambda s, v: s._doc.resize(v))
    """Height and width of the window in pixels; slots are planned for it."""
    camera = Read(lambda s: s._doc.view_state.camera)
    """The view with nothing left open; `look` sets it."""
    selected = Read(lambda s: s._doc.view_state.selected)
    """IDs selected in the picture or in the table."""
    clipping = Setting(lambda s: s._doc.view_state.clipping, lambda s, v: s._doc.clip(v))
    """Planes that cut the packed bag open, (N, 2, 3): point and normal, voxels z y x.

    What lies behind one, (p - point) . normal < 0, is not shown, but still blocks. None is no
    plane; setting it is told as a change of the transfer function.
    """
    decorations = Setting(lambda s: s._doc.view_state.decorations, lambda s, v: s._doc.decorate(v))
    """Background, box and scale bar of every image."""
    length_unit = Setting(lambda s: s.decorations.unit, lambda s, v: s._doc.measure_in(v))
    """A `LengthUnit`, "mm", "voxels", or "µm": mm read as µm; LengthUnit("µm", 1000) converts."""
    tint_mode = Setting(lambda s: s._doc.view_state.tint_mode, lambda s, v: s._doc.set_tints(v))
    """How hues become tints: "perceptual", "hsv" as in the paper, "safe" where red looks green."""
    show_unlabelled = Setting(
        lambda s: s._doc.view_state.show_unlabelled, lambda s, v: s._doc.set_unlabelled(bool(v))
    )
    """Whether matter that belongs to no object shows; told as the transfer function."""
    locked_hues = Setting(lambda s: s._doc.view_state.locked_hues, lambda s, v: s._doc.lock(v))
    """Objects whose hue recolouring leaves alone."""
    hue_margin = Setting(
        lambda s: s._doc.view_state.hue_margin,
        lambda s, v: s._doc.see(hue_margin=validation.checked_margin(v)),
    )
    """Fraction of every hue arc left empty; neighbours are at least hue_margin / C apart."""
    scanner_from_scan = Setting(lambda s: s._doc.scanner_from_scan, lambda s, v: lie_in(s._doc, v))
    """As in a `Scan`: where its surfaces belong, a (4, 4) ndarray of float64 or None."""
    first_voxel_mm = Setting(lambda s: s._doc.first_voxel_mm, lambda s, v: begin_at(s._doc, v))
    """Where it begins in the scan it was cut out of, as an opened container is: (3,) mm, z y x."""
    away_from_table = Setting(
        lambda s: s._doc.view_state.up, lambda s, v: s._doc.see(up=unit(v, "away_from_table"))
    )
    """What is up: unit vector in world, by default -y; a viewer sets what it shows as up.

    Where the bag is shown stretched or mirrored it is the normal of what lies level there.
    """

    def label_of(self, object_id: int) -> int:
        """Return the ID an object has in the labels as given: what people are shown."""
        return self.label_data.label_of(object_id)

    # Flights.

    def land(self, object_id: int) -> None:
        """End a flight: the object is where it was going. Does nothing where there is none."""
        if self.flights.land([object_id]):
            self.events.states.emit(frozenset([object_id]))

    # How it is looked at; nothing here can be undone.

    @property
    def view(self) -> View:
        """The view as it was asked for."""
        return self.view_state.view

    @view.setter
    def view(self, view: View) -> None:
        validation.checked_kind(view, View, "view")
        # Only the viewer knows how the scan is stretched: another view leaves that as it is.
        camera = view.camera(self.labels.shape, self.spacing, self.camera.stretch)
        self._doc.look(camera, view)

    def look(self, camera: Camera) -> None:
        """Take over the camera that draws; ValueError if its rotation or stretch is none."""
        validation.checked_rotation(camera.rotation)
        validation.checked_stretch(camera.stretch)
        direction, up, center = (triple(v) for v in (camera.direction, camera.up, camera.center))
        view = View(direction, up, center, camera.height, camera.fov)
        self._doc.look(camera, view)

    def overview(self) -> Camera:
        """Return the camera that holds the bag and the slots beside it, however it turns."""
        return replace(self.camera, center=self.bag.center, height=self.slots.height_mm)

    def select(self, ids: int | Iterable[int] = ()) -> None:
        """Select objects, and only these."""
        self._doc.select(frozenset(self._doc.checked(ids)))

    # Colours, names, what is in sight.

    @property
    def transfer_function(self) -> TransferFunction:
        """The master transfer function; setting it can be undone."""
        return self.state.transfer_function

    @transfer_function.setter
    def transfer_function(self, transfer_function: TransferFunction) -> None:
        validation.checked_kind(transfer_function, TransferFunction, "transfer_function")
        new = replace(self.state, transfer_function=transfer_function)
        self._doc.commit("transfer function", new, merge=True)

    def style(self, object_id: int) -> ObjectStyle:
        """Return the opacity and the cut an object has of its own."""
        return self.state.styles.get(object_id, NO_STYLE)

    def set_style(self, object_id: int, style: ObjectStyle | None) -> None:
        """Give an object an opacity or a cut of its own; the bag shows nothing of it.

        Parameters
        ----------
        object_id : int
        style : ObjectStyle or None
            None takes both away. Successive changes are one step of undo, but for the cut of the
            inspected object, which ends with the inspection.
        """
        self.annotations.set_style(object_id, style)

    def transfer_function_of(self, object_id: int) -> TransferFunction:
        """Return what an object outside the bag is shown with; see `Scene`."""
        # Asked of the scene, so that what is told is what is drawn.
        return self.scene().transfer_function_of(self._doc.one(object_id))

    def packed_tints(self) -> NDArray[np.float32]:
        """Return the (M, 4) float32 tints of what is packed; zero for all else."""
        return self.scene().packed_tints

    def solo_tints(self, object_id: int) -> NDArray[np.float32]:
        """Return the (M, 4) float32 tints that show one object alone."""
        return self.scene().tints_alone(self._doc.one(object_id))

    def scene(self) -> Scene:
        """Return what images show of this session now; cheap, on the main thread."""
        return self._scene_description.of(self)

    def recolor(self, undoable: bool = True) -> dict[int, float]:
        """Give what is packed hues that its neighbours in this view do not have; return all.

        Hues that still separate stay, once hues were chosen for a view. `undoable` is False where
        the camera came to rest and nobody asked.
        """
        self.apply_hues(self.queries.hues(), undoable)
        return self.hues

    def apply_hues(self, hues: Mapping[int, float], undoable: bool = True) -> None:
        """Take over new hues; objects not among them keep theirs.

        Parameters
        ----------
        hues : mapping of int to float
            In [0, 1), by ID.
        undoable : bool
        """
        self._doc.checked(hues, "hues")
        merged = {**self.state.hues, **validation.checked_hues(hues)}
        # Also where they are as before: they were chosen for a view now, and are worth keeping.
        if not self.view_state.recolored:
            self._doc.see(recolored=True)
        if merged == self.state.hues:
            return
        new = replace(self.state, hues=merged)
        if undoable:
            self._doc.commit("recolor", new)
        else:
            self._doc.enter(new)

    def rename(self, object_id: int, name: str) -> None:
        """Give an object a name.

        Parameters
        ----------
        object_id : int
        name : str

        Raises
        ------
        ValueError
            If the name is blank.
        """
        object_id = self._doc.one(object_id)
        (now,) = self._doc.names([object_id])
        self._doc.commit("rename", commands.rename(self.state, object_id, name, now))

    def mark_examples(self, ids: int | Iterable[int], examples: bool = True) -> None:
        """Mark objects as examples of whole ones, or take the mark away.

        Parameters
        ----------
        ids, examples
            Which, and whether they are from now on.
        """
        wanted, now = frozenset(self._doc.checked(ids)), self.state.examples
        after = now | wanted if examples else now - wanted
        if after != now:
            new = replace(self.state, examples=after)
            self._doc.commit("mark" if examples else "unmark", new)

    def hide(self, ids: int | Iterable[int]) -> None:
        """Put objects out of sight, in the bag or outside; a flight of theirs ends."""
        fresh = [i for i in self._doc.checked(ids) if i not in self.state.hidden]
        if fresh:
            self._doc.commit("hide", commands.hide(self.state, fresh))

    def show(self, ids: int | Iterable[int] | None = None) -> None:
        """Bring objects into sight again where they were, by default all."""
        wanted = self.ids if ids is None else self._doc.checked(ids)
        if self.state.hidden.intersection(wanted):
            self._doc.commit("show", commands.show(self.state, wanted))

    def isolate(self, ids: int | Iterable[int]) -> None:
        """Show these objects, at least one, and hide all others.

        Raises
        ------
        ValueError
            If no object is given.
        """
        wanted, known = self._doc.checked(ids), self.label_data.known
        if not wanted:
            raise ValueError("ids must name at least one object to isolate, got none")
        # A step that changes nothing would be undone without effect.
        if known.difference(wanted) != self.state.hidden:
            self._doc.commit("isolate", commands.isolate(self.state, wanted, known))

    def _set_rules(self, **changes: Any) -> None:
        self._doc.set_rules(replace(self._doc.rules, **changes))

    # What may leave, and along which way.

    @property
    def direction(self) -> str | tuple[float, float, float] | None:
        """D as asked for: None (opposite of the view), "up" (the bag's), or world (z, y, x)."""
        return self.state.direction

    @direction.setter
    def direction(self, direction: str | Sequence[float] | None) -> None:
        wanted = checked_direction(direction)
        if wanted != self.state.direction:
            self._doc.commit("direction", replace(self.state, direction=wanted))

    def unpackable(self) -> Group:
        """Return the objects that can leave now, the next one first; casts rays if it must.

        Where nothing is unpackable that is the least occluded object, or none, as
        `take_least_occluded` says.
        """
        return self._doc.fill_queue()

    def best_direction(self, ask: bool = False) -> BestDirection | None:
        """Return the direction of 26 along which, by rays, the most objects can leave now, if any.

        With `ask` they are cast where that is not known yet; else None is returned then. Ties go
        to the one nearest D. They are coarse: which objects leave is asked anew.
        """
        if ask:
            self.queries.survey()
        return self.queries.best_direction()

    def reveal_plan(self, object_id: int) -> RevealPlan:
        """Return the least that must leave for a buried object to leave, and along which way.

        Of D and the best by rays of 26 directions; ties go to D. Casts rays where that is unknown.
        """
        return self.queries.reveal_plan(object_id)

    # Out of the bag and back.

    def unpack(self, n_or_ids: int | Iterable[int] = 1) -> Group:
        """Take objects out of the bag; return what left, in order.

        So many from the head of the queue, or these; those outside or hidden are passed over.
        Objects that hold together leave together. Raises NobodyFreeError where nothing is
        unpackable and `take_least_occluded` is False, and BlockedError where a chosen object is
        blocked by one that was not chosen; both are ValueErrors.
        """
        old = self.state
        new = self._doc.removed(self.queries.removal_plan(n_or_ids), old)
        left = tuple(i for i in new.placements if i not in old.placements)
        if not left:
            self.events.message.emit("There is nothing left to unpack.")
            return ()
        # Alone in the middle it would stand before what leaves.
        self._doc.commit("unpack", commands.inspect(new, None))
        return left

    def reveal(
        self, object_id: int, direction: str | Sequence[float] | Vector | None = None
    ) -> Group:
        """Take out the smallest set of objects that frees a buried one, and it; return them.

        Parameters
        ----------
        object_id : int
            A packed object.
        direction : str or (3,) sequence of float, optional
            Along which they leave: by default D, which stays as it is; "any" takes the one of
            26 along which the fewest leave (see `reveal_plan`).
        """
        object_id = self._doc.buried(object_id)
        if direction is None:
            along = self.unpack_direction
        elif isinstance(direction, str) and direction == "any":
            along = self.reveal_plan(object_id).direction
        else:
            asked = direction if isinstance(direction, str) else tuple(direction)
            along = resolved(checked_direction(asked), self.camera, self.queries.bag_up)
        plan = self.queries.reveal_removals(object_id, along)
        self._doc.commit("reveal", commands.inspect(self._doc.removed(plan, self.state), None))
        return plan.ids

    def force_unpack(self, object_id: int) -> None:
        """Take a packed object out whatever it meets, as the lid of a container."""
        plan = self.queries.forced_removal(self._doc.buried(object_id))
        self._doc.commit("take off", self._doc.removed(plan, self.state))

    def restore(self, n_or_ids: int | Iterable[int] = 1) -> Group:
        """Put so many of the latest, or these, back, to the queue's head; return what returned.

        Objects that left as a group return as one.
        """
        # Putting back what is hidden would change nothing one can see.
        seen = [i for i in reversed(self.state.placements) if i not in self.state.hidden]
        which = self._doc.how_many_or_which(n_or_ids)
        wanted = seen[:which] if isinstance(which, int) else [i for i in seen if i in which]
        back = commands.returning(self.state, wanted)
        if not back:
            self.events.message.emit("There is nothing to restore.")
            return ()
        self._doc.commit("restore", commands.restore(self.state, back))
        return back

    def go_to(self, step: int) -> int:
        """Take back or repeat removals until so many are done; return how many are done then.

        0 is the packed bag. Beyond the removals known, the next to leave are unpacked, as far as
        something can. Repeated removals end in the same places, turned by hand or not. Successive
        calls are one step of undo, and none where they end as they began.

        Raises
        ------
        ValueError
            If the step is negative; TypeError if it is not whole.
        """
        new = commands.go_to(self.state, validation.checked_whole(step, "step"))
        known = self.label_data.known
        try:
            # One by one: a group is one removal, however many are in it.
            while len(new.removals) < step and new.packed(known):
                new = self._doc.removed(self.queries.removal_plan(1, new), new)
        except NobodyFreeError as error:
            self.events.message.emit(str(error))
        if new.removals != self.state.removals:
            # A slider drawn along passes many steps; one undo takes back the whole way.
            self._doc.commit("scrub", new, merge=True)
        return self.step

    def inspect(self, object_id: int) -> None:
        """Look at one object alone; a flight of its own ends, another inspection too.

        Not undoable: looking changes nothing. Undo and redo end it.

        Raises
        ------
        ValueError
            If it is hidden.
        """
        object_id = self._doc.one(object_id)
        if object_id in self.state.hidden:
            raise ValueError(f"{listed(self._doc.names([object_id]))} is hidden: show it first")
        if object_id != self.state.inspected:
            self._doc.enter(commands.inspect(self.state, object_id))

    def leave(self) -> None:
        """End the inspection: the object is again where it was."""
        if self.state.inspected is not None:
            self._doc.enter(commands.inspect(self.state, None))

    def place(self, object_id: int, pose: Pose) -> None:
        """Put an unpacked object somewhere else; successive moves are one step of undo.

        Parameters
        ----------
        object_id : int
        pose : Pose
            In pivot space.
        """
        placement = self._doc.outside(object_id)
        picture = partial(self.bag.picture, object_id, stretch=self.camera.stretch)
        placed = commands.place(placement, pose, self.slots, picture)
        new = commands.move(self.state, object_id, placed)
        self._doc.commit(f"move {object_id}", new, merge=True)

    def pose_turned(self, object_id: int, rotation: Matrix) -> Pose:
        """Return the pose an unpacked object would have, held another way in its place.

        Parameters
        ----------
        object_id : int
        rotation : (3, 3) ndarray of float64
            From (stretched) world axes to pivot axes.
        """
        return self._turned(object_id, rotation).pose(self.slots, self.camera.stretch)

    def turn(self, object_id: int, rotation: Matrix) -> None:
        """Hold an unpacked object another way; successive turns and moves are one step.

        Parameters
        ----------
        object_id : int
        rotation : (3, 3) ndarray of float64
            From (stretched) world axes to pivot axes.
        """
        new = commands.move(self.state, object_id, self._turned(object_id, rotation))
        self._doc.commit(f"move {object_id}", new, merge=True)

    # The labels.

    def split(self, object_id: int, a: Sequence[int], b: Sequence[int]) -> int:
        """Split an object in two; return the new object. The larger part keeps the ID.

        Parameters
        ----------
        object_id : int
        a, b : (3,) sequence of int
            Voxels of it, z y x, one for each part.
        """
        return self._edited(self.label_editor.split_task(object_id, a, b)).new[0]

    def merge(self, ids: Iterable[int]) -> int:
        """Make one object of several; return its ID, the largest's."""
        wanted = self._doc.checked(ids)
        self._edited(self.label_editor.merge_task(wanted))
        # Which of them is the largest, and keeps its ID, only the edit knows.
        return next(i for i in wanted if i in self.label_data.known)

    def delete(self, ids: int | Iterable[int]) -> None:
        """Make background of objects; one at least must be left."""
        self._edited(self.label_editor.delete_task(ids))

    def own_labels(self, others: Iterable[NDArray[Any]]) -> None:
        """Keep labels that nobody else can write to, where one of these arrays is ours as well."""
        # What a brush writes would change labels under results that are kept by revision.
        now = self.label_data
        kept = [now.labels] if now.previous is None else [now.labels, now.previous.labels]
        if any(np.may_share_memory(theirs, ours) for theirs in others for ours in kept):
            self._doc.hold(replace(now, labels=now.labels.copy(), previous=None))

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
        self._doc.label_data = self.label_data.rescored(scores, Rating(oracle))

    # Undo, and how one state becomes another.

    def undo(self) -> str | None:
        """Take back the last step; return what it was, None where there was none."""
        return self._doc.travel("undo")

    def redo(self) -> str | None:
        """Do the step last taken back again; return what it was, None where there was none."""
        return self._doc.travel("redo")

    def _edited(self, task: Task[EditedLabels | None]) -> EditedLabels:
        edited = task.run(no_progress)
        assert edited is not None, "a split, a merge and a deletion always change something"
        self.label_editor.apply(edited)
        return edited

    def _turned(self, object_id: int, rotation: Matrix) -> Placement:
        placement = self._doc.outside(object_id)
        picture = partial(self.bag.picture, object_id, stretch=self.camera.stretch)
        return commands.turn(placement, rotation, picture)
