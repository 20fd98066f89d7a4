"""An object is hidden or shown: what it costs beyond the frame that must be cast anyway."""

from __future__ import annotations

from itertools import cycle

from benchmarks.row import Row, ms, paired_ms
from benchmarks.scenes import Scenes
from napari_unpack.rendering.compose import packed_image

WHAT = "hiding an object to new picture"
GOAL = "one frame"


def measure(scenes: Scenes) -> list[Row]:
    session, camera, size = scenes.session, scenes.camera, scenes.canvas
    steps = cycle([session.hide, session.show])

    def frame() -> object:
        return packed_image(session.scene(), camera, size, 1.0, "cpu")

    def hidden() -> object:
        next(steps)([14])
        return frame()

    ours, peer, ratio = paired_ms(hidden, frame, 2 * scenes.repeats)
    session.show([14])
    work = f"256x256x512, 27 objects, {size[0]}x{size[1]} rays, CPU: one hidden or shown, then cast"
    return [
        Row(WHAT, work, ms(ours), f"the cast alone: {ms(peer)}", f"{ratio:.2f}", GOAL, ratio <= 1.1)
    ]
