"""What the stage shows, and how little it casts to show it."""

from __future__ import annotations

import numpy as np

from counted_passes import assert_camera_hue_and_transfer_function_each_cast_anew, settled_passes
from napari_unpack.layers.rendered_image import RESTING
from napari_unpack.session import ObjectState
from opened_panel import at_rest
from viewer_fixtures import canvas


def moved(before: np.ndarray, after: np.ndarray) -> bool:
    return bool(np.abs(before - after).max() > 8)


def sprite_pixels(controller) -> np.ndarray:
    """Return rows first, last and columns first, last of the sprite as the frame has it."""
    (sprite,) = controller.sprites.sprites.values()
    place = sprite.quad(RESTING).place
    half = np.array([0, *place.half]) - RESTING.margin * sprite.mm
    half[0] = 0
    low, high = np.array(place.center) - half, np.array(place.center) + half
    camera, size = controller.frame.camera, controller.frame.size
    return np.concatenate([camera.pixels(low, size), camera.pixels(high, size)])


def test_the_bag_is_drawn_where_its_boxes_project_to(staged, session) -> None:
    viewer, controller = staged
    picture = canvas(viewer)
    rows, cols = np.nonzero((picture - picture[0, 0]).max(axis=2) > 40)
    corners = np.concatenate([session.boxes.corners(i, session.spacing) for i in session.ids])
    pixels = controller.frame.camera.project(corners, controller.frame.size)
    seen = [rows.min(), rows.max(), cols.min(), cols.max()]
    expected = np.stack([pixels.min(axis=0), pixels.max(axis=0)], axis=1).ravel()
    np.testing.assert_allclose(seen, expected, atol=5)


def test_nothing_is_cast_for_mouse_sprites_or_other_layers(staged, qtbot) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = False
    viewer.add_points([[3, 3, 3]])
    controller.unpack(1)
    controller.finish()
    passes = settled_passes(controller)
    viewer.layers["Points"].visible = False
    viewer.layers["Sprites"].visible = False
    viewer.layers["Sprites"].visible = True
    controller.packed.visible = False
    controller.packed.visible = True
    sprite = next(iter(controller.sprites.sprites))
    controller.interaction.point_at(sprite)
    controller.renderer.held.turn(sprite, np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]]))
    controller.renderer.held.turned(sprite)
    assert settled_passes(controller) == passes


def test_camera_hue_transfer_function_and_who_leaves_each_cast_what_they_change(staged) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = False
    assert_camera_hue_and_transfer_function_each_cast_anew(viewer, controller)
    # An object that leaves recasts its window to the picture that casting all gives.
    controller.settle(30)
    controller.unpack(1)
    controller.finish()
    passes = settled_passes(controller)
    patched = controller.packed.image.patch
    controller.renderer.packed_renderer.recast()
    assert settled_passes(controller) > passes
    np.testing.assert_allclose(controller.packed.image.patch.rgba, patched.rgba, atol=2e-3)


def test_sprites_stay_while_the_bag_turns_and_pans_and_grow_with_zoom(staged) -> None:
    viewer, controller = staged
    controller.unpack(1)
    controller.finish()
    for fov in (0, 30):
        viewer.scene.camera.perspective = fov
        controller.settle(30)
        before, bag = sprite_pixels(controller), canvas(viewer)
        viewer.scene.camera.angles = (20, 40 + fov, 60)
        viewer.scene.camera.center = tuple(np.add(viewer.scene.camera.center, (0, 9, 6)))
        controller.settle(30)
        assert moved(bag, canvas(viewer))
        np.testing.assert_allclose(sprite_pixels(controller), before, atol=1.0)
        viewer.scene.camera.zoom *= 0.8
        controller.settle(30)
        middle = (np.array([*controller.frame.size, *controller.frame.size]) - 1) / 2
        np.testing.assert_allclose(
            sprite_pixels(controller) - middle, (before - middle) * 0.8, atol=1.5
        )


def test_a_flight_is_seen_on_its_way_and_lands_as_a_sprite(staged, session, qtbot) -> None:
    viewer, controller = staged
    at_rest = canvas(viewer)
    landed, frames = [], []
    controller.events.landed.connect(landed.append)
    controller.events.frame.connect(lambda: frames.append(sorted(controller.transition.images)))
    (out,) = controller.unpack(1)
    assert session.states[out] is ObjectState.FLYING_OUT
    qtbot.waitUntil(lambda: bool(frames), timeout=10000)
    assert frames[0] == [out]
    assert moved(at_rest, canvas(viewer))
    qtbot.waitUntil(lambda: not controller.flying, timeout=10000)
    assert landed == [out]
    assert controller.settle(30)
    assert set(controller.sprites.sprites) == {out}
    # The sprite has taken over: nothing is in the air any more, not for a moment.
    assert not controller.transition.images
    unpacked = canvas(viewer)
    assert moved(at_rest, unpacked)
    controller.restore(1)
    qtbot.waitUntil(lambda: not controller.flying, timeout=10000)
    assert controller.settle(30)
    assert not controller.sprites.sprites


def test_settled_is_when_nothing_is_in_the_air_for_a_moment_more(
    staged, session, qtbot, monkeypatch
) -> None:
    _, controller = staged
    controller.recolor_at_rest = False
    # Long enough for a busy machine to see it fly.
    controller.seconds = 5.0
    controller.unpack(1)
    qtbot.waitUntil(lambda: bool(controller.transition.images), timeout=20000)
    # A slow machine: the next look at what has landed comes long after all pictures are there.
    animation = controller.renderer.flight_animation
    animation.stop()
    monkeypatch.setattr("napari_unpack.viewer.scheduler.FRAME_MS", 1500)
    animation.start()
    controller.finish()
    assert controller.settle(30)
    assert not controller.transition.images


def test_an_inspected_object_fills_the_view_turns_and_keeps_its_turn(
    staged, session, qtbot
) -> None:
    _, controller = staged
    (out,) = controller.unpack(1)
    controller.finish()
    controller.settle(30)
    before = session.poses[out].rotation.copy()
    controller.inspect(out)
    assert controller.inspected == out
    at_rest(controller, qtbot)
    height = controller.transition.images[out].patch.rgba.shape[0]
    assert height > 0.35 * min(controller.frame.size)
    quarter = np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0.0]])
    controller.renderer.held.turn(out, quarter)
    controller.renderer.held.turned(out)
    controller.leave()
    qtbot.waitUntil(lambda: session.states[out] is ObjectState.UNPACKED, timeout=10000)
    np.testing.assert_allclose(session.poses[out].rotation, quarter @ before, atol=1e-9)
    assert controller.settle(30)
    assert set(controller.sprites.sprites) == {out}


def test_an_inspection_that_is_left_before_a_step_of_a_film_has_ended_with_it(
    staged, session, monkeypatch
) -> None:
    _, controller = staged
    controller.recolor_at_rest = False
    now = session.clock()
    monkeypatch.setattr(session, "clock", lambda: now)
    controller.inspect(session.ids[0])
    assert controller.packed.dimming < 1.0
    controller.leave()
    assert controller.step(30)
    assert session.state.inspected is None
    assert controller.packed.dimming == 1.0
