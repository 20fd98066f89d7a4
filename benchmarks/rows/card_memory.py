"""What the three layers together take on the graphics card, counted by our ledger."""

from __future__ import annotations

from benchmarks.on_screen import failure, numbers, run_script, screen_environment
from benchmarks.row import Row
from benchmarks.scenes import Scenes

WHAT = "memory on the graphics card"
GOAL = "<= 1.10x volume + labels"
_SCRIPT = """
import sys, threading, napari, numpy as np
from benchmarks.packing import pack
from napari_unpack import Session
from napari_unpack.layers.stage import Stage
from napari_unpack.rendering.ledger import ledger
shape, size = tuple(int(n) for n in sys.argv[1:4]), int(sys.argv[4])
packing = pack(shape, (4, 3, 5))
volume, labels = packing.volume, packing.labels
session = Session(volume, labels)
viewer = napari.Viewer(ndisplay=3, show=True)
viewer.window.resize(size, size)
stage = Stage(viewer, session)
stage.recolor_at_rest = False
stage.backend = "gl"
stage.open()
stage.settle(300)
stage.unpack(20)
stage.finish()
stage.settle(300)
stage.seconds = 600.0
stage.unpack(5)
stage.settle(300)
held = ledger().bytes_held()
texel = 1 if packing.count < 256 else 2
print("held", sum(held.values()), volume.nbytes + texel * labels.size, len(stage.transition.shots),
      len(stage.sprites.sprites), *stage.frame.size, *(held[k] for k in sorted(held)))
stage.finish()
stage.close()
viewer.close()
"""


def measure(scenes: Scenes) -> list[Row]:
    shape = scenes.shape(512, 512, 1024)
    work = (
        f"{'x'.join(map(str, shape))}, 60 objects, window of {scenes.canvas[0]}x{scenes.canvas[1]}"
    )
    if screen_environment() is None:
        return [Row.not_measured(WHAT, work, "no screen", GOAL)]
    run = run_script(_SCRIPT, *map(str, shape), str(scenes.canvas[0]))
    found = numbers(run, "held")
    if not found:
        return [Row.not_measured(WHAT, work, failure(run), GOAL)]
    held, volumes, flying, sprites = found[0][:4]
    ratio = held / volumes
    return [
        Row(
            WHAT,
            f"{work}: packed bag, {flying:.0f} in the air, {sprites:.0f} sprites",
            f"{held / 1e6:.0f} MB",
            f"volume and labels: {volumes / 1e6:.0f} MB",
            f"{ratio:.3f}",
            GOAL,
            ratio <= 1.10,
        )
    ]
