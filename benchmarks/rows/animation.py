"""One frame of a flight: a single object cast, laid over the cached bag and sprites."""

from __future__ import annotations

from time import perf_counter

import numpy as np

from benchmarks.row import Row, best_ms, ms
from benchmarks.scenes import MM, Scenes
from napari_unpack.geometry.transforms import packed_pose
from napari_unpack.rendering.compose import object_image, packed_image
from napari_unpack.rendering.image_patch import compose
from napari_unpack.viewer.animation import Moving
from napari_unpack.viewer.transition_renderer import FRAME_SECONDS, adapted, cast_moving

WHAT = "animation frame"
GOAL = "<= 30 ms CPU"


def measure(scenes: Scenes) -> list[Row]:
    session, camera, size = scenes.session, scenes.camera, scenes.canvas
    rows = []
    bag = packed_image(session.scene(), camera, size, backend="cpu")
    times = {}
    for object_id in (1, 2, 3):
        pose = packed_pose(session.boxes.center(object_id, MM), camera, -60 * camera.direction)
        casting = _in_flight(session, object_id, pose, camera, size)
        flying = object_image(session.scene(), object_id, pose, camera, size, backend="cpu")
        laying = best_ms(lambda flying=flying: compose(size, [bag, flying]), scenes.repeats)
        times[object_id] = casting, laying
    casting = sorted(t[0][0] for t in times.values())
    coarsest = min(t[0][1] for t in times.values())
    laying = max(t[1] for t in times.values())
    rows.append(
        Row(
            WHAT,
            "one object of 27 flying, 1024x1024; three shapes",
            f"cast {ms(casting[0])} to {ms(casting[-1])}, at least {coarsest:.2f} of the screen's "
            f"rays a side (composing in files {ms(laying)})",
            'paper: "50 ms"',
            "",
            GOAL,
            casting[-1] <= 30,
        )
    )
    return rows


def _in_flight(session, object_id, pose, camera, size) -> tuple[float, float]:  # type: ignore[no-untyped-def]
    """Cast frames as a flight does, adapting; return the median ms of the last, and their share."""
    share, frames = 1.0, []
    for _ in range(24):
        began = perf_counter()
        cast_moving(session.scene(), object_id, Moving(pose), camera, size, share)
        seconds = perf_counter() - began
        frames.append((1000 * seconds, share))
        share = adapted(share, seconds, FRAME_SECONDS)
    took, shares = np.median(frames[12:], axis=0)
    return float(took), float(shares)
