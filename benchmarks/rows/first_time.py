"""The first day on a machine: from Segment to the first packed picture without compiled kernels."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.on_screen import failure, numbers
from benchmarks.row import Row
from benchmarks.scenes import Scenes

WHAT, GOAL = "first time on a machine", "<= 60 s for both"
MOST_SECONDS = 60.0
_SCRIPT = """
import sys, time
import numpy as np
import napari_unpack as nu
from napari_unpack.rendering.compose import scene_image
held = np.load(sys.argv[1])
def clocks():
    return np.array([time.perf_counter(), time.process_time()])
start = clocks()
found = nu.segment(held["volume"], spacing=tuple(held["spacing"]))
middle = clocks()
session = nu.Session(held["volume"], found.labels, tuple(held["spacing"]), found.objects)
session.recolor()
scene_image(session.scene(), session.overview(), (600, 800), backend="cpu")
print("seconds", *(middle - start), *(clocks() - middle))
"""


def measure(scenes: Scenes) -> list[Row]:
    from napari_unpack.widgets.contributions import packed_bag

    (volume, about, _), _ = packed_bag()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bag.npz"
        np.savez(path, volume=volume, spacing=about["scale"])
        done = subprocess.run(
            [sys.executable, "-c", _SCRIPT, str(path)],
            capture_output=True,
            text=True,
            timeout=900,
            check=False,
            env=os.environ | {"NUMBA_CACHE_DIR": str(Path(folder) / "kernels")},
        )
    work = f"sample bag {'x'.join(map(str, volume.shape))}, empty kernel cache"
    found = numbers(done, "seconds")
    if not found:
        return [Row.not_measured(WHAT, work, failure(done), GOAL)]
    segment, segment_cpu, picture, picture_cpu = found[0]
    return [
        Row(
            WHAT,
            work,
            f"segment {segment:.0f} s, then the first picture {picture:.0f} s "
            f"(processor: {segment_cpu:.0f} and {picture_cpu:.0f} s)",
            "",
            "",
            GOAL,
            segment + picture <= MOST_SECONDS,
        )
    ]
