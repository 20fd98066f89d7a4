"""What the verbs of a session do to its state: pure functions, without rays and without events."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from napari_unpack.geometry.axes import Matrix, Vector
from napari_unpack.geometry.transforms import Pose
from napari_unpack.rendering.object_style import ObjectStyle
from napari_unpack.session.labels import Edit, one_line, origin_of
from napari_unpack.session.measurements import Measurement, SurfacePoint
from napari_unpack.session.occlusion import NextUnpackable, OcclusionResult
from napari_unpack.session.state import Group, Placement, SessionState
from napari_unpack.session.validation import checked_kind, checked_pose, checked_rotation
from napari_unpack.unpacking import Queue, Slots

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Removal:
    """One object or group that leaves.

    Parameters
    ----------
    group : tuple of int
        What leaves together.
    direction : (3,) ndarray of float64
        Along which, unit vector in world.
    packed : int
        How many objects are in the bag before.
    source : OcclusionResult or NextUnpackable, optional
        The result that says it can leave; None where it is not known any more.
    least_occluded : bool
        Whether it leaves for want of anything unpackable.
    """

    group: Group
    direction: Vector
    packed: int
    source: OcclusionResult | NextUnpackable | None
    least_occluded: bool = False

    @property
    def ratio(self) -> float:
        """Occlusion ratio (`first_hit`); 0 but for the least occluded object."""
        if self.least_occluded and isinstance(self.source, OcclusionResult):
            return float(self.source.first_hit.get(self.group[0], 0.0))
        return 0.0


@dataclass(frozen=True, eq=False)
class RemovalPlan:
    """What leaves by one command, in order.

    Parameters
    ----------
    removals : tuple of Removal
    queue : Queue
        As they leave it behind.
    """

    removals: tuple[Removal, ...]
    queue: Queue

    @property
    def ids(self) -> Group:
        """Every object that leaves, in order."""
        return tuple(i for removal in self.removals for i in removal.group)


Hold = Callable[[int, int, Group, Vector], Placement]
"""Given an object, its slot, its group and D, chooses how the object is held."""

Plan = Callable[[Mapping[int, Placement]], Slots]
"""Given what is out, returns the slots."""


def remove(state: SessionState, plan: RemovalPlan, hold: Hold, slots: int) -> SessionState:
    """Take objects out of the bag.

    Parameters
    ----------
    state : SessionState
    plan : RemovalPlan
        Made for this state.
    hold : callable
        Given an object, its slot, its group and D, returns its placement.
    slots : int
        How many slots there are; objects take the first that are empty.
    """
    placements = dict(state.placements)
    # First empty slots, those before counted: going again ends in the same places.
    for removal in plan.removals:
        taken = {placement.slot for placement in placements.values()}
        empty = (k for k in range(slots) if k not in taken)
        for object_id, slot in zip(removal.group, empty, strict=False):
            placements[object_id] = hold(object_id, slot, removal.group, removal.direction)
    # Removals taken back before would not follow on these.
    return replace(state, placements=placements, queue=plan.queue, undone=())


def seated(
    state: SessionState, before: SessionState, plan: Plan, stretch: Matrix, most: int
) -> SessionState:
    """Keep objects out from beneath what a person has moved, as far as there are slots.

    Those that come out go on to the next empty slot that is clear of it; where slots are planned
    anew and all are elsewhere, so does who is out already. Others stay where they are.

    Parameters
    ----------
    state, before : SessionState
        After a command and before it.
    plan : callable
        Given placements, returns the slots that are planned for them.
    stretch : (3, 3) ndarray of float64
        How the bag is stretched (`Camera.stretch`).
    most : int
        How many slots there can be.
    """
    if state.placements is before.placements:
        return state
    placements, planned = dict(state.placements), len(plan(before.placements).centers)
    loose = [i for i in placements if i not in before.placements]
    # What has been taken back is to find its slot empty.
    ahead = {at.slot for removal in state.undone for at in removal.values()}
    while True:
        slots = plan(placements)
        if len(slots.centers) != planned:
            loose, planned = list(placements), len(slots.centers)
        covered = frozenset().union(*(at.beneath(slots, stretch) for at in placements.values()))
        for i in loose:
            own = placements[i].slot
            if placements[i].placed is None and own in covered:
                full = covered | ahead | {at.slot for at in placements.values()}
                onward = (*range(own + 1, most), *range(own))
                slot = next((k for k in onward if k not in full), own)
                placements[i] = replace(placements[i], slot=slot)
        # A slot beyond those planned has them planned for more, and each lies elsewhere again.
        if len(plan(placements).centers) <= planned:
            break
    if all(placements[i].slot == at.slot for i, at in state.placements.items()):
        return state
    return replace(state, placements=placements)


def returning(state: SessionState, wanted: Iterable[int]) -> Group:
    """Return what goes back where some objects are to, the latest to leave first.

    Parameters
    ----------
    state : SessionState
    wanted : iterable of int
        Objects outside. What left as a group returns as one; a hidden member returns with it
        and stays hidden.
    """
    mates = {mate for i in wanted for mate in state.placements[i].group}
    return tuple(i for i in reversed(state.placements) if i in mates)


def restore(state: SessionState, ids: Sequence[int]) -> SessionState:
    """Put objects back into the bag.

    Parameters
    ----------
    state : SessionState
    ids : sequence of int
        The latest to leave first: the one restored last was the first to leave, so it stands at
        the head of the queue.
    """
    # Its way back is to be seen, and not the object alone in the middle.
    state = _left(state, ids)
    return replace(_put_back(state, ids[::-1]), undone=())


def _put_back(state: SessionState, ids: Sequence[int]) -> SessionState:
    gone = set(ids)
    kept = {i: placement for i, placement in state.placements.items() if i not in gone}
    return replace(state, placements=kept, queue=state.queue.put_back(ids))


def go_to(state: SessionState, step: int) -> SessionState:
    """Take back or repeat removals until so many are done, as far as they are known.

    Parameters
    ----------
    state : SessionState
    step : int
        Hidden objects go back too at 0: the start of an unpacking is a packed bag.
    """
    state, done = inspect(state, None), state.removals
    if step >= len(done):
        known = state.undone[: step - len(done)]
        again = {i: placement for removal in known for i, placement in removal.items()}
        return replace(
            state,
            placements={**state.placements, **again},
            # What leaves again only makes way, so that the rest of the queue still holds.
            queue=state.queue.without(again),
            undone=state.undone[len(known) :],
        )
    placements = state.placements
    gone = [{i: placements[i] for i in group if i in placements} for group in done[step:]]
    # The first taken back stands at the head of the queue, so that `unpack` goes on alike.
    back = _put_back(state, [i for removal in gone for i in removal])
    return replace(back, undone=(*gone, *state.undone))


def inspect(state: SessionState, object_id: int | None) -> SessionState:
    """Look at one object alone, or at none; a cut made while looking ends with it.

    Parameters
    ----------
    state : SessionState
    object_id : int or None
    """
    before = state.inspected
    if before is not None and before != object_id:
        style = state.styles.get(before)
        if style is not None and style.cut is not None:
            state = set_style(state, before, replace(style, cut=None))
    return replace(state, inspected=object_id)


def hide(state: SessionState, ids: Iterable[int]) -> SessionState:
    """Put objects out of sight.

    Parameters
    ----------
    state : SessionState
    ids : iterable of int
    """
    gone = frozenset(ids)
    state, queue = _left(state, gone), state.queue.without(gone)
    return replace(state, hidden=state.hidden | gone, queue=queue, undone=())


def show(state: SessionState, ids: Iterable[int]) -> SessionState:
    """Bring hidden objects into sight again.

    Parameters
    ----------
    state : SessionState
    ids : iterable of int
        The queue is emptied where one of them is in the bag: it may block others.
    """
    back = frozenset(ids) & state.hidden
    blocking = any(i not in state.placements for i in back)
    queue = replace(state.queue, groups=()) if blocking else state.queue
    return replace(state, hidden=state.hidden - back, queue=queue, undone=())


def isolate(state: SessionState, ids: Iterable[int], known: frozenset[int]) -> SessionState:
    """Show these objects and hide all others.

    Parameters
    ----------
    state : SessionState
    ids : iterable of int
    known : frozenset of int
        Every object.
    """
    wanted = frozenset(ids)
    # Shown first: what comes back into the bag empties the queue, what is hidden does not.
    return hide(show(state, wanted), known - wanted)


def _left(state: SessionState, ids: Collection[int]) -> SessionState:
    return inspect(state, None) if state.inspected in ids else state


def move(state: SessionState, object_id: int, placement: Placement) -> SessionState:
    """Keep an unpacked object another way: elsewhere, or turned.

    Parameters
    ----------
    state : SessionState
    object_id : int
    placement : Placement
    """
    if placement is state.placements[object_id]:
        return state
    return replace(state, placements={**state.placements, object_id: placement})


def place(
    placement: Placement,
    pose: Pose,
    slots: Slots,
    picture: Callable[[Matrix], tuple[float, float]],
) -> Placement:
    """Return a placement put somewhere else by hand; itself where it is there.

    Parameters
    ----------
    placement : Placement
    pose : Pose
        In pivot space.
    slots : Slots
        Of the window as it is now.
    picture : callable
        Given how the object is held, returns width and height of its picture, mm.

    Raises
    ------
    TypeError, ValueError
        As `checked_pose`.
    """
    wanted = checked_pose(pose)
    if wanted.is_at(placement.pose(slots, wanted.stretch)):
        return placement
    placed = replace(placement, placed=wanted, within=slots.window_mm)
    # Moved and not turned, its picture is as large as it was: no hull is needed.
    if np.array_equal(placed.rotation, pose.rotation):
        return placed
    return turn(placed, pose.rotation, picture)


def turn(
    placement: Placement, rotation: Matrix, picture: Callable[[Matrix], tuple[float, float]]
) -> Placement:
    """Return a placement held another way by hand; itself where it is held so.

    Parameters
    ----------
    placement : Placement
    rotation : (3, 3) ndarray of float64
        From (stretched) world axes to pivot axes.
    picture : callable
        As for `place`.

    Raises
    ------
    ValueError
        If it is no rotation.
    """
    held = checked_rotation(rotation)
    if np.array_equal(held, placement.rotation):
        return placement
    return placement.turned(held, picture(held))


def mirrors() -> Callable[[SessionState], SessionState]:
    """Return what mirrors all pictures of states, since the bag is mirrored from now on.

    Parts that states share they share after it too: a step that leaves placements alone is told
    by that.
    """
    # With each part, so that none is deleted and its number given to another.
    known: dict[int, tuple[object, Any]] = {}

    def once(part: T, made: Callable[[T], T]) -> T:
        if id(part) not in known:
            known[id(part)] = part, made(part)
        return known[id(part)][1]  # type: ignore[no-any-return]

    def mirrored(placements: Mapping[int, Placement]) -> dict[int, Placement]:
        return {i: once(at, lambda one: one.mirrored()) for i, at in placements.items()}

    def mirror(state: SessionState) -> SessionState:
        undone = once(state.undone, lambda removals: tuple(once(r, mirrored) for r in removals))
        return replace(state, placements=once(state.placements, mirrored), undone=undone)

    return mirror


def rename(state: SessionState, object_id: int, name: str, now: str) -> SessionState:
    """Give an object a name, where it is another than it has.

    Parameters
    ----------
    state : SessionState
    object_id : int
    name : str
        Line breaks and tabs in it become spaces.
    now : str
        What it is called.

    Raises
    ------
    TypeError
        If it is no text.
    ValueError
        If it is blank.
    """
    checked_kind(name, str, "name")
    if not name.strip():
        raise ValueError("name must not be blank")
    wanted = one_line(name)
    return state if wanted == now else replace(state, names={**state.names, object_id: wanted})


def set_style(state: SessionState, object_id: int, style: ObjectStyle | None) -> SessionState:
    """Give an object an opacity or a cut of its own.

    Parameters
    ----------
    state : SessionState
    object_id : int
    style : ObjectStyle or None
        None, or one that says nothing, takes both away.
    """
    # A new mapping: states before this one share the old.
    styles = {i: one for i, one in state.styles.items() if i != object_id}
    if style is not None and (style.transfer_function or style.cut):
        styles[object_id] = style
    return replace(state, styles=styles)


def edit_labels(
    state: SessionState,
    edit: Edit,
    known: frozenset[int],
    new_hues: Mapping[int, float],
    taken_whole: frozenset[int] | None,
    owner: Callable[[SurfacePoint], int],
) -> SessionState:
    """Follow an edit of the labels.

    Parameters
    ----------
    state : SessionState
    edit : Edit
        The last one made.
    known : frozenset of int
        The objects there are then.
    new_hues : mapping of int to float
        Of those that were not there before.
    taken_whole : frozenset of int, optional
        Objects that are gone at once: what was said of each goes to the one that took most of it.
        None for a brush: of what it covered little may have been left, and what it made is seen.
    owner : callable
        Given a point, tells which object has the voxel that it is on now.
    """
    origins = {i: origin_of(edit.change, i) for i in new_hues}
    parts = {i: f"{state.names[o]}, part" for i, o in origins.items() if o in state.names}
    noted = {i: state.notes[o] for i, o in origins.items() if o in state.notes}
    back = edit.change.reverse()
    said = state.names.keys() | state.colors.keys() | state.notes.keys() | state.flags.keys()
    heirs = {i: heir for i in sorted(said & (taken_whole or set())) if (heir := origin_of(back, i))}
    # What is cleared goes to nobody: that was said of one object, and not of all it became part of.
    sources = (*origins.items(), *((heir, gone) for gone, heir in heirs.items()))
    suspected = {i: state.flags[o] for i, o in sources if state.flags.get(o) == "suspicious"}
    # What a hand has just painted would else be gone at once.
    parted = origins if taken_whole is not None else {}
    return replace(
        _left(state, edit.change.touched),
        hues=_of_known(state.hues, known) | dict(new_hues),
        names=_inherited(state.names, heirs, known) | parts,
        measurements=_followed(state.measurements, edit, known, owner),
        colors=_inherited(state.colors, heirs, known),
        notes=_joined(state.notes, heirs, known) | noted,
        flags=_of_known(state.flags, known) | suspected,
        styles=_of_known(state.styles, known),
        hidden=(state.hidden & known) | {i for i, o in parted.items() if o in state.hidden},
        examples=state.examples & known,
        # Other objects may block each other now.
        queue=Queue(),
        undone=(),
        labels_edit=edit,
    )


def _followed(
    measurements: tuple[Measurement, ...],
    edit: Edit,
    known: frozenset[int],
    owner: Callable[[SurfacePoint], int],
) -> tuple[Measurement, ...]:
    """Have points of objects go along with the voxels that they are on."""

    def now(point: SurfacePoint) -> SurfacePoint:
        found = owner(point) if point.object_id in edit.change.touched else point.object_id
        if found and found not in known:
            found = origin_of(edit.change.reverse(), found) or found
        return replace(point, object_id=found)

    followed = tuple(replace(one, points=tuple(map(now, one.points))) for one in measurements)
    return measurements if followed == measurements else followed


def _inherited(
    values: Mapping[int, T], heirs: Mapping[int, int], known: frozenset[int]
) -> dict[int, T]:
    """Return what objects have of their own, or else of one that is part of them now."""
    passed_on = {heirs[i]: value for i, value in values.items() if i in heirs}
    return passed_on | _of_known(values, known)


def _joined(
    notes: Mapping[int, str], heirs: Mapping[int, int], known: frozenset[int]
) -> dict[int, str]:
    """Return the notes of objects, with those of what is part of them now."""
    joined = _of_known(notes, known)
    for gone, heir in heirs.items():
        if gone in notes:
            joined[heir] = f"{joined[heir]}; {notes[gone]}" if heir in joined else notes[gone]
    return joined


def _of_known(values: Mapping[int, T], known: frozenset[int]) -> dict[int, T]:
    return {i: value for i, value in values.items() if i in known}
