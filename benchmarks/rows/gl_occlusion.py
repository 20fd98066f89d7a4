"""The paper's two ways to count occlusion on a GPU, beside the CPU."""

from __future__ import annotations

import numpy as np

from benchmarks.row import Row, awake_ms, best_ms, ms
from benchmarks.rows.unpackability import WORK
from benchmarks.scenes import MM, Scenes
from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.geometry.view import View
from napari_unpack.rendering.casting import off_faces, rays_for
from napari_unpack.rendering.cpu import Bricks, occlusion_counts

WHAT, GPU_WHAT = "unpackability, software GL", "unpackability, GPU"
GOAL, GPU_GOAL = "both methods measured", "<= 5 ms"


def measure(scenes: Scenes) -> list[Row]:
    from napari_unpack.rendering.gl import offscreen

    if not offscreen.available():
        return [
            Row.not_measured(what, WORK, "no GL context", goal)
            for what, goal in ((WHAT, GOAL), (GPU_WHAT, GPU_GOAL))
        ]
    from napari_unpack.rendering.gl import backend as gl_backend

    crowd = scenes.crowd
    camera = View((0.2, 1.0, 0.1)).camera(crowd.labels.shape, MM).orthographic()
    rays = off_faces(rays_for(camera, (scenes.edge(512), scenes.edge(512)), MM))
    visible = np.ones(crowd.count + 1, bool)
    visible[0] = False
    bricks, boxes = Bricks.of(crowd.labels), label_boxes(crowd.labels)
    seen = crowd.labels, rays, visible
    cpu = best_ms(lambda: occlusion_counts(*seen, bricks), scenes.repeats)
    times = {
        "atomics": awake_ms(lambda: gl_backend.counts_by_atomics(*seen, bricks), scenes.repeats),
        "queries": awake_ms(lambda: gl_backend.first_hits(*seen, boxes, bricks), scenes.repeats),
    }
    ours = ", ".join(f"{name} {ms(took)}" for name, took in times.items())
    best = min(times.values())
    against, ratio = f"CPU {ms(cpu)}", f"{best / cpu:.2f}"
    if offscreen.is_software():
        return [
            Row(WHAT, WORK, ours, against, ratio, GOAL, True),
            Row.not_measured(GPU_WHAT, WORK, "no GPU", GPU_GOAL),
        ]
    return [Row(GPU_WHAT, WORK, ours, against, ratio, GPU_GOAL, best <= 5)]
