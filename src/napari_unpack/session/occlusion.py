"""What can leave along D: the whole result, and the quick one that is enough for one command."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import Vector
from napari_unpack.geometry.boxes import LabelBoxes, box_corners
from napari_unpack.geometry.occlusion_counts import OcclusionCounts
from napari_unpack.geometry.view import Camera
from napari_unpack.session.ray_queries import Mask, RayQueries, Size
from napari_unpack.tasks import Progress, Task
from napari_unpack.unpacking import BlockingGraph, ratios, unpackable_ids
from napari_unpack.unpacking.blocking_graph import blocking_graph, leading_groups
from napari_unpack.unpacking.occlusion import Rule
from napari_unpack.unpacking.queue import Group

if TYPE_CHECKING:
    import networkx as nx

    from napari_unpack.session.labels import LabelData


# Share of an object's samples behind others above which it is held by more than the corners of
# its neighbours' voxels, so that moving it would tell nothing new.
SURELY_HELD = 0.35

# Rays along one side: four million rays bound the time and the memory of one question.
MOST_RAYS = 2048

# Unit vectors come from cameras whose angles are rounded: closer than this they are one.
SAME_DIRECTION = 1e-6


@dataclass(frozen=True)
class OcclusionKey:
    """What a result on occlusion depends on.

    Parameters
    ----------
    revision : int
        Of the labels.
    direction : (float, float, float)
        D, unit vector in world.
    rule, tolerance
        See `UnpackingRules`.
    packed : frozenset of int
        Objects in the bag.
    """

    revision: int
    direction: tuple[float, float, float]
    rule: Rule
    tolerance: float
    packed: frozenset[int]

    def same_question(self, other: OcclusionKey) -> bool:
        """Tell whether another key differs at most in what is packed."""
        return (
            (self.revision, self.rule, self.tolerance)
            == (other.revision, other.rule, other.tolerance)
        ) and bool(np.allclose(self.direction, other.direction, rtol=0, atol=SAME_DIRECTION))

    def covers(self, wanted: OcclusionKey) -> bool:
        """Tell whether a result under this key serves: for fewer packed objects it does."""
        return self.same_question(wanted) and wanted.packed <= self.packed

    def gives_way(self, new: OcclusionKey) -> bool:
        """Tell whether a result under this key goes as one under a new key comes."""
        # What a tolerance exempts depends on all that was packed: kept while objects leave by other
        # rules, a result would hide what has become unpackable since.
        kept = (self.rule, self.tolerance) in (("exact", 0.0), (new.rule, new.tolerance))
        # The one for more objects serves again as soon as something comes back.
        fewer = new.packed < self.packed
        return (self.same_question(new) and not fewer) or not (kept or self.packed == new.packed)

    def equals(self, wanted: OcclusionKey) -> bool:
        """Tell whether a result under this key is for just these packed objects."""
        return self.same_question(wanted) and wanted.packed == self.packed


@dataclass(frozen=True, eq=False)
class OcclusionResult:
    """What can leave along D of the objects that were in the bag.

    Parameters
    ----------
    direction : (3,) ndarray of float64
        D, unit vector in world.
    packed : frozenset of int
        Objects that were in the bag.
    unpackable : frozenset of int
        Those that nothing blocked. What no ray meets counts too: nothing is known to be in
        front of it.
    blocking : BlockingGraph, optional
        What blocks what; None where there is no table.
    first_hit : mapping of int to float
        The paper's occlusion ratio, which ranks the objects where nothing is unpackable.
    seconds : float
        What it took.
    held : frozenset of int
        Those of which only rays say what blocks them, since so much did.
    """

    direction: Vector
    packed: frozenset[int]
    unpackable: frozenset[int]
    blocking: BlockingGraph | None
    first_hit: Mapping[int, float]
    seconds: float
    held: frozenset[int] = frozenset()

    def may_change(self, wanted: OcclusionKey) -> bool:
        """Tell whether the question asked anew of fewer packed objects may be answered otherwise.

        Rays hold an object at the corners of its neighbours' voxels as well. That tells nothing
        new while others hold it for sure, and does once one of them has left. The fewer there
        are, the more of them are blocked within the tolerance.
        """
        gone = self.packed - wanted.packed
        if self.blocking is None or wanted.tolerance > 0:
            return bool(gone)
        blockers = self.blocking.graph.predecessors
        return any(not gone.isdisjoint(blockers(i)) for i in self.held & wanted.packed)

    def is_swept(self, ids: Iterable[int], packed: frozenset[int]) -> bool:
        """Tell whether the voxels say who can leave, and all that must before some objects.

        Parameters
        ----------
        ids : iterable of int
            Packed ones.
        packed : frozenset of int
            Objects in the bag now, of those that were.
        """
        if self.blocking is None or not self.held:
            return True
        before = _all_before(ids, self.blocking.graph, packed)
        return not self._held_leaders(packed) and self.held.isdisjoint(before)

    def swept(
        self, ids: Iterable[int], packed: frozenset[int], blockers: Callable[[int], frozenset[int]]
    ) -> OcclusionResult:
        """Return the result in which the voxels say who can leave, and what must before some.

        Parameters
        ----------
        ids, packed
            As for `is_swept`.
        blockers : callable
            Moves an object; returns who of those that were in the bag it meets.

        Notes
        -----
        From each object to those in its way and to those in theirs: nobody else is moved.
        """
        found, unsure = self, self._held_leaders(packed).union(ids)
        while unsure and found.blocking is not None and found.held:
            graph, held = found.blocking.graph.copy(), set(found.held)
            for one in _all_before(unsure, graph, packed):
                if one in held:
                    held.remove(one)
                    graph.remove_edges_from(list(graph.in_edges(one)))
                    graph.add_edges_from((other, one) for other in blockers(one))
            found = replace(
                found,
                unpackable=_blocked_by_none(graph),
                blocking=BlockingGraph(graph),
                held=frozenset(held),
            )
            # What has moved may let others lead.
            unsure = found._held_leaders(packed)
        return found

    def _held_leaders(self, packed: frozenset[int]) -> frozenset[int]:
        """Return those who could leave, alone or in a group, if rays were right about them."""
        if self.blocking is None or not self.held:
            return frozenset()
        return self.held.intersection(chain(*self.blocking.among(packed).unpackable_groups()))

    def groups(self, packed: frozenset[int], max_group_size: int) -> list[Group]:
        """Return what can leave: single objects, and interlocked groups.

        Parameters
        ----------
        packed : frozenset of int
            Objects in the bag now, of those that were.
        max_group_size : int
            Larger groups stay.
        """
        if self.blocking is None:
            return [(i,) for i in sorted(self.unpackable & packed)]
        whole = self.blocking.among(packed).unpackable_groups()
        return [group for group in whole if len(group) <= max_group_size]

    def least_occluded(self, packed: frozenset[int]) -> int:
        """Return the packed object with the least occlusion ratio, ties by ID."""
        return min(packed, key=lambda i: (self.first_hit.get(i, 0.0), i))


def _blocked_by_none(graph: nx.DiGraph) -> frozenset[int]:
    return frozenset(i for i, before in graph.in_degree() if not before)


def _all_before(ids: Iterable[int], graph: nx.DiGraph, packed: frozenset[int]) -> Iterator[int]:
    """Yield objects and all packed ones that must leave before them, each once.

    What blocks an object is looked up after it was yielded.
    """
    seen = set(ids)
    left = sorted(seen)
    while left:
        one = left.pop()
        yield one
        fresh = packed.intersection(graph.predecessors(one)) - seen
        seen |= fresh
        left += fresh


@dataclass(frozen=True, eq=False)
class OcclusionInputs:
    """What rays are cast at and voxels moved in, as they are at one moment.

    Parameters
    ----------
    rays : RayQueries
    label_data : LabelData
    lower, upper : (3,) ndarray of float64
        Corners of the bag, mm z y x.
    pitch : float
        Between rays, mm.
    backend : {"auto", "cpu", "gl"}
    """

    rays: RayQueries
    label_data: LabelData
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    pitch: float
    backend: str

    def task(
        self, key: OcclusionKey, known: OcclusionResult | None, sure: Iterable[int]
    ) -> Task[OcclusionResult]:
        """Return the task of what can leave along D.

        Parameters
        ----------
        key : OcclusionKey
        known : OcclusionResult, optional
            For as many or more packed objects: no rays are cast then.
        sure : iterable of int
            As for `OcclusionResult.is_swept`.
        """
        wanted = tuple(sure)
        # Of more objects, it may not stand under the key of fewer: it would pass for asked afresh.
        own = key if known is None else replace(key, packed=known.packed)
        visible, boxes = self.label_data.visible(own.packed), self.label_data.boxes

        def run(_: Progress) -> OcclusionResult:
            found = known
            if found is None:
                direction = np.array(own.direction)
                camera, size = view_along(direction, self.lower, self.upper, self.pitch)
                found = find_occlusion(own, self.rays, camera, size, visible, self.backend)
            if found.is_swept(wanted, key.packed):
                return found
            return found.swept(wanted, key.packed, _sweeping(own, self.rays, boxes, visible))

        return Task(own, run)


def find_occlusion(
    key: OcclusionKey, rays: RayQueries, camera: Camera, size: Size, visible: Mask, backend: str
) -> OcclusionResult:
    """Find what can leave along D (Li et al. 2012, section 5.1); runs on any thread.

    Parameters
    ----------
    key : OcclusionKey
    rays : RayQueries
    camera : Camera
        From `view_along`, with `size`.
    size : (int, int)
        Rays, height and width.
    visible : (M,) ndarray of bool
        By ID, what is packed.
    backend : {"auto", "cpu", "gl"}

    Notes
    -----
    Rays rank the objects and tell what is unpackable within the tolerance. What blocks what is
    what the voxels themselves meet on their way, where that can be had: off the axes rays find
    things that merely touch to be held by the corners of each other's voxels. What is held by
    more than a few corners need not be moved to tell that it stays: there the rays' table serves,
    until it is to leave, or it is asked what must leave before (`OcclusionResult.swept`): rays
    miss what is met by a sliver.
    """
    start = perf_counter()
    direction = np.array(key.direction)
    counts = rays.occlusion_counts(camera, visible, size, backend)
    unseen = key.packed - {int(i) for i in counts.ids}
    unpackable = frozenset(unpackable_ids(counts, key.rule, key.tolerance)) | unseen
    held: frozenset[int] = frozenset()
    table = _swept_table(key, rays, direction, visible, counts)
    if table is None:
        blocking = None
        # Other rules count rays or first objects, which do not say which object blocks.
        if counts.blocks is not None and key.rule == "exact":
            blocking = BlockingGraph(blocking_graph(counts.blocks, counts.ids, unpackable))
    else:
        ids, blocks, held = table
        # Within the tolerance an object leaves although something blocks it.
        exempt = unpackable if key.tolerance > 0 else frozenset()
        blocking = BlockingGraph(blocking_graph(blocks, ids, exempt))
        unpackable = _blocked_by_none(blocking.graph)
    if blocking is not None:
        # Counts have no rows for them, and a graph of all that is packed is asked about them.
        blocking.graph.add_nodes_from(unseen)
    seconds, held = perf_counter() - start, held - unpackable
    first_hit = ratios(counts)
    return OcclusionResult(direction, key.packed, unpackable, blocking, first_hit, seconds, held)


def _sweeping(
    key: OcclusionKey, rays: RayQueries, boxes: LabelBoxes, visible: Mask
) -> Callable[[int], frozenset[int]]:
    """Return what moves an object along D and returns whom it meets."""
    blockers = rays.sweep_test(np.array(key.direction), visible)
    return lambda i: blockers(i, boxes.slices(i), len(key.packed))


def _swept_table(
    key: OcclusionKey, rays: RayQueries, direction: Vector, visible: Mask, counts: OcclusionCounts
) -> tuple[NDArray[np.int64], NDArray[np.bool_], frozenset[int]] | None:
    """Return what blocks what among the packed, by voxels but for the last."""
    if not rays.can_sweep or key.rule != "exact" or counts.blocks is None:
        return None
    # Moving voxels is what takes long, so the less is moved the better.
    met = counts.ids
    held = np.zeros_like(visible)
    held[met] = counts.exact_samples[met] > SURELY_HELD * counts.samples[met]
    table = rays.sweep_table(direction, visible, ~held)
    if table is None:
        return None
    ids, blocks = table
    # Every ID that a ray meets is among those moved or held.
    places = np.searchsorted(ids, met)
    columns = held[met]
    blocks[np.ix_(places, places[columns])] = counts.blocks[:, columns]
    return ids, blocks, frozenset(int(i) for i in met[columns])


@dataclass(frozen=True)
class NextUnpackableKey:
    """What the next to leave depend on.

    Parameters
    ----------
    occlusion : OcclusionKey
    chosen : frozenset of int, optional
        Those asked about; None where it is about what comes next.
    count : int
        How many objects are to leave.
    max_group_size : int
    restored : tuple of int
        What the queue asks about first.
    """

    occlusion: OcclusionKey
    chosen: frozenset[int] | None
    count: int
    max_group_size: int
    restored: Group

    def covers(self, wanted: NextUnpackableKey) -> bool:
        """Tell whether a result under this key serves: for fewer objects it does."""
        alike = replace(self, occlusion=wanted.occlusion, count=wanted.count) == wanted
        return alike and wanted.count <= self.count and self.occlusion.equals(wanted.occlusion)


@dataclass(frozen=True, eq=False)
class NextUnpackable:
    """Enough of what is unpackable to carry out one command.

    Parameters
    ----------
    groups : tuple of tuple of int
        What can leave, in the order of the queue.
    seconds : float
        What it took.
    """

    groups: tuple[Group, ...]
    seconds: float


def find_next_unpackable(
    key: NextUnpackableKey,
    order: Group,
    rays: RayQueries,
    visible: Mask,
    boxes: LabelBoxes,
    seconds: float,
    clock: Callable[[], float],
) -> NextUnpackable | None:
    """Find what leaves first along D by moving the foremost objects alone; runs on any thread.

    Parameters
    ----------
    key : NextUnpackableKey
        Of the rule "exact" without tolerance.
    order : tuple of int
        What to ask about, one after the other.
    rays : RayQueries
        That can sweep.
    visible : (M,) ndarray of bool
        By ID, what is packed.
    boxes : LabelBoxes
    seconds : float
        No further object is moved after so long.
    clock : callable
        Returns the time in seconds.

    Returns
    -------
    NextUnpackable or None
        None where the time did not suffice or fewer can leave than are to.

    Notes
    -----
    What is unpackable by this rule is decided by moving an object's voxels, and the queue is
    ordered by where objects lie: neither needs all of them. What is found first stands first in
    the queue of the whole result.
    """
    start = clock()
    blockers = rays.sweep_test(np.array(key.occlusion.direction), visible)

    def in_time(object_id: int, most: int) -> frozenset[int]:
        if clock() - start > seconds:
            # The generator of groups cannot be left in any other way.
            raise TimeoutError
        return blockers(object_id, boxes.slices(object_id), most)

    found: list[Group] = []
    groups = leading_groups(order, in_time, key.max_group_size)
    try:
        while sum(map(len, found)) < key.count:
            found.append(next(groups))
    except (StopIteration, TimeoutError):
        return None
    return NextUnpackable(tuple(found), clock() - start)


def in_turn(
    ids: Iterable[int],
    packed: frozenset[int],
    unpackable: Callable[[frozenset[int]], frozenset[int]],
) -> list[Group]:
    """Return those that can leave where no table says who blocks whom, blockers first.

    Parameters
    ----------
    ids : iterable of int
        Who is to leave.
    packed : frozenset of int
        Objects in the bag.
    unpackable : callable
        Given who is packed, tells who can leave: new rays, in every turn.
    """
    groups: list[Group] = []
    left = [i for i in dict.fromkeys(ids) if i in packed]
    while free := unpackable(packed).intersection(left):
        groups += [(i,) for i in left if i in free]
        left, packed = [i for i in left if i not in free], packed - free
    return groups


def view_along(
    direction: Vector, lower: NDArray[np.float64], upper: NDArray[np.float64], pitch: float
) -> tuple[Camera, Size]:
    """Return the orthographic camera and size of the picture that decides what can leave along D.

    Parameters
    ----------
    direction : (3,) ndarray of float64
        D; the camera looks along -D.
    lower, upper : (3,) ndarray of float64
        The bag's box, world mm.
    pitch : float
        Distance of rays, mm: the voxel pitch, so that nothing thin slips between them.

    Returns
    -------
    camera : Camera
        Just holding the box.
    size : (int, int)
        Rays, height and width.

    Notes
    -----
    Across an axis whose voxels are one pitch long, rays go through the voxels' middles: on
    their faces rounding would pass over one row and look at its neighbour twice.
    """
    # Whichever way is up for the user: who can leave is a matter of D alone.
    center = (lower + upper) / 2
    looking = Camera.looking(-direction, None, center, 1.0)
    flat = (box_corners(lower, upper) - center) @ looking.rotation[1:].T
    extent = np.ptp(flat, axis=0)
    pitch = max(pitch, float(extent.max()) / MOST_RAYS)
    # A whole number of rays, give or take a rounding error, is centred on the voxels.
    rows, columns = (int(n) for n in np.maximum(np.ceil(extent / pitch - 1e-6), 1))
    return Camera(looking.rotation, center, rows * pitch), (rows, columns)
