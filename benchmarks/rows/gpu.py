"""What only graphics hardware can show."""

from __future__ import annotations

from benchmarks.row import Row, awake_ms, ms
from benchmarks.scenes import MM, SHADING, Scenes
from napari_unpack.rendering import cast_tinted

ROWS = (
    ("tinted frame, GPU", "512x512x1024, 60 objects, 1024x1024", "<= 8 ms"),
    ("animation frame, GPU", "one object of 27 flying, 1024x1024", "<= 4 ms"),
)


def measure(scenes: Scenes) -> list[Row]:
    from napari_unpack.rendering.gl import offscreen

    if not (offscreen.available() and not offscreen.is_software()):
        return [Row.not_measured(what, work, "no GPU", goal) for what, work, goal in ROWS]
    return [_frame(scenes), _flight(scenes)]


def _frame(scenes: Scenes) -> Row:
    import numpy as np

    from benchmarks.packing import pack
    from napari_unpack.geometry.view import View

    packing = pack(scenes.shape(512, 512, 1024), (4, 3, 5))
    camera = View((0.5, 0.35, 1.0)).camera(packing.volume.shape, MM)
    tints = np.ones((packing.count + 1, 4), np.float32)
    tints[0] = 0
    took = awake_ms(
        lambda: cast_tinted(
            packing.volume,
            packing.labels,
            MM,
            camera,
            scenes.transfer_function,
            tints,
            scenes.canvas,
            shading=SHADING,
            backend="gl",
        ),
        5,
    )
    what, work, goal = ROWS[0]
    return Row(what, work, ms(took), 'paper: "70 ms" (2012)', "", goal, took <= 8)


def _flight(scenes: Scenes) -> Row:
    from napari_unpack.geometry.transforms import packed_pose
    from napari_unpack.rendering.compose import object_image

    session, camera, size = scenes.session, scenes.camera, scenes.canvas
    slowest = 0.0
    for object_id in (1, 2, 3):
        pose = packed_pose(session.boxes.center(object_id, MM), camera, -60 * camera.direction)
        took = awake_ms(
            lambda object_id=object_id, pose=pose: object_image(
                session.scene(), object_id, pose, camera, size, backend="gl"
            ),
            2 * scenes.repeats,
        )
        slowest = max(slowest, took)
    what, work, goal = ROWS[1]
    return Row(what, work, f"{ms(slowest)}, read back", 'paper: "50 ms"', "", goal, slowest <= 4)
