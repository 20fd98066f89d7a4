"""Colours over a turn: interfering pairs stay apart, and few objects change."""

from __future__ import annotations

import numpy as np

from napari_unpack.appearance import assign_hues, color_classes, hue_distance, interference
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
