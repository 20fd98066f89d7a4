"""napari's own frame of an Image and a Labels layer in 3D, in a process of its own."""

from __future__ import annotations

from benchmarks.on_screen import numbers, run_on_packing, screen_environment
from benchmarks.scenes import Scenes

_SCRIPT = """
import sys, time, numpy as np, napari
data = np.load(sys.argv[1])
viewer = napari.Viewer(ndisplay=3, show=True)
viewer.window.resize(int(sys.argv[2]), int(sys.argv[2]))
viewer.add_image(data["volume"], rendering="attenuated_mip")
viewer.add_labels(data["labels"])
viewer.screenshot(canvas_only=True, flash=False)
times = []
for turn in range(2):
    camera = viewer.scene.camera if hasattr(viewer, "scene") else viewer.camera
    camera.angles = (10.0 + turn, 30.0, 40.0)
    start = time.perf_counter()
    viewer.screenshot(canvas_only=True, flash=False)
    times.append(time.perf_counter() - start)
print("seconds", min(times))
viewer.close()
"""


def napari_frame_ms(scenes: Scenes) -> float | None:
    """Return the time of one frame while the camera turns, None where there is no screen."""
    if screen_environment() is None:
        return None
    found = numbers(run_on_packing(_SCRIPT, scenes, str(scenes.canvas[0])), "seconds")
    return found[0][0] * 1e3 if found else None
