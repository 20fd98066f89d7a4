"""The directional blocking graph: groups that leave together, and what must leave first."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property

import networkx as nx
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

Ids = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class BlockingGraph:
    """The directional blocking graph of the objects that were in the bag when it was asked.

    An edge from i to j says that i stands in front of j along D. Taking objects away takes their
    edges away and changes no other, so one answer serves until the direction changes or an
    object comes back that was away when it was asked.

    Parameters
    ----------
    graph : networkx.DiGraph
        Nodes are object IDs.
    """

    graph: nx.DiGraph
    _whole: BlockingGraph | None = field(default=None, repr=False)

    @cached_property
    def _edges(self) -> tuple[Ids, Ids, Ids]:
        """IDs ascending, and of every edge the places in them of who blocks and who is blocked."""
        ids = np.array(sorted(self.graph), dtype=np.int64)
        pairs = np.array(list(self.graph.edges), dtype=np.int64).reshape(-1, 2)
        front, behind = np.searchsorted(ids, pairs).T
        return ids, front, behind

    def among(self, packed: Iterable[int]) -> BlockingGraph:
        """Return the graph of those still packed."""
        return BlockingGraph(self.graph.subgraph(packed), self._whole or self)

    def unpackable_groups(self) -> list[tuple[int, ...]]:
        """Return the groups that no object outside them blocks, smallest first, then by ID.

        Quick enough to be asked at every change of a thousand objects: the graph is looked over
        once for all that are left of it.
        """
        ids, front, behind = (self._whole or self)._edges
        here, among, part = self._circles
        front, behind = front[among], behind[among]
        unpackable = np.zeros(len(ids), np.bool_)
        unpackable[part[here]] = True
        unpackable[part[behind[part[front] != part[behind]]]] = False
        return self._groups(here & unpackable[part])

    def interlocked(self, wanted: Iterable[int]) -> list[tuple[int, ...]]:
        """Return the groups that can only leave together and hold any of these objects."""
        ids = (self._whole or self)._edges[0]
        here, _, part = self._circles
        chosen = part[here & np.isin(ids, list(wanted))]
        return self._groups(here & np.isin(part, chosen))

    @cached_property
    def _circles(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.int32]]:
        """Which IDs are here, which edges are among them, and the number of each ID's group."""
        # Edges of the first graph are made once; what has left is masked out.
        ids, front, behind = (self._whole or self)._edges
        here = np.isin(ids, list(self.graph))
        among = here[front] & here[behind]
        edges = csr_array(
            (np.ones(among.sum(), np.bool_), (front[among], behind[among])), (len(ids), len(ids))
        )
        # Objects that block each other in a circle can only leave together: a strong component.
        return here, among, connected_components(edges, connection="strong")[1]

    def _groups(self, places: NDArray[np.bool_]) -> list[tuple[int, ...]]:
        ids, part = (self._whole or self)._edges[0], self._circles[2]
        members: dict[int, list[int]] = {}
        for place in np.flatnonzero(places):
            members.setdefault(int(part[place]), []).append(int(ids[place]))
        return sorted((tuple(group) for group in members.values()), key=lambda g: (len(g), g))

    def blockers(self, ids: Iterable[int]) -> set[int]:
        """Return the objects outside `ids` that block one of them directly."""
        wanted = set(ids)
        return {before for i in wanted for before in self.graph.predecessors(i)} - wanted

    def needed(self, target: int) -> set[int]:
        """Return the smallest set, the target included, that must leave to get at the target.

        Raises
        ------
        ValueError
            If the target is not in the graph.
        """
        if target not in self.graph:
            raise ValueError(f"target must be a packed object, got {target!r}")
        return {*nx.ancestors(self.graph, target), target}

    def removals(self, ids: Iterable[int]) -> list[tuple[int, ...]]:
        """Order objects into groups so that none leaves before what blocks it.

        Notes
        -----
        Removable subassemblies of a directional blocking graph, Wilson & Latombe 1994; the paper's
        "group-by-group" (section 5) leaves open which groups.
        """
        part = self.graph.subgraph(ids)
        # Components of a circle become one node, so the order below exists.
        condensed = nx.condensation(part)
        # Ties go to the smallest ID, so that the same bag is unpacked alike on every machine.
        order = nx.lexicographical_topological_sort(
            condensed, key=lambda node: min(condensed.nodes[node]["members"])
        )
        return [tuple(sorted(condensed.nodes[node]["members"])) for node in order]


def blocking_graph(
    blocks: NDArray[np.bool_], ids: Iterable[int], unpackable: Iterable[int] = ()
) -> nx.DiGraph:
    """Make the graph of a table of blockers: edge i -> j where i blocks j.

    Parameters
    ----------
    blocks : (n, n) ndarray of bool
        Row blocks column.
    ids : (n,) iterable of int
        The IDs of rows and columns.
    unpackable : iterable of int
        IDs to be taken as blocked by no object.

    Raises
    ------
    ValueError
        If the table is not square with one row an ID.
    """
    names = [int(i) for i in ids]
    table = np.asarray(blocks, dtype=bool)
    if table.shape != (len(names), len(names)):
        raise ValueError(f"blocks must be ({len(names)}, {len(names)}), got shape {table.shape}")
    exempt = set(unpackable)
    graph = nx.DiGraph()
    graph.add_nodes_from(names)
    for row, column in zip(*np.nonzero(table), strict=True):
        if row != column and names[column] not in exempt:
            graph.add_edge(names[row], names[column])
    return graph


def leading_groups(
    order: Iterable[int], blockers: Callable[[int, int], frozenset[int]], most: int
) -> Iterator[tuple[int, ...]]:
    """Find who can leave, foremost first, asking about no more objects than that takes.

    Parameters
    ----------
    order : iterable of int
        Everybody in the bag, those wanted first at the head.
    blockers : callable
        Given an object and a number, returns who blocks it directly, or more than that number
        of them.
    most : int
        Objects in a group.

    Yields
    ------
    tuple of int
        The groups of `BlockingGraph.unpackable_groups` with at most so many members, each as soon
        as its first member in the order is reached.

    Notes
    -----
    A group that no object outside blocks holds everybody that must leave before any one of it, and
    so is found from each of its members by going from blockers to their blockers. What leads to
    more than `most` objects is in no such group.
    """
    known: dict[int, frozenset[int]] = {}
    yielded: set[int] = set()
    for first in order:
        if first in yielded:
            continue
        graph: nx.DiGraph = nx.DiGraph()
        graph.add_node(first)
        asked: set[int] = set()
        # Go from blockers to their blockers until the circle is closed or too large.
        while len(graph) <= most and (left := graph.nodes - asked):
            # The smallest, so that the same objects are asked about on every run.
            one = min(left)
            asked.add(one)
            if one not in known:
                known[one] = blockers(one, most - 1)
            graph.add_edges_from((other, one) for other in known[one])
        if len(graph) <= most and nx.is_strongly_connected(graph):
            yielded.update(graph)
            yield tuple(sorted(graph))
