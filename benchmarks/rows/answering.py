"""From a key or a click in a real viewer to the first picture that it changed."""

from __future__ import annotations

from benchmarks.on_screen import failure, numbers, run_on_packing, screen_environment
from benchmarks.row import Row, ms
from benchmarks.scenes import Scenes

WHAT = "a click answers"
WORK = "256x256x512, 27 objects: N to the first changed image, best and worst of 5"
STATES = {"rested": "", "turned": ", straight after a turn: occlusion is asked first"}
GOAL = "<= 100 ms"

_SCRIPT = """
import sys, time, numpy as np, napari
from qtpy.QtCore import Qt
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QApplication
from napari_unpack.layers import compat
from napari_unpack.session import Session
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
data = np.load(sys.argv[1])
viewer = napari.Viewer(show=True)
viewer.window.resize(1200, 800)
panel = UnpackingWidget(viewer)
viewer.window.add_dock_widget(panel, area="right")
panel.workspace.open(Session(data["volume"], data["labels"]), seconds=0.5)
controller = panel.workspace.controller
controller.settle(120)
seen = []
controller.events.frame.connect(lambda: seen.append(time.perf_counter()))
canvas = compat.native_canvas(viewer).native
for _ in range(6):
    if sys.argv[2] == "turned":
        first, second, third = viewer.scene.camera.angles
        viewer.scene.camera.angles = first + 7, second + 5, third
        QApplication.processEvents()
    del seen[:]
    start = time.perf_counter()
    QTest.keyClick(canvas, Qt.Key.Key_N)
    while not seen:
        QApplication.processEvents()
    QApplication.processEvents()
    print("answered", seen[0] - start, flush=True)
    while controller.flying:
        QApplication.processEvents()
    controller.settle(60)
panel.end()
viewer.close()
"""


def measure(scenes: Scenes) -> list[Row]:
    if screen_environment() is None:
        return [Row.not_measured(WHAT, WORK, "no screen", GOAL)]
    return [_row(scenes, state, more) for state, more in STATES.items()]


def _row(scenes: Scenes, state: str, more: str) -> Row:
    run = run_on_packing(_SCRIPT, scenes, state)
    times = [seconds for (seconds,) in numbers(run, "answered")]
    if len(times) < 2:
        return Row.not_measured(WHAT, WORK + more, failure(run), GOAL)
    # The first loads kernels and code.
    best, worst = 1e3 * min(times[1:]), 1e3 * max(times[1:])
    return Row(WHAT, WORK + more, f"{ms(best)} to {ms(worst)}", "", "", GOAL, worst <= 100)
