"""What the three layers together take on the graphics card, as GL tells it."""

from __future__ import annotations

from benchmarks.on_screen import failure, numbers, run_script, screen_environment
from benchmarks.row import Row
from benchmarks.scenes import Scenes

WHAT = "memory on the graphics card"
GOAL = "<= 1.10x volume + labels"
_SCRIPT = """
import sys
from benchmarks.packing import pack
from benchmarks.napari_window import of_qt, on_the_card, opened_in_napari, unpack_at_once
*shape, size = (int(n) for n in sys.argv[1:])
bag = pack(tuple(shape), (4, 3, 5))
viewer, controller = opened_in_napari(
    bag.volume, bag.labels, size, backend="gl", recolor_at_rest=False
)
unpack_at_once(controller, 20)
controller.seconds = 600.0
controller.unpack(5)
controller.settle(300)
held = sum(on_the_card(viewer).values()) - of_qt(viewer)
texel = 1 if bag.count < 256 else 2
volumes = bag.volume.nbytes + texel * bag.labels.size
flying, sprites = len(controller.transition.images), len(controller.sprites.sprites)
print("held", held, volumes, flying, sprites)
controller.finish()
controller.close()
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
    held, volumes, flying, sprites = found[0]
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
