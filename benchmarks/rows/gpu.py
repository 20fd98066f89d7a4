"""What only graphics hardware can show."""

from __future__ import annotations

from benchmarks.row import Row, best_ms, ms
from benchmarks.scenes import MM, SHADING, Scenes
from napari_unpack.imaging import cast_tinted

ROWS = (
    ("tinted frame, GPU", "512x512x1024, 60 objects, 1024x1024", "<= 8 ms"),
    ("unpackability, GPU", "60 objects, 384x384x512, 512x512 rays", "<= 5 ms"),
    ("animation frame, GPU", "one object of 27 flying, 1024x1024", "<= 4 ms"),
)


def measure(scenes: Scenes) -> list[Row]:
    from napari_unpack.rendering import offscreen

    if not (offscreen.available() and not offscreen.is_software()):
        return [Row.not_measured(what, work, "no GPU", goal) for what, work, goal in ROWS]
    return [_frame(scenes), *(Row.not_measured(*row[:2], "next", row[2]) for row in ROWS[1:])]


def _frame(scenes: Scenes) -> Row:
    import numpy as np

    from benchmarks.packing import pack
    from napari_unpack.geometry.view import View

    packing = pack(scenes.shape(512, 512, 1024), (4, 3, 5))
    camera = View((0.5, 0.35, 1.0)).camera(packing.volume.shape, MM)
    tints = np.ones((packing.count + 1, 4), np.float32)
    tints[0] = 0
    took = best_ms(
        lambda: cast_tinted(
            packing.volume,
            packing.labels,
            MM,
            camera,
            scenes.transfer_function,
            tints,
            scenes.canvas,
            shading=SHADING,
            backend="gl",
        ),
        5,
    )
    what, work, goal = ROWS[0]
    return Row(what, work, ms(took), 'paper: "70 ms" (2012)', "", goal, took <= 8)
