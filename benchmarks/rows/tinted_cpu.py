"""A tinted frame on the CPU, labels included, against VTK's without labels."""

from __future__ import annotations

from functools import partial

from benchmarks.row import Row, ms, paired_ms
from benchmarks.scenes import Scenes

WORK = "256x256x512, 27 objects, 1024x1024, shaded, opacity 0.1 a voxel"
GOAL = "<= 0.5x VTK's CPU time"


def measure(scenes: Scenes) -> list[Row]:
    ours, peer, ratio = paired_ms(partial(scenes.tinted, "cpu"), scenes.vtk, 2 * scenes.repeats)
    return [
        Row(
            "tinted frame, CPU",
            WORK,
            ms(ours),
            f"VTK CPU ray caster, no labels: {ms(peer)}",
            f"{ratio:.2f}",
            GOAL,
            ratio <= 0.5,
        )
    ]
