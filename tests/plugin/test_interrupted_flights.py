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
    viewer, stage = staged
    stage.recolor_at_rest = False
    stage.seconds = LONG
    time = [100.0]
    monkeypatch.setattr(session, "clock", lambda: time[0])

    def tell(seconds: float) -> None:
        time[0] += seconds
        assert stage.step(30)

    return viewer, stage, tell


def place(stage: Any, object_id: int) -> np.ndarray:
    """Return where an object in the air is now, pivot space, mm."""
    session = stage.session
    return session.flights[object_id].pose(session.clock(), session.camera).center


def seen(stage: Any) -> dict[int, int]:
    """Count in how many of the three layers every object shows."""
    session = stage.session
    packed = {i for i, s in session.states.items() if s is IN}
    return {
        i: (i in packed) + (i in stage.transition.shots) + (i in stage.sprites.sprites)
        for i in session.states
    }


def test_restored_on_its_way_out_it_turns_round_where_it_is(paced, session) -> None:
    _, stage, tell = paced
    (one,) = stage.unpack(1)
    tell(0.4 * LONG)
    there = place(stage, one)
    stage.restore([one])
    assert session.states[one] is ObjectState.FLYING_BACK
    np.testing.assert_allclose(place(stage, one), there, atol=1e-6)
    tell(0.39 * LONG)
    assert stage.flying
    tell(0.02 * LONG)
    assert not stage.flying
    assert session.states[one] is IN
    assert session.poses == {}
    assert set(seen(stage).values()) == {1}


def test_unpacked_on_its_way_back_it_turns_round_where_it_is(paced, session) -> None:
    _, stage, tell = paced
    (one,) = stage.unpack(1)
    stage.finish()
    assert stage.settle(30)
    stage.restore([one])
    tell(0.7 * LONG)
    there = place(stage, one)
    stage.unpack([one])
    assert session.states[one] is ObjectState.FLYING_OUT
    np.testing.assert_allclose(place(stage, one), there, atol=1e-6)
    for _ in range(3):
        stage.undo()
        stage.redo()
    np.testing.assert_allclose(place(stage, one), there, atol=1e-6)
    tell(0.72 * LONG)
    assert not stage.flying
    assert session.states[one] is OUT
    assert seen(stage)[one] == 1
    assert one in stage.sprites.sprites


def test_turned_in_mid_flight_they_still_land_at_their_slots(paced, session) -> None:
    viewer, stage, tell = paced
    flown = stage.unpack(3)
    slots = {i: session.poses.get(i, session.flights[i].target).center for i in flown}
    tell(0.3 * LONG)
    assert set(stage.transition.shots) == set(flown)
    before = {i: place(stage, i) for i in flown}
    viewer.scene.camera.angles = (20, 60, 100)
    assert stage.step(30)
    # The camera reads whole and turned: those near the bag went round with it.
    assert any(np.linalg.norm(place(stage, i) - before[i]) > 1.0 for i in flown)
    assert set(stage.transition.shots) == set(flown)
    viewer.scene.camera.zoom *= 1.3
    tell(0.3 * LONG)
    tell(2 * LONG)
    assert not stage.flying
    for i in flown:
        np.testing.assert_allclose(session.poses[i].center, slots[i], atol=1e-6)
    assert all(seen(stage)[i] == 1 for i in flown)


def test_many_commands_in_the_air_at_once(paced, session) -> None:
    _, stage, tell = paced
    first = stage.unpack(2)
    tell(0.2 * LONG)
    second = stage.unpack(2)
    assert len(set(first) | set(second)) == 4
    tell(0.1 * LONG)
    stage.restore([first[0]])
    tell(0.1 * LONG)
    session.hide([second[0]])
    assert session.states[second[0]] is ObjectState.HIDDEN
    assert second[0] not in session.flights
    assert stage.step(30)
    assert second[0] not in stage.transition.shots
    session.show([second[0]])
    assert session.states[second[0]] is OUT
    stage.inspect(first[1])
    assert session.states[first[1]] is ObjectState.INSPECTED
    assert first[1] not in session.flights
    tell(0.1 * LONG)
    stage.go_to(0, flying=True)
    tell(0.5 * LONG)
    stage.go_to(3, flying=True)
    tell(0.01)
    tell(4 * LONG)
    assert not stage.flying
    states = list(session.states.values())
    assert states.count(OUT) + states.count(IN) == len(states)
    assert set(seen(stage).values()) == {1}


def test_closed_in_mid_flight_both_ways(paced, session) -> None:
    viewer, stage, tell = paced
    out = stage.unpack(2)
    stage.finish()
    more = stage.unpack(1)
    stage.restore([out[0]])
    tell(0.2 * LONG)
    assert len(session.flights) == 2
    stage.close()
    assert session.flights == {}
    assert {i for i, s in session.states.items() if s is OUT} == {out[1], *more}
    assert len(viewer.layers) == 0
    stage.close()


def test_sent_home_while_a_hand_holds_it_it_flies_and_is_seen_once(paced, session) -> None:
    _, stage, tell = paced
    (one,) = stage.unpack(1)
    tell(1.1 * LONG)
    quarter = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    stage.turn(one, quarter)
    stage.restore(1)
    tell(0.5 * LONG)
    shown = stage._projector._director.moving(session.clock(), stage.frame)
    np.testing.assert_allclose(shown[one].pose.center, place(stage, one), atol=1e-6)
    tell(0.6 * LONG)
    stage.turned(one)
    assert stage.settle(30)
    assert session.states[one] is IN
    assert set(seen(stage).values()) == {1}
