"""Import the plugin and open its dock widgets, beyond napari's own start."""

from __future__ import annotations

import subprocess
import sys

from benchmarks.napari_peer import screen_environment
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
    environment = screen_environment()
    if environment is None:
        return [Row.not_measured(WHAT, WORK, "no screen", GOAL)]
    best: tuple[float, float] | None = None
    for _ in range(1 if scenes.quick else 2):
        done = subprocess.run(
            [sys.executable, "-c", _SCRIPT],
            capture_output=True,
            text=True,
            timeout=180,
            check=False,
            env=environment,
        )
        lines = [line for line in done.stdout.splitlines() if line.startswith("seconds")]
        if not lines:
            reason = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
            return [Row.not_measured(WHAT, WORK, reason[:60], GOAL)]
        napari, plugin = map(float, lines[0].split()[1:])
        if best is None or plugin < best[1]:
            best = napari, plugin
    assert best is not None
    napari, plugin = best
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
