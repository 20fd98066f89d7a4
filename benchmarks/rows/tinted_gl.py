"""A tinted frame with GLSL on a software rasteriser, against VTK's CPU ray caster."""

from __future__ import annotations

from benchmarks.row import Row, ms, paired_ms
from benchmarks.rows.tinted_cpu import WORK
from benchmarks.scenes import MM, SHADING, Scenes
from napari_unpack.imaging import cast_tinted

WHAT = "tinted frame, software GL"
GOAL = "<= 1.0x VTK's CPU time"


def measure(scenes: Scenes) -> list[Row]:
    from napari_unpack.rendering import offscreen

    if not offscreen.available():
        return [Row.not_measured(WHAT, WORK, "no GL context", GOAL)]
    if not offscreen.is_software():
        return [Row.not_measured(WHAT, WORK, "GL is hardware here", GOAL)]
    packing = scenes.packing

    def frame() -> object:
        return cast_tinted(
            packing.volume,
            packing.labels,
            MM,
            scenes.camera,
            scenes.transfer_function,
            scenes.tints,
            scenes.canvas,
            shading=SHADING,
            bricks=scenes.bricks,
            backend="gl",
        )

    ours, peer, ratio = paired_ms(frame, scenes.vtk, 2 * scenes.repeats)
    against = f"VTK CPU ray caster, no labels: {ms(peer)}"
    return [Row(WHAT, WORK, ms(ours), against, f"{ratio:.2f}", GOAL, ratio <= 1.0)]
