"""Who hides whom: every occlusion counter of 60 objects along one direction."""

from __future__ import annotations

import numpy as np

from benchmarks.row import Row, best_ms, ms
from benchmarks.scenes import MM, Scenes
from napari_unpack.geometry.view import View
from napari_unpack.rendering import cast_occlusion
from napari_unpack.rendering.cpu import Bricks

WORK = "60 objects, 384x384x512, 512x512 rays"
GOAL = "<= 120 ms CPU"


def measure(scenes: Scenes) -> list[Row]:
    crowd = scenes.crowd
    camera = View((0.2, 1.0, 0.1)).camera(crowd.labels.shape, MM)
    visible = np.ones(crowd.count + 1, bool)
    visible[0] = False
    size = (scenes.edge(512), scenes.edge(512))
    looking = best_ms(lambda: Bricks.of(crowd.labels), scenes.repeats)
    bricks = Bricks.of(crowd.labels)

    def count(bricks: Bricks | None) -> float:
        return best_ms(
            lambda: cast_occlusion(
                crowd.labels, MM, camera, visible, size, bricks=bricks, backend="cpu"
            ),
            scenes.repeats,
        )

    ours, plain = count(bricks), count(None)
    return [
        Row(
            "unpackability of all objects",
            WORK,
            f"{ms(ours)} (bricks, once a volume: {ms(looking)})",
            f'without bricks: {ms(plain)}; paper: "50 ms" on its GPU',
            f"{ours / plain:.2f}",
            GOAL,
            ours <= 120,
        )
    ]
