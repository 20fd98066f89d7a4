"""Greedy colouring of the interference graph, the same on every machine."""

from __future__ import annotations

from typing import Any

import networkx as nx


def color_classes(graph: nx.Graph) -> list[list[int]]:
    """Divide objects into as few classes as greedy colouring finds, none with an edge inside.

    Parameters
    ----------
    graph : networkx.Graph
        Nodes are object IDs, edges join interfering objects.

    Returns
    -------
    list of list of int
        C classes, each ascending by ID; the first holds the object with most neighbours.

    Notes
    -----
    Li et al. 2012, section 4.2: "the greedy algorithm that processes vertices in decreasing
    order of degrees". Ties, which the paper leaves open, by ascending ID.
    """
    colors = nx.greedy_color(graph, strategy=_largest_first)
    classes: list[list[int]] = [[] for _ in range(max(colors.values(), default=-1) + 1)]
    for node in sorted(graph):
        classes[colors[node]].append(node)
    return classes


def _largest_first(graph: nx.Graph, colors: dict[int, int]) -> list[Any]:
    return sorted(graph, key=lambda node: (-graph.degree(node), node))
