"""Interference of the objects in two ID layers, eq. 1."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.row import Row, best_ms, ms
from benchmarks.scenes import MM, Scenes
from napari_unpack.appearance import interference
from napari_unpack.rendering import cast_ids

GOAL = "<= 50 ms CPU"


def measure(scenes: Scenes) -> list[Row]:
    packing = scenes.packing
    visible = np.ones(packing.count + 1, bool)
    visible[0] = False
    ids = cast_ids(packing.labels, MM, scenes.camera, visible, scenes.canvas, 2, backend="cpu")
    ours = best_ms(lambda: interference(ids, 5), scenes.repeats)
    peer = best_ms(lambda: _region_adjacency(ids[0]), 1)
    edges = interference(ids, 5).number_of_edges()
    return [
        Row(
            "interference, two layers",
            f"1024x1024, DT 5: {edges} pairs",
            ms(ours),
            f'scikit-image expand_labels + RAG, one layer: {ms(peer)}; paper: "110 ms", one layer',
            f"{ours / peer:.2f}",
            GOAL,
            ours <= 50,
        )
    ]


def _region_adjacency(layer: NDArray[np.int32]) -> Any:
    # Labels grown by half of DT touch where they were DT apart.
    from skimage.graph import RAG
    from skimage.segmentation import expand_labels

    return RAG(expand_labels(layer, 2.5), connectivity=2)
