"""napari's own frame of an Image and a Labels layer in 3D, in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

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


SCREEN = "NAPARI_UNPACK_SCREEN"
"""Where the display's name is kept from this process, in which VTK's GL and ours share EGL."""


def keep_screen_for_children() -> None:
    """Take the display away from this process, which draws offscreen, and remember it."""
    display = os.environ.pop("DISPLAY", None)
    if display:
        os.environ[SCREEN] = display
    os.environ["PYOPENGL_PLATFORM"], os.environ["EGL_PLATFORM"] = "egl", "surfaceless"


def screen_environment() -> dict[str, str] | None:
    """Return the environment for a process with windows, None where there is no screen."""
    if SCREEN not in os.environ:
        return None
    offscreen = ("PYOPENGL_PLATFORM", "EGL_PLATFORM", SCREEN)
    kept = {k: v for k, v in os.environ.items() if k not in offscreen}
    return kept | {"DISPLAY": os.environ[SCREEN]}


def napari_frame_ms(scenes: Scenes) -> float | None:
    """Return the time of one frame while the camera turns, None where there is no screen."""
    environment = screen_environment()
    if environment is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "packing.npz"
        np.savez(path, volume=scenes.packing.volume, labels=scenes.packing.labels)
        done = subprocess.run(
            [sys.executable, "-c", _SCRIPT, str(path), str(scenes.canvas[0])],
            capture_output=True,
            text=True,
            timeout=180,
            check=False,
            env=environment,
        )
    for line in done.stdout.splitlines():
        if line.startswith("seconds"):
            return float(line.split()[1]) * 1e3
    return None
