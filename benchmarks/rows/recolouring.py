"""From the interference graph of 200 objects to hues."""

from __future__ import annotations

import networkx as nx

from benchmarks.row import Row, best_ms, ms
from benchmarks.scenes import Scenes
from napari_unpack.appearance import assign_hues

GOAL = "<= 5 ms"


def measure(scenes: Scenes) -> list[Row]:
    graph = nx.Graph()
    places = nx.random_geometric_graph(200, 0.12, seed=3)
    graph.add_nodes_from(n + 1 for n in places)
    graph.add_edges_from((a + 1, b + 1, {"weight": 1 + (a + b) % 40}) for a, b in places.edges)
    before = assign_hues(graph)
    first = best_ms(lambda: assign_hues(graph), 3 * scenes.repeats)
    again = best_ms(lambda: assign_hues(graph, before), 3 * scenes.repeats)
    peer = best_ms(lambda: nx.greedy_color(graph, "largest_first"), 3 * scenes.repeats)
    ours = max(first, again)
    return [
        Row(
            "recolouring 200 objects",
            f"{graph.number_of_edges()} pairs, first and after a turn",
            f"{ms(first)}, {ms(again)}",
            f"networkx greedy_color, no hues: {ms(peer)}",
            f"{ours / peer:.1f}",
            GOAL,
            ours <= 5,
        )
    ]
