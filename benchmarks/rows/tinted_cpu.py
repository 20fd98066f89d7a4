"""A tinted frame on the CPU, labels included, against VTK's without labels."""

from __future__ import annotations

from benchmarks.row import Row, ms, paired_ms
from benchmarks.scenes import MM, SHADING, Scenes
from napari_unpack.imaging import cast_tinted

WORK = "256x256x512, 27 objects, 1024x1024, shaded, opacity 0.1 a voxel"
GOAL = "<= 0.5x VTK's CPU time"


def measure(scenes: Scenes) -> list[Row]:
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
            backend="cpu",
        )

    ours, peer, ratio = paired_ms(frame, scenes.vtk, 2 * scenes.repeats)
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
