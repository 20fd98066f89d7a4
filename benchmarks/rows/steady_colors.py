"""How much colours change over a full turn, kept against chosen afresh at every step."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from benchmarks.row import Row
from benchmarks.scenes import Scenes
from napari_unpack.appearance import assign_hues, color_classes, hue_distance, interference
from napari_unpack.geometry.transforms import rotation_about
from napari_unpack.geometry.view import View
from napari_unpack.rendering import cast_ids
from napari_unpack.session.colors import DISTANCE, LAYERS
from napari_unpack.session.state import ViewState

GOAL = ">= 5x fewer recoloured, no pair closer than stated"
STEP = 10
SIZE = (480, 640)


def measure(scenes: Scenes) -> list[Row]:
    bag = _bag(scenes)
    graphs = [_graph(bag, angle) for angle in range(0, 361, STEP)]
    margin = ViewState.hue_margin
    kept, fresh = [assign_hues(graphs[0], margin=margin)], [assign_hues(graphs[0], margin=margin)]
    known = dict(kept[0])
    for graph in graphs[1:]:
        known |= assign_hues(graph, known, margin)
        kept.append(dict(known))
        fresh.append(fresh[-1] | assign_hues(graph, margin=margin))
    steps = len(graphs) - 1
    moved, travel = _changes(kept)
    moved_fresh, travel_fresh = _changes(fresh)
    nearest = min(
        min((hue_distance(hues[a], hues[b]) for a, b in graph.edges), default=0.5)
        / (margin / max(len(color_classes(graph)), 1))
        for graph, hues in zip(graphs, kept, strict=True)
    )
    fewer = moved_fresh / max(moved, 1)
    return [
        Row(
            "colours over a full turn",
            f"{len(known)} objects, {steps} steps of {STEP} degrees",
            f"{moved / steps:.1f} recoloured a step, hue travel {travel / steps:.2f}, "
            f"nearest pair {nearest:.2f} of the margin over C",
            f"afresh: {moved_fresh / steps:.1f} a step, travel {travel_fresh / steps:.2f}",
            f"1/{fewer:.1f}",
            GOAL,
            fewer >= 5 and nearest >= 1 - 1e-6,
        )
    ]


def _bag(scenes: Scenes) -> Any:
    from napari_unpack.simulation import simulate_bag

    return simulate_bag(seed=5, shape=scenes.shape(160, 176, 256), count=40)


def _graph(bag: Any, angle: float) -> Any:
    spacing = np.asarray(bag.spacing, dtype=np.float64)
    turn = rotation_about((0.0, 1.0, 0.0), np.radians(angle))
    direction = turn @ np.array([1.0, 0.0, 0.0])
    z, y, x = (float(v) for v in direction)
    camera = View((z, y, x)).camera(bag.labels.shape, spacing)
    visible = np.arange(int(bag.labels.max()) + 1) > 0
    ids = cast_ids(bag.labels, spacing, camera, visible, SIZE, LAYERS, backend="cpu")
    return interference(ids, DISTANCE, LAYERS)


def _changes(history: list[dict[int, float]]) -> tuple[int, float]:
    """Return how many hues changed in all, and how far together."""
    moved, travel = 0, 0.0
    for before, after in pairwise(history):
        ways = [hue_distance(before[i], after[i]) for i in after if i in before]
        moved += sum(way > 1e-9 for way in ways)
        travel += sum(ways)
    return moved, travel
