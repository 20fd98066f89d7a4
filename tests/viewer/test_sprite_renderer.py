"""Sprites of forty objects take less memory than four full-view images (section 5.3)."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from manual_scheduler import ManualScheduler
from napari_unpack.appearance import TransferFunction
from napari_unpack.layers.rendered_image import Sprite
from napari_unpack.layers.sprite_layer import SpriteLayer
from napari_unpack.rendering.compose import sprite_image
from napari_unpack.rendering.object_style import ObjectStyle
from napari_unpack.session import Session
from napari_unpack.viewer import sprite_renderer
from napari_unpack.viewer.sprite_renderer import PIXELS_PER_VOXEL, SpriteRenderer, resolution

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


def test_a_sprite_is_cast_anew_where_labels_beside_it_were_edited_and_only_there() -> None:
    labels = np.zeros((24, 24, 70), np.uint16)
    labels[4:20, 4:20, 4:20], labels[4:20, 4:20, 20:36], labels[4:20, 4:20, 50:60] = 1, 2, 3
    labels[4:20, 4:20, 62:68] = 4
    volume = np.choose(labels, (0, 1500, 3000, 1500, 1500)).astype(np.uint16)
    session, shown = Session(volume, labels), {}
    session.backend = "cpu"
    at_once: Any = SimpleNamespace(submit=lambda task, _, done, **_more: done(task.run(None)))
    renderer = SpriteRenderer(session, at_once, shown.update)

    def casts() -> int:
        renderer.want(session.poses, frozenset(session.poses), 2.0, {})
        ((one, pose),) = session.poses.items()
        fresh = sprite_image(session.scene(), one, pose, 1.0 / shown[one].mm, 1.0, "cpu")
        np.testing.assert_allclose(shown[one].patch.rgba, fresh.rgba, atol=2e-3)
        return renderer.casts

    session.force_unpack(1)
    assert casts() == 1
    session.delete(2)
    assert casts() == 2
    session.delete(3)
    assert casts() == 2
    session.undo()
    assert casts() == 2
    session.undo()
    assert casts() == 3


def test_an_object_that_its_own_opacity_hides_is_cast_once_and_shown_again_later() -> None:
    labels = np.zeros((24, 24, 24), np.uint16)
    labels[4:20, 4:20, 4:20] = 1
    session = Session((1500 * labels).astype(np.uint16), labels)
    shown: list[list[int]] = []
    session.backend = "cpu"
    at_once: Any = SimpleNamespace(submit=lambda task, _, done, **_more: done(task.run(None)))
    renderer = SpriteRenderer(session, at_once, lambda sprites: shown.append(list(sprites)))

    def want() -> tuple[int, list[int]]:
        renderer.want(session.poses, frozenset(session.poses), 2.0, {})
        assert renderer.settled
        assert renderer.has(1)
        return renderer.casts, shown[-1]

    session.force_unpack(1)
    assert want() == (1, [1])
    dense = TransferFunction([(4000, 0.0), (5000, 1.0)])
    session.set_style(1, ObjectStyle(transfer_function=dense))
    for _ in range(2):
        assert want() == (2, [])
    # Put elsewhere it is not cast either.
    pose = session.poses[1]
    session.place(1, replace(pose, center=pose.center + 9.0))
    assert want() == (2, [])
    session.set_style(1, ObjectStyle())
    assert want() == (3, [1])


@pytest.mark.parametrize(("times", "shows"), [(1, True), (2, False)])
def test_a_sprite_that_fails_is_cast_once_more_and_told_if_that_fails_too(
    monkeypatch: pytest.MonkeyPatch, times: int, shows: bool
) -> None:
    labels = np.zeros((24, 24, 24), np.uint16)
    labels[4:20, 4:20, 4:20] = 1
    session, shown = Session((1500 * labels).astype(np.uint16), labels), {}
    session.backend = "cpu"
    failures, told = [MemoryError("Unable to allocate 3 MiB")] * times, []

    def failing(*given: Any) -> Any:
        if failures:
            raise failures.pop()
        return sprite_image(*given)

    monkeypatch.setattr(sprite_renderer, "sprite_image", failing)
    scheduler = ManualScheduler(told.append)
    renderer = SpriteRenderer(session, scheduler, shown.update)
    session.force_unpack(1)
    renderer.want(session.poses, frozenset(session.poses), 2.0, {})
    scheduler.finish_tasks()
    assert failures == []
    assert (renderer.settled, 1 in shown) == (shows, shows)
    assert len(told) == times - 1
