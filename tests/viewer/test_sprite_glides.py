"""Sprites glide to slots planned anew, and jump nowhere else."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from manual_scheduler import ManualScheduler
from napari_unpack.geometry.transforms import Pose
from napari_unpack.viewer.animation import GLIDE_SECONDS, Glides

EYE = np.eye(3)


@pytest.fixture
def movements_cut_short() -> None:
    """Leave glides as long as they are: their clock is moved by hand here."""


@pytest.fixture
def glides(qapp):
    """Return (Glides, its scheduler)."""
    scheduler = ManualScheduler()
    return Glides(scheduler, lambda: None, lambda: True), scheduler


def at(*center: float) -> dict[int, Pose]:
    return {1: Pose(np.array(center), EYE)}


def center(poses: dict[int, Pose]) -> list[float]:
    return [float(v) for v in poses[1].center]


def test_a_new_plan_is_glided_to_from_wherever_the_sprite_is(glides) -> None:
    made, scheduler = glides
    first, second, third = object(), object(), object()
    assert center(made.follow(at(0, 0, 0), first)) == [0, 0, 0]
    assert made.settled
    assert center(made.follow(at(0, 8, 0), second)) == [0, 0, 0]
    scheduler.advance(1000 * GLIDE_SECONDS / 4)
    # Smoothstep at a quarter: 3/16 - 2/64 = 5/32.
    assert center(made.follow(at(0, 8, 0), second)) == pytest.approx([0, 1.25, 0])
    assert center(made.follow(at(0, 8, 4), third)) == pytest.approx([0, 1.25, 0])
    scheduler.advance(1000 * GLIDE_SECONDS / 2)
    assert center(made.follow(at(0, 8, 4), third)) == pytest.approx([0, 4.625, 2])
    assert not made.settled
    scheduler.advance(1000 * GLIDE_SECONDS)
    assert center(made.follow(at(0, 8, 4), third)) == [0, 8, 4]
    assert made.settled


def test_sprites_grow_and_shrink_on_the_way(glides) -> None:
    made, scheduler = glides
    small, large = ({1: Pose(np.zeros(3), EYE, scale)} for scale in (1.0, 4.0))
    made.follow(small, object())
    plan = object()
    assert made.follow(large, plan)[1].scale == pytest.approx(1.0)
    scheduler.advance(1000 * GLIDE_SECONDS / 2)
    assert made.follow(large, plan)[1].scale == pytest.approx(2.0)


def test_a_hand_a_landing_and_reduced_motion_jump(glides) -> None:
    made, scheduler = glides
    plan = object()
    made.follow({}, plan)
    assert center(made.follow(at(0, 1, 0), plan)) == [0, 1, 0]
    assert center(made.follow(at(0, 5, 0), plan)) == [0, 5, 0]
    other = object()
    made.follow(at(0, 9, 0), other)
    scheduler.advance(1000 * GLIDE_SECONDS / 2)
    assert center(made.follow(at(0, 2, 0), other)) == [0, 2, 0]
    still = Glides(scheduler, lambda: None, lambda: False)
    still.follow(at(0, 0, 0), plan)
    assert center(still.follow(at(0, 3, 0), other)) == [0, 3, 0]
    assert still.settled


def test_sprites_glide_when_the_window_takes_another_shape(
    staged, session, qtbot, monkeypatch
) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = False
    out = controller.unpack(3)
    controller.finish()
    assert controller.settle(30)
    controller.fade.allowed = True
    before = {i: controller.sprites.sprites[i].pose.center.copy() for i in out}
    shown: list[dict[int, np.ndarray]] = []
    show = controller.sprites.show

    def watched(sprites) -> None:
        shown.append({i: sprite.pose.center.copy() for i, sprite in sprites.items()})
        show(sprites)

    monkeypatch.setattr(controller.renderer.sprite_renderer, "show", watched)
    # Every look at the clock is a twentieth of a glide later, however slow the machine.
    looks = itertools.count()
    clock = controller.renderer.glides.animation
    monkeypatch.setattr(clock, "now", lambda: next(looks) * GLIDE_SECONDS / 20)
    width = session.canvas_size[1]
    viewer.window.resize(1060, 560)
    qtbot.waitUntil(lambda: session.canvas_size[1] > width, timeout=20000)
    assert controller.settle(30)
    one = max(out, key=lambda i: float(np.linalg.norm(session.poses[i].center - before[i])))
    whole = session.poses[one].center - before[one]
    assert np.linalg.norm(whole) > 5.0
    # On a straight line from the old slot to the new one, never back.
    gone = [float((at[one] - before[one]) @ whole / (whole @ whole)) for at in shown]
    assert gone[-1] == pytest.approx(1.0)
    assert any(0.02 < part < 0.98 for part in gone)


def test_in_a_film_sprites_glide_by_its_clock(staged, session) -> None:
    _, controller = staged
    controller.recolor_at_rest = False
    controller.fade.allowed = True
    out = controller.unpack(4)
    controller.finish()
    assert controller.settle(30)
    before = {i: controller.sprites.sprites[i].pose.center.copy() for i in out}
    time = [100.0]
    session.clock = lambda: time[0]
    controller.seconds = 10.0
    # There is room for four, and then for more.
    controller.unpack(1)
    for share in (0.5, 1.0):
        time[0] = 100.0 + share * GLIDE_SECONDS + 1e-6
        assert controller.step(30)
        assert session.flights
        for i in out:
            way = session.poses[i].center - before[i]
            assert np.linalg.norm(way) > 5.0
            there = controller.sprites.sprites[i].pose.center
            np.testing.assert_allclose(there, before[i] + share * way, atol=1e-2)
