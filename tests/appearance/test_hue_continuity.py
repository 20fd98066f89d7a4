"""Colours over a turn: interfering pairs stay apart, and few objects change."""

from __future__ import annotations

import networkx as nx
import numpy as np
from skimage.color import deltaE_ciede2000, rgb2lab

from napari_unpack.appearance import (
    assign_hues,
    color_classes,
    hue_distance,
    interference,
    perceptual_to_rgb,
)
from napari_unpack.appearance.hues import spread_hues
from napari_unpack.geometry.view import View
from napari_unpack.rendering import cast_ids

MARGIN = 0.4


def test_no_interfering_pair_comes_closer_than_stated_and_few_objects_change() -> None:
    rng = np.random.default_rng(2)
    z, y, x = np.indices((36, 36, 36))
    labels = np.zeros(z.shape, np.uint16)
    for i, (cz, cy, cx) in enumerate(rng.uniform(5, 31, (24, 3)), start=1):
        labels[(z - cz) ** 2 + (y - cy) ** 2 + (x - cx) ** 2 < 22] = i
    visible = np.arange(25) > 0
    kept: dict[int, float] = {}
    last: dict[int, float] = {}
    moved = moved_afresh = 0
    for angle in np.radians(np.arange(0, 180, 15)):
        camera = View((np.cos(angle), 0.2, np.sin(angle))).camera(labels.shape, (1, 1, 1))
        graph = interference(
            cast_ids(labels, (1, 1, 1), camera, visible, (90, 90), 2, backend="cpu")
        )
        hues = assign_hues(graph, kept or None, MARGIN)
        afresh = assign_hues(graph, margin=MARGIN)
        stated = MARGIN / len(color_classes(graph))
        assert min(hue_distance(hues[a], hues[b]) for a, b in graph.edges) >= stated - 1e-9
        moved += sum(hues[i] != kept[i] for i in hues if i in kept)
        moved_afresh += sum(afresh[i] != last[i] for i in afresh if i in last)
        kept, last = kept | hues, last | afresh
    assert moved_afresh >= 5 * moved


def test_neighbours_are_spread_further_apart_than_their_arcs() -> None:
    """By CIEDE2000 as the ring shows them, over random graphs as dense as packed bags."""
    rng = np.random.default_rng(1)
    ring = rgb2lab(perceptual_to_rgb(np.arange(360) / 360))
    gained, moved, objects = [], 0, 0

    def least(graph: nx.Graph, hues: dict[int, float]) -> float:
        ends = np.array([[hues[a], hues[b]] for a, b in graph.edges])
        a, b = ring[np.rint(ends * 360).astype(int).T % 360]
        return float(deltaE_ciede2000(a, b).min())

    for seed in range(20):
        # A few large objects touch many in the picture, as in bags: 104 pairs of 30 objects.
        before = nx.relabel_nodes(nx.barabasi_albert_graph(30, 4, seed), lambda i: i + 1)
        after = before.copy()
        after.remove_edges_from([e for e in before.edges if rng.random() < 0.15])
        after.add_edges_from((int(a), int(b)) for a, b in rng.integers(1, 31, (12, 2)) if a != b)
        arcs, first = assign_hues(before, margin=MARGIN), spread_hues(before, margin=MARGIN)
        second = spread_hues(after, first, MARGIN)
        for graph, hues in ((before, first), (after, second)):
            assert least(graph, hues) >= 6
            stated = MARGIN / len(color_classes(graph))
            assert min(hue_distance(hues[a], hues[b]) for a, b in graph.edges) >= stated - 1e-9
        gained.append(least(before, first) / least(before, arcs))
        moved, objects = (
            moved + sum(second[i] != first[i] for i in second if i in first),
            objects + 30,
        )
    assert np.median(gained) > 1.25
    assert moved < 0.3 * objects
