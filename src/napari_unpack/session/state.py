"""What a session is at one moment, immutable: undo keeps the old ones."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace

import numpy as np

from napari_unpack.appearance import TransferFunction
from napari_unpack.geometry.axes import Matrix, Vector
from napari_unpack.geometry.transforms import Pose
from napari_unpack.rendering.object_style import ObjectStyle
from napari_unpack.session.labels import Edit
from napari_unpack.session.object_state import ObjectState as ObjectState
from napari_unpack.unpacking import Queue, Slots

HALF_TURN = np.diag([-1.0, -1.0, 1.0])
"""A reflection in a point and this: a reflection of right and left in the picture."""


@dataclass(frozen=True, eq=False)
class Placement:
    """How an unpacked object is kept.

    Parameters
    ----------
    slot : int
        Number of its place beside the bag.
    rotation : (3, 3) ndarray of float64
        How it is held, from (stretched) world axes to pivot axes.
    picture_mm : (float, float)
        Width and height of its picture at scale 1, as it was held when it left.
    direction : (3,) ndarray of float64
        The D along which it left, world.
    group : tuple of int
        The objects that left with it, itself included.
    placed : Pose, optional
        Where a person put it, in place of the slot.
    within : (float, float), optional
        Height and width in mm of the window it was put into; in another window it keeps its
        share of the way from the middle to the edge, and has the size it would have in its slot.
    turned_mm : (float, float), optional
        Width and height of its picture as a person turned it.
    """

    slot: int
    rotation: Matrix
    picture_mm: tuple[float, float]
    direction: Vector
    group: tuple[int, ...]
    placed: Pose | None = None
    within: tuple[float, float] | None = None
    turned_mm: tuple[float, float] | None = None

    def pose(self, slots: Slots, stretch: Matrix) -> Pose:
        """Return its pose in pivot space, where the bag is stretched so (`Camera.stretch`)."""
        scale = slots.scale(*self.picture_mm)
        if self.turned_mm is not None:
            scale = min(scale, slots.cell_mm / max(self.turned_mm))
        if self.placed is None:
            return Pose(slots.centers[self.slot], self.rotation, scale, stretch)
        placed = replace(self.placed, stretch=stretch)
        if self.within is None or self.within == slots.window_mm:
            return placed
        share = np.divide(slots.window_mm, self.within)
        return replace(placed, center=placed.center * np.array([1.0, *share]), scale=scale)

    def turned(self, rotation: Matrix, picture_mm: tuple[float, float]) -> Placement:
        """Return it held another way, with that picture: it stays in its place and fits there."""
        placed = None if self.placed is None else replace(self.placed, rotation=rotation)
        return replace(self, rotation=rotation, placed=placed, turned_mm=picture_mm)

    def mirrored(self) -> Placement:
        """Return it for a bag that is mirrored from now on, its picture mirrored likewise."""
        placed = self.placed
        if placed is not None:
            placed = replace(placed, rotation=HALF_TURN @ placed.rotation)
        return replace(self, rotation=HALF_TURN @ self.rotation, placed=placed)


@dataclass(frozen=True, eq=False)
class SessionState:
    """All that undo brings back.

    Parameters
    ----------
    out : dict of int to Placement
        Objects outside the bag, in the order in which they left.
    hidden : frozenset of int
        Objects put out of sight, in the bag or outside.
    inspected : int, optional
        The object looked at alone.
    queue : Queue
        Who leaves next.
    hues : mapping of int to float
        By ID.
    names : mapping of int to str
        By ID, where a person gave one.
    direction : str or (3,) tuple of float, optional
        D as it was asked for; None is the opposite of the view.
    ahead : tuple of dict of int to Placement
        Departures that `at_step` has taken back, the next one first: going forward again
        repeats them. Any other command that moves, hides or shows objects forgets them.
    studies : mapping of int to ObjectStyle
        By ID, how those are shown alone that have an opacity or a cut of their own.
    edit : Edit, optional
        The last repair of the labels; None as they were given.
    good : frozenset of int
        Objects a person marked as examples of whole ones.
    transfer_function : TransferFunction
    """

    transfer_function: TransferFunction
    hues: Mapping[int, float]
    out: dict[int, Placement] = field(default_factory=dict)
    hidden: frozenset[int] = frozenset()
    inspected: int | None = None
    queue: Queue = field(default_factory=Queue)
    names: Mapping[int, str] = field(default_factory=dict)
    direction: str | tuple[float, float, float] | None = None
    ahead: tuple[Mapping[int, Placement], ...] = ()
    edit: Edit | None = None
    good: frozenset[int] = frozenset()
    studies: Mapping[int, ObjectStyle] = field(default_factory=dict)

    @property
    def removals(self) -> tuple[tuple[int, ...], ...]:
        """Who is out, group by group in the order in which they left."""
        return tuple(dict.fromkeys(placement.group for placement in self.out.values()))

    def at_step(self, step: int) -> SessionState:
        """Return the situation with so many departures done, as far as they are known.

        Hidden objects go too: the start of an unpacking is a packed bag.
        """
        done = self.removals
        if step >= len(done):
            known = self.ahead[: step - len(done)]
            placements = {i: placement for departure in known for i, placement in departure.items()}
            return replace(self.with_out(placements), ahead=self.ahead[len(known) :])
        gone = [{i: self.out[i] for i in group if i in self.out} for group in done[step:]]
        back = [i for departure in gone for i in departure]
        return replace(self.with_back(back), ahead=(*gone, *self.ahead))

    def state(self, object_id: int) -> ObjectState:
        """Return where an object is once nobody flies any more."""
        if object_id in self.hidden:
            return ObjectState.HIDDEN
        if object_id == self.inspected:
            return ObjectState.INSPECTED
        return ObjectState.UNPACKED if object_id in self.out else ObjectState.PACKED

    def with_out(self, placements: Mapping[int, Placement]) -> SessionState:
        """Return the situation after objects have left the bag."""
        queue = self.queue.without(placements)
        return replace(self, out={**self.out, **placements}, queue=queue, ahead=())

    def with_back(self, ids: Iterable[int]) -> SessionState:
        """Return the situation after objects have gone back, the first given at the head."""
        back = tuple(ids)
        returned = set(back)
        kept = {i: placement for i, placement in self.out.items() if i not in returned}
        return replace(self, out=kept, queue=self.queue.put_back(back), ahead=())

    def with_hidden(self, ids: Iterable[int]) -> SessionState:
        """Return the situation after objects have been put out of sight."""
        gone = frozenset(ids)
        inspected = None if self.inspected in gone else self.inspected
        queue = self.queue.without(gone)
        return replace(self, hidden=self.hidden | gone, inspected=inspected, queue=queue, ahead=())

    def with_shown(self, ids: Iterable[int]) -> SessionState:
        """Return the situation after objects have come into sight again.

        The queue is emptied where one of them is in the bag: it may block others.
        """
        back = frozenset(ids) & self.hidden
        blocking = any(i not in self.out for i in back)
        queue = replace(self.queue, groups=()) if blocking else self.queue
        return replace(self, hidden=self.hidden - back, queue=queue, ahead=())

    def with_changes_of(self, source: SessionState, target: SessionState) -> SessionState:
        """Return this situation with what differs from `source` to `target` set as in `target`.

        Undoing a step takes back what that step changed and leaves alone what has changed
        otherwise since, such as hues renewed for another view.
        """
        changes = {
            f.name: getattr(target, f.name)
            for f in fields(self)
            if getattr(source, f.name) is not getattr(target, f.name)
        }
        return replace(self, **changes)
