"""Sprites of forty objects take less memory than four full-view images (section 5.3)."""

from __future__ import annotations

import numpy as np

from napari_unpack.layers.rendered_image import Sprite
from napari_unpack.layers.sprite_layer import SpriteLayer
from napari_unpack.rendering.compose import sprite_image
from napari_unpack.session import Session
from napari_unpack.viewer.sprite_renderer import PIXELS_PER_VOXEL, resolution

CANVAS = 1024, 1024


def forty_blocks() -> np.ndarray:
    """Return labels of 5 x 4 x 2 blocks of 24 voxels: nothing fills its picture more."""
    z, y, x = np.indices((2, 4, 5)) * 30
    labels = np.zeros((60, 120, 150), np.uint16)
    for number, (a, b, c) in enumerate(zip(z.flat, y.flat, x.flat, strict=True), start=1):
        labels[a + 3 : a + 27, b + 3 : b + 27, c + 3 : c + 27] = number
    return labels


def test_forty_sprites_take_less_than_four_full_view_images() -> None:
    labels = forty_blocks()
    session = Session(np.where(labels, 1500, 0).astype(np.uint16), labels)
    session.backend, session.canvas_size = "cpu", CANVAS
    session.look(session.overview())
    session.unpack(40)
    assert len(session.poses) == 40
    pixels_per_mm = CANVAS[0] / session.camera.height
    sprites = {}
    for object_id, pose in session.poses.items():
        fine = resolution(pixels_per_mm, PIXELS_PER_VOXEL / pose.scale)
        # One sample an edge shows the same pixels.
        patch = sprite_image(session.scene(), object_id, pose, fine, 3.0, "cpu")
        sprite = Sprite.of(patch, pose, 1.0 / fine)
        assert sprite is not None
        # As large as it is seen, at least.
        assert min(patch.rgba.shape[:2]) >= 20 * pose.scale * pixels_per_mm
        sprites[object_id] = sprite
    layer = SpriteLayer("Sprites", session.spacing)
    layer.show(sprites)
    assert 0 < layer.nbytes < 4 * CANVAS[0] * CANVAS[1] * 4
    held = sum(s.patch.rgba.nbytes + s.patch.depth.nbytes for s in sprites.values())
    assert layer.nbytes > held
