"""The packed bag turning in a real viewer with 20 sprites out."""

from __future__ import annotations

from benchmarks.on_screen import failure, numbers, run_on_packing, screen_environment
from benchmarks.row import Row
from benchmarks.scenes import Scenes

WHAT = "packed bag turning, 20 sprites out, no GPU"
WORK = "256x256x512, 27 objects, napari's window of 1024x1024, the view turning"
GOAL = ">= 10 fps"
_SCRIPT = """
import sys, time, numpy as np
from qtpy.QtWidgets import QApplication
from benchmarks.napari_window import opened_in_napari, unpack_at_once
from napari_unpack.layers.compat import native_canvas
data = np.load(sys.argv[1])
viewer, controller = opened_in_napari(
    data["volume"], data["labels"], int(sys.argv[2]), backend="cpu"
)
unpack_at_once(controller, 20)
drawn = []
native_canvas(viewer).events.draw.connect(lambda _: drawn.append(controller.packed.image))
start = time.perf_counter()
while time.perf_counter() - start < 6:
    angles = viewer.camera.angles
    viewer.camera.angles = (angles[0], angles[1] + 0.7, angles[2])
    QApplication.processEvents()
seconds = time.perf_counter() - start
fresh = sum(a is not b for a, b in zip(drawn, drawn[1:]))
rays = np.mean([min(shot.size) for shot in drawn])
print("fps", fresh / seconds, len(drawn) / seconds, rays)
controller.close()
viewer.close()
"""


def measure(scenes: Scenes) -> list[Row]:
    if screen_environment() is None:
        return [Row.not_measured(WHAT, WORK, "no screen", GOAL)]
    run = run_on_packing(_SCRIPT, scenes, str(scenes.canvas[0]))
    found = numbers(run, "fps")
    if not found:
        return [Row.not_measured(WHAT, WORK, failure(run), GOAL)]
    pictures, redraws, rays = found[0]
    return [
        Row(
            WHAT,
            WORK,
            f"{pictures:.1f} fresh pictures a second ({redraws:.0f} redraws), "
            f"{rays:.0f} rays on the short side",
            'paper: "20 fps"',
            goal=GOAL,
            met=pictures >= 10,
        )
    ]
