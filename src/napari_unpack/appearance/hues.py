"""Hues on a circle: one arc a colour class, and colours that stay from view to view."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import networkx as nx

from napari_unpack.appearance.coloring import color_classes
from napari_unpack.appearance.steady import keep_hues


def assign_hues(
    graph: nx.Graph,
    previous: Mapping[int, float] | None = None,
    margin: float = 0.0,
    separation: float | None = None,
    locked: Collection[int] = (),
) -> dict[int, float]:
    """Give every object a hue that its neighbours in this view do not have.

    Parameters
    ----------
    graph : networkx.Graph
        From `interference`: nodes are object IDs.
    previous : mapping of int to float, optional
        Hues of the last view. They stay where they still separate; as few objects as can be
        found move, each as little as it can.
    margin : float
        Fraction of every arc in [0, 1) left empty, half at each end: neighbours of different
        arcs are at least margin / C apart. 0 is the paper's.
    separation : float, optional
        With `previous`: hue distance under which two neighbours count as too alike, by default
        margin / C (0.5 / C where there is no margin), which a fresh assignment always meets.
    locked : collection of int
        With `previous`: objects whose hue is not to change.

    Returns
    -------
    dict of int to float
        Hue in [0, 1) of every node.

    Raises
    ------
    ValueError
        If `margin` is outside [0, 1).

    Notes
    -----
    Li et al. 2012, section 4.2, see `arc_hues`; keeping hues is the paper's future work
    (section 7), see `keep_hues`. Where not every conflict can be settled by moving objects one
    by one the assignment starts afresh, keeping the locked hues alone.
    """
    if not 0.0 <= margin < 1.0:
        raise ValueError(f"margin must be in [0, 1), got {margin!r}")
    classes = color_classes(graph)
    known = {node: previous[node] for node in graph if node in previous} if previous else {}
    if not known:
        return arc_hues(graph, classes, margin)
    safe = margin or 0.5
    apart = safe / max(len(classes), 1) if separation is None else separation
    kept = keep_hues(graph, known, apart, locked)
    if kept is not None:
        return kept
    fresh = arc_hues(graph, classes, safe)
    return fresh | {node: hue for node, hue in known.items() if node in locked}


def arc_hues(graph: nx.Graph, classes: list[list[int]], margin: float = 0.0) -> dict[int, float]:
    """Spread colour classes over equal arcs of the hue circle.

    Parameters
    ----------
    graph : networkx.Graph
        The interference graph.
    classes : list of list of int
        From `color_classes`; class k gets the arc [k / C, (k + 1) / C).
    margin : float
        Fraction of every arc left empty.

    Returns
    -------
    dict of int to float

    Notes
    -----
    Li et al. 2012, section 4.2 and figure 3. The n members of an arc stand at (j + 1/2) / n of
    it, the one with most neighbours in the next class furthest from it, so first in its arc;
    ties by ID. With two classes the next one lies at both ends of the arc: the member with most
    neighbours stands in the middle. With one nobody interferes and order is by ID.
    """
    hues: dict[int, float] = {}
    for k, members in enumerate(classes):
        n, following = len(members), set(classes[(k + 1) % len(classes)])
        pull = {node: len(following.intersection(graph[node])) for node in members}
        ranked = sorted(members, key=lambda node: (-pull[node], node))
        places = [(j + 0.5) / n for j in range(n)]
        if len(classes) == 2:
            places.sort(key=lambda place: (abs(place - 0.5), place))
        for node, place in zip(ranked, places, strict=True):
            inner = margin / 2 + (1.0 - margin) * place
            hues[node] = (k + inner) / len(classes) % 1.0
    return hues
