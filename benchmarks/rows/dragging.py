"""Frames while the bag is dragged: fewer rays, longer steps; then refined at rest."""

from __future__ import annotations

from benchmarks.napari_peer import napari_frame_ms
from benchmarks.row import Row, best_ms, ms
from benchmarks.scenes import Scenes
from napari_unpack.geometry.view import Camera
from napari_unpack.rendering.compose import packed_image

WHAT = "while dragging, no GPU"
WORK = "same, 384x384 rays, steps of 1.5 voxels, the view turning"
GOAL = ">= 10 fps, refined within 1 s"


def measure(scenes: Scenes) -> list[Row]:
    import numpy as np
    from scipy.spatial.transform import Rotation

    session, size = scenes.session, (scenes.edge(384), scenes.edge(384))
    turns = iter(np.linspace(0, 1, 1000))

    def turned() -> Camera:
        turn = Rotation.from_rotvec([0, next(turns), 0]).as_matrix()
        return Camera(scenes.camera.rotation @ turn, scenes.camera.center, scenes.camera.height)

    coarse = best_ms(lambda: packed_image(session.scene(), turned(), size, 1.5, "cpu"), 8)
    fine = best_ms(lambda: packed_image(session.scene(), turned(), scenes.canvas, 1.0, "cpu"), 2)
    peer = napari_frame_ms(scenes)
    ours = f"{1000 / coarse:.1f} fps, refined after {ms(fine)}"
    met = coarse <= 100 and fine <= 1000
    if peer is None:
        return [Row(WHAT, WORK, ours, "napari Labels: not measured (no screen)", "", GOAL, met)]
    against = f"napari Image + Labels, 3D: {1000 / peer:.2f} fps"
    return [Row(WHAT, WORK, ours, against, f"{coarse / peer:.3f}", GOAL, met)]
