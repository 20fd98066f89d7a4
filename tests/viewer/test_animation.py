"""Flights turned round, looked round, and left in the air: nobody is lost, nobody jumps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from napari_unpack.session import ObjectState

LONG = 5.0
IN, OUT = ObjectState.PACKED, ObjectState.UNPACKED


@pytest.fixture
def paced(staged, session, monkeypatch) -> Any:
    """Return (viewer, stage, tell): flights of 5 s on a clock that `tell` moves."""
    viewer, controller = staged
    controller.recolor_at_rest = False
    controller.seconds = LONG
    time = [100.0]
    monkeypatch.setattr(session, "clock", lambda: time[0])

    def tell(seconds: float) -> None:
        time[0] += seconds
        assert controller.step(30)

    return viewer, controller, tell


def place(controller: Any, object_id: int) -> np.ndarray:
    """Return where an object in the air is now, pivot space, mm."""
    session = controller.session
    return session.flights[object_id].pose(session.clock(), session.camera).center


def seen(controller: Any) -> dict[int, int]:
    """Count in how many of the three layers every object shows."""
    session = controller.session
    packed = {i for i, s in session.states.items() if s is IN}
    return {
        i: (i in packed) + (i in controller.transition.images) + (i in controller.sprites.sprites)
        for i in session.states
    }


def test_restored_on_its_way_out_it_turns_round_where_it_is(paced, session) -> None:
    _, controller, tell = paced
    (one,) = controller.unpack(1)
    tell(0.4 * LONG)
    there = place(controller, one)
    controller.restore([one])
    assert session.states[one] is ObjectState.FLYING_BACK
    np.testing.assert_allclose(place(controller, one), there, atol=1e-6)
    tell(0.39 * LONG)
    assert controller.flying
    tell(0.02 * LONG)
    assert not controller.flying
    assert session.states[one] is IN
    assert session.poses == {}
    assert set(seen(controller).values()) == {1}


def test_unpacked_on_its_way_back_it_turns_round_where_it_is(paced, session) -> None:
    _, controller, tell = paced
    (one,) = controller.unpack(1)
    controller.finish()
    assert controller.settle(30)
    controller.restore([one])
    tell(0.7 * LONG)
    there = place(controller, one)
    controller.unpack([one])
    assert session.states[one] is ObjectState.FLYING_OUT
    np.testing.assert_allclose(place(controller, one), there, atol=1e-6)
    for _ in range(3):
        controller.undo()
        controller.redo()
    np.testing.assert_allclose(place(controller, one), there, atol=1e-6)
    tell(0.72 * LONG)
    assert not controller.flying
    assert session.states[one] is OUT
    assert seen(controller)[one] == 1
    assert one in controller.sprites.sprites


def test_turned_in_mid_flight_they_still_land_at_their_slots(paced, session) -> None:
    viewer, controller, tell = paced
    flown = controller.unpack(3)
    slots = {i: session.poses.get(i, session.flights[i].target).center for i in flown}
    tell(0.3 * LONG)
    assert set(controller.transition.images) == set(flown)
    before = {i: place(controller, i) for i in flown}
    # So that nobody who goes round with the bag leaves the window.
    viewer.scene.camera.zoom *= 0.6
    viewer.scene.camera.angles = (20, 60, 100)
    assert controller.step(30)
    # The camera reads whole and turned: those near the bag went round with it.
    assert any(np.linalg.norm(place(controller, i) - before[i]) > 1.0 for i in flown)
    assert set(controller.transition.images) == set(flown)
    viewer.scene.camera.zoom *= 1.3
    tell(0.3 * LONG)
    tell(2 * LONG)
    assert not controller.flying
    for i in flown:
        np.testing.assert_allclose(session.poses[i].center, slots[i], atol=1e-6)
    assert all(seen(controller)[i] == 1 for i in flown)


def test_many_commands_in_the_air_at_once(paced, session) -> None:
    _, controller, tell = paced
    first = controller.unpack(2)
    tell(0.2 * LONG)
    second = controller.unpack(2)
    assert len(set(first) | set(second)) == 4
    tell(0.1 * LONG)
    controller.restore([first[0]])
    tell(0.1 * LONG)
    session.hide([second[0]])
    assert session.states[second[0]] is ObjectState.HIDDEN
    assert second[0] not in session.flights
    assert controller.step(30)
    assert second[0] not in controller.transition.images
    session.show([second[0]])
    assert session.states[second[0]] is OUT
    controller.inspect(first[1])
    assert session.states[first[1]] is ObjectState.INSPECTED
    assert first[1] not in session.flights
    tell(0.1 * LONG)
    controller.go_to(0, flying=True)
    tell(0.5 * LONG)
    controller.go_to(3, flying=True)
    tell(0.01)
    tell(4 * LONG)
    assert not controller.flying
    states = list(session.states.values())
    assert states.count(OUT) + states.count(IN) == len(states)
    assert set(seen(controller).values()) == {1}


def test_closed_in_mid_flight_both_ways(paced, session) -> None:
    viewer, controller, tell = paced
    out = controller.unpack(2)
    controller.finish()
    more = controller.unpack(1)
    controller.restore([out[0]])
    tell(0.2 * LONG)
    assert len(session.flights) == 2
    controller.close()
    assert session.flights == {}
    assert {i for i, s in session.states.items() if s is OUT} == {out[1], *more}
    assert len(viewer.layers) == 0
    controller.close()


def test_in_perspective_nothing_jumps_between_the_bag_its_sprite_and_a_hand(
    paced, session, qtbot
) -> None:
    viewer, controller, tell = paced
    viewer.scene.camera.perspective = 120.0
    (one,) = controller.unpack(1)

    def flatness() -> float:
        moving = controller.renderer.animator.moving(session.clock(), controller.frame)
        return moving[one].flatness

    assert flatness() == 0.0
    tell(0.99 * LONG)
    assert flatness() == pytest.approx(1.0, abs=0.01)
    tell(0.1 * LONG)
    assert controller.settle(30)
    sprite = controller.sprites.sprites[one].place
    controller.renderer.held.turn(one, np.eye(3))
    qtbot.waitUntil(lambda: one in controller.transition.images, timeout=10000)
    held = controller.transition.images[one].quad(controller.frame.camera).place
    # A pixel of what moves is up to two and a half of the screen.
    atol = 2.5 * controller.frame.camera.height / controller.frame.size[0]
    np.testing.assert_allclose(held.center[1:], sprite.center[1:], atol=atol)
    np.testing.assert_allclose(held.half, sprite.half, atol=atol)


def test_sent_home_while_a_hand_holds_it_it_flies_and_is_seen_once(paced, session) -> None:
    _, controller, tell = paced
    (one,) = controller.unpack(1)
    tell(1.1 * LONG)
    quarter = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    controller.renderer.held.turn(one, quarter)
    controller.restore(1)
    tell(0.5 * LONG)
    shown = controller.renderer.animator.moving(session.clock(), controller.frame)
    np.testing.assert_allclose(shown[one].pose.center, place(controller, one), atol=1e-6)
    tell(0.6 * LONG)
    controller.renderer.held.turned(one)
    assert controller.settle(30)
    assert session.states[one] is IN
    assert set(seen(controller).values()) == {1}
