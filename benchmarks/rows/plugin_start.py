"""Import the plugin and open its dock widgets, beyond napari's own start."""

from __future__ import annotations

from benchmarks.on_screen import failure, numbers, run_script, screen_environment
from benchmarks.row import Row
from benchmarks.scenes import Scenes

WHAT, WORK = "plugin start", "import and open the dock widget"
GOAL = "<= 1.0 s over napari's own start"
_SCRIPT = """
import time
start = time.perf_counter()
import napari
viewer = napari.Viewer(show=True)
napari.current_viewer()
middle = time.perf_counter()
viewer.window.add_plugin_dock_widget("napari-unpack")
end = time.perf_counter()
print("seconds", middle - start, end - middle)
viewer.close()
"""


def measure(scenes: Scenes) -> list[Row]:
    if screen_environment() is None:
        return [Row.not_measured(WHAT, WORK, "no screen", GOAL)]
    found: list[list[float]] = []
    for _ in range(1 if scenes.quick else 2):
        run = run_script(_SCRIPT)
        found += numbers(run, "seconds")
        if not found:
            return [Row.not_measured(WHAT, WORK, failure(run), GOAL)]
    napari, plugin = min(found, key=lambda times: times[1])
    return [
        Row(
            WHAT,
            WORK,
            f"{plugin:.2f} s",
            f"napari's own start: {napari:.2f} s",
            f"{plugin / napari:.2f}",
            GOAL,
            plugin <= 1.0,
        )
    ]
