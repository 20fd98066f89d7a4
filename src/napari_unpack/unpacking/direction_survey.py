"""Which objects block which along 26 directions: the best one, and the plan of a reveal."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from napari_unpack.geometry.axes import Vector
from napari_unpack.geometry.occlusion_counts import OcclusionCounts
from napari_unpack.unpacking.occlusion import unpackable_ids
from napari_unpack.unpacking.queue import Group

Mask = NDArray[np.bool_]

# (26, 3) unit vectors to the faces, edges and corners of a cube; k and 25 - k are opposite.
DIRECTIONS_26: NDArray[np.float64] = np.array(
    [
        np.array(steps) / np.linalg.norm(steps)
        for steps in product((-1.0, 0.0, 1.0), repeat=3)
        if any(steps)
    ]
)
DIRECTIONS_26.flags.writeable = False


@dataclass(frozen=True, eq=False)
class DirectionalBlocking:
    """Who stands in front of whom along one direction.

    Parameters
    ----------
    direction : (3,) ndarray of float64
        D, unit vector in world.
    ids : (n,) ndarray of int64
        Objects that were in the bag, ascending.
    blocks : (n, n) ndarray of bool
        Row blocks column; the diagonal is False.
    """

    direction: Vector
    ids: NDArray[np.int64]
    blocks: Mask

    @classmethod
    def of(
        cls, direction: Vector, counts: OcclusionCounts, packed: Collection[int], tolerance: float
    ) -> DirectionalBlocking | None:
        """Make it from counts along -D; None where they hold no table.

        Objects that no ray meets block nothing. Objects that are unpackable within the tolerance
        are blocked by nothing.

        Parameters
        ----------
        direction : (3,) ndarray
            D, world.
        counts : OcclusionCounts
            Along -D.
        packed : collection of int
            IDs in the bag.
        tolerance : float
            Share of an object that may be occluded.
        """
        if counts.blocks is None:
            return None
        ids = np.array(sorted(packed), dtype=np.int64)
        blocks = np.zeros((len(ids), len(ids)), dtype=np.bool_)
        # Counts name only the objects that a ray met.
        rows = np.searchsorted(ids, counts.ids)
        blocks[np.ix_(rows, rows)] = counts.blocks
        if tolerance > 0:
            blocks[:, np.searchsorted(ids, unpackable_ids(counts, "exact", tolerance))] = False
        np.fill_diagonal(blocks, False)
        return cls(direction, ids, blocks)

    def opposite(self) -> DirectionalBlocking:
        """Return the blocking along -D: what was in front is behind. Holds at tolerance 0."""
        return DirectionalBlocking(-self.direction, self.ids, self.blocks.T)

    def among(self, packed: Collection[int]) -> DirectionalBlocking:
        """Return the blocking of those still packed."""
        keep = np.isin(self.ids, list(packed))
        return DirectionalBlocking(self.direction, self.ids[keep], self.blocks[np.ix_(keep, keep)])

    def unpackable_groups(self) -> list[Group]:
        """Return the objects, and groups that hold together, that no object else blocks."""
        # As in `BlockingGraph.unpackable_groups`, on a dense table: 26 of them are asked at once.
        count, part = connected_components(csr_array(self.blocks), connection="strong")
        front, behind = np.nonzero(self.blocks)
        unpackable = np.ones(count, dtype=np.bool_)
        unpackable[part[behind[part[front] != part[behind]]]] = False
        # Sorted by part, members of a group stand side by side, in order of their IDs.
        order = np.argsort(part, kind="stable")
        members = np.split(self.ids[order], np.cumsum(np.bincount(part, minlength=count))[:-1])
        return [tuple(int(i) for i in members[k]) for k in np.flatnonzero(unpackable)]

    def needed(self, target: int) -> frozenset[int]:
        """Return the target and everything that must leave before it, directly or not.

        Notes
        -----
        The ancestors of the target in the directional blocking graph: the least set, and the
        only minimal one.
        """
        start = int(np.flatnonzero(self.ids == target)[0])
        found = breadth_first_order(csr_array(self.blocks.T), start, return_predecessors=False)
        return frozenset(self.ids[found].tolist())


@dataclass(frozen=True, eq=False)
class BestDirection:
    """A direction and what could leave along it.

    Parameters
    ----------
    direction : (3,) ndarray of float64
        D, unit vector in world.
    groups : tuple of tuple of int
        Objects that no object blocks; those that hold together are one group.
    """

    direction: Vector
    groups: tuple[Group, ...]

    @property
    def ids(self) -> frozenset[int]:
        """Every object that could leave."""
        return frozenset(i for group in self.groups for i in group)


def best_direction(
    blockings: Sequence[DirectionalBlocking], packed: Collection[int], most: int, near: Vector
) -> BestDirection | None:
    """Return the direction along which the most objects could leave; None without any.

    Parameters
    ----------
    blockings : sequence of DirectionalBlocking
        Of objects among which the packed ones are.
    packed : collection of int
        Who is in the bag now.
    most : int
        Groups larger than this do not count.
    near : (3,) ndarray of float64
        Ties go to the direction nearest this one.
    """
    ways = []
    for blocking in blockings:
        groups = [g for g in blocking.among(packed).unpackable_groups() if len(g) <= most]
        ways.append(BestDirection(blocking.direction, tuple(sorted(groups))))
    ways = [way for way in ways if way.groups]
    if not ways:
        return None
    # Rounded, so that directions that are equally near do not depend on the last bit.
    return max(ways, key=lambda way: (len(way.ids), round(float(way.direction @ near), 6)))


@dataclass(frozen=True, eq=False)
class RevealPlan:
    """The least that must leave for an object to leave.

    Parameters
    ----------
    target : int
    direction : (3,) ndarray of float64
        D, unit vector in world.
    ids : frozenset of int
        Who leaves, the target included.
    """

    target: int
    direction: Vector
    ids: frozenset[int]

    @property
    def first(self) -> frozenset[int]:
        """Who must leave before the target, or with it."""
        return self.ids - {self.target}


def reveal_plans(
    blockings: Sequence[DirectionalBlocking], packed: Collection[int], target: int, near: Vector
) -> list[RevealPlan]:
    """Return what must leave along each direction for a buried object to leave, the least first.

    Parameters
    ----------
    blockings : sequence of DirectionalBlocking
        One a direction.
    packed : collection of int
        IDs in the bag.
    target : int
        ID of the buried object.
    near : (3,) ndarray of float64
        The direction that wins ties, world.

    Raises
    ------
    ValueError
        If there is no blocking, or the target is not packed.
    """
    if not blockings or target not in packed:
        raise ValueError(f"target must be a packed object and a direction known, got {target!r}")
    found = [
        RevealPlan(target, blocking.direction, blocking.among(packed).needed(target))
        for blocking in blockings
    ]
    return sorted(found, key=lambda one: (len(one.ids), -round(float(one.direction @ near), 6)))
