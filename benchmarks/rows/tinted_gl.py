"""A tinted frame with GLSL on a software rasteriser, against VTK's CPU ray caster."""

from __future__ import annotations

from functools import partial

from benchmarks.row import Row, ms, paired_ms
from benchmarks.rows.tinted_cpu import WORK
from benchmarks.scenes import Scenes

WHAT = "tinted frame, software GL"
GOAL = "<= 1.0x VTK's CPU time"


def measure(scenes: Scenes) -> list[Row]:
    from napari_unpack.rendering.gl import offscreen

    if not offscreen.available():
        return [Row.not_measured(WHAT, WORK, "no GL context", GOAL)]
    if not offscreen.is_software():
        return [Row.not_measured(WHAT, WORK, "GL is hardware here", GOAL)]
    ours, peer, ratio = paired_ms(partial(scenes.tinted, "gl"), scenes.vtk, 2 * scenes.repeats)
    against = f"VTK CPU ray caster, no labels: {ms(peer)}"
    return [Row(WHAT, WORK, ms(ours), against, f"{ratio:.2f}", GOAL, ratio <= 1.0)]
