"""What the pictures of forty unpacked objects take, against one picture of the whole view."""

from __future__ import annotations

from benchmarks.on_screen import failure, numbers, run_script, screen_environment
from benchmarks.row import Row
from benchmarks.scenes import Scenes

WHAT = "sprites of 40 objects"
GOAL = "<= 4x that image"
_SCRIPT = """
import sys
from benchmarks.packing import pack
from benchmarks.napari_window import opened_in_napari, unpack_at_once
*shape, size = (int(n) for n in sys.argv[1:])
bag = pack(tuple(shape), (2, 4, 5))
viewer, controller = opened_in_napari(
    bag.volume, bag.labels, size, backend="cpu", recolor_at_rest=False
)
unpack_at_once(controller, 40)
print("held", len(controller.sprites.sprites), controller.sprites.nbytes, *controller.frame.size)
controller.close()
viewer.close()
"""


def measure(scenes: Scenes) -> list[Row]:
    shape, size = scenes.shape(256, 256, 320), scenes.canvas[0]
    work = f"{'x'.join(map(str, shape))}, all 40 out, napari's window of {size}x{size}"
    if screen_environment() is None:
        return [Row.not_measured(WHAT, work, "no screen", GOAL)]
    run = run_script(_SCRIPT, *map(str, shape), str(size))
    found = numbers(run, "held")
    if not found or found[0][0] != 40:
        return [Row.not_measured(WHAT, work, failure(run), GOAL)]
    held, canvas = found[0][1], found[0][2:4]
    view = 4 * canvas[0] * canvas[1]
    return [
        Row(
            WHAT,
            work,
            f"{held / 1e6:.1f} MB, colour and depth",
            f"RGBA image of its {canvas[1]:.0f}x{canvas[0]:.0f} canvas: {view / 1e6:.1f} MB",
            f"{held / view:.2f}",
            GOAL,
            held <= 4 * view,
        )
    ]
