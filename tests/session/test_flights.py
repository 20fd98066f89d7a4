"""Where objects fly: along D, round the bag, never through it, and back the way they came."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bags import session_of, stack_of_plates

from napari_unpack import Session, simulate_bag
from napari_unpack.geometry.axes import transform_points
from napari_unpack.geometry.transforms import packed_pose, rotation_about
from napari_unpack.geometry.view import Camera
from napari_unpack.session import ObjectState
from napari_unpack.unpacking import Flight


@pytest.fixture(scope="module")
def bag() -> Any:
    return simulate_bag(seed=2, shape=(48, 56, 72), count=9)


def flying(bag: Any, fov: float, turned: float) -> tuple[Session, list[float]]:
    """Return a session whose flights take 1 s on the clock [now], seen from somewhere."""
    session = Session(bag.volume, bag.labels, bag.spacing, bag.objects)
    session.backend, session.animated, session.seconds = "cpu", True, 1.0
    session.look(Camera(rotation_about((1.0, 2.0, 0.5), turned), session.bag.center, 300.0, fov))
    session.look(session.overview())
    now = [0.0]
    session.clock = lambda: now[0]
    return session, now


def met(session: Session, object_id: int, now: float) -> int:
    """Count the outermost voxels of an object in the air that are in packed ones."""
    flight, camera = session.flights[object_id], session.camera
    center = session.boxes.center(object_id, session.spacing)
    moved = flight.pose(now, camera).world_from_world(center, camera)
    there = transform_points(moved, session.bag.points(object_id)) / session.spacing
    voxels = np.rint(there).astype(int)
    inside = ((voxels >= 0) & (voxels < session.labels.shape)).all(axis=1)
    packed = [i for i, state in session.states.items() if state is ObjectState.PACKED]
    return int(np.isin(session.labels[tuple(voxels[inside].T)], packed).sum())


def one_by_one(session: Session) -> Iterator[int]:
    """Unpack everything, one departure at a time, and land who was in the air after each."""
    while ObjectState.PACKED in session.states.values():
        for object_id in session.unpack(1):
            yield object_id
        for object_id in list(session.flights):
            session.land(object_id)


@pytest.mark.parametrize("direction", [None, "up", "+z", "-z", "+x", (0.3, -1.0, 0.2)])
@pytest.mark.parametrize(("fov", "turned"), [(0.0, 2.0), (30.0, 0.7)])
def test_nobody_flies_through_the_bag(bag, direction, fov, turned) -> None:
    session, _ = flying(bag, fov, turned)
    session.direction = direction
    left = []
    for object_id in one_by_one(session):
        left.append(object_id)
        start = session.flights[object_id].start
        # Once clear of the bag's box; until then moving along D is what it was tested for.
        for passed in np.linspace(0.42, 1.0, 30):
            assert met(session, object_id, start + passed) == 0
    assert len(left) == len(session.ids)


@pytest.mark.parametrize("asked_back_at", [0.15, 0.5, 0.8])
def test_asked_back_in_mid_air_it_goes_back_the_way_it_came_also_after_a_turn(
    bag, asked_back_at
) -> None:
    session, now = flying(bag, 30.0, 0.7)
    session.direction = "+z"
    (one,) = session.unpack(1)[:1]
    going = session.flights[one]
    now[0] = asked_back_at
    before = session.camera
    session.look(Camera(rotation_about((0, 1, 0), 1.9) @ before.rotation, before.center, 280.0, 30))
    session.direction = None
    session.restore([one])
    back = session.flights[one]
    # It left along +z, and nobody has looked who would be in the way along another D.
    np.testing.assert_array_equal(back.direction, going.direction)
    assert session.states[one] is ObjectState.FLYING_BACK
    for passed in np.linspace(0.0, asked_back_at, 25):
        now[0] = asked_back_at + passed
        here, then = (
            back.pose(now[0], session.camera),
            going.pose(asked_back_at - passed, session.camera),
        )
        np.testing.assert_allclose(here.center, then.center, atol=1e-6)
        np.testing.assert_allclose(here.rotation, then.rotation, atol=1e-6)
        if asked_back_at - passed > 0.42:
            assert met(session, one, now[0]) == 0
        # Turned again under way it is still on its way, of that camera.
        session.look(
            Camera(
                rotation_about((0, 0, 1), 0.05) @ session.camera.rotation,
                before.center,
                280.0,
                30.0,
            )
        )
    assert back.done(now[0] + 1e-9)
    home = packed_pose(session.boxes.center(one, session.spacing), session.camera)
    np.testing.assert_allclose(back.pose(now[0], session.camera).center, home.center, atol=1e-6)
    session.land(one)
    assert session.states[one] is ObjectState.PACKED
    assert session.poses == {}


def test_sent_out_again_on_its_way_back_it_lands_at_its_slot(bag) -> None:
    session, now = flying(bag, 0.0, 2.0)
    (one,) = session.unpack(1)[:1]
    now[0] = 0.6
    session.restore([one])
    now[0] = 0.9
    session.unpack([one])
    flight = session.flights[one]
    assert not flight.back
    session.look(Camera(np.eye(3), session.camera.center, 250.0))
    end = flight.start + flight.seconds
    pose = flight.pose(end, session.camera)
    session.land(one)
    np.testing.assert_allclose(pose.center, session.poses[one].center, atol=1e-6)
    assert session.states[one] is ObjectState.UNPACKED


def in_the_air() -> tuple[Session, list[float]]:
    """Return a session of plates whose flights take 1 s on the clock [now], the first plate out."""
    now = [0.0]
    session = session_of(stack_of_plates(), clock=lambda: now[0])
    session.unpack(1)
    session.animated, session.seconds = True, 1.0
    return session, now


def put_aside(session: Session) -> None:
    pose = session.poses[1]
    session.place(1, replace(pose, center=pose.center + np.array([0.0, -7.0, 5.0])))


def put_askew(session: Session) -> None:
    session.turn(1, rotation_about((0, 0, 1), 1.5) @ session.poses[1].rotation)


@pytest.mark.parametrize("put", [put_aside, put_askew])
def test_sent_to_another_place_on_its_way_back_it_goes_on_from_where_it_is(put) -> None:
    session, now = in_the_air()
    put(session)
    session.restore([1])
    now[0] = 0.3
    here = session.flights[1].pose(now[0], session.camera)
    # By hand it was elsewhere than in the slot that it goes to.
    session.unpack([1])
    there = session.flights[1].pose(now[0], session.camera)
    np.testing.assert_allclose(there.center, here.center, atol=1e-9)
    np.testing.assert_allclose(there.rotation, here.rotation, atol=1e-9)
    assert there.scale == pytest.approx(here.scale)


def taken_back_twice(session: Session, now: list[float], put: Callable[[Session], None]) -> None:
    put(session)
    session.restore([1])
    now[0] = 2.0
    session.land(1)
    session.undo()
    now[0] += 0.3
    session.undo()


def under_way(session: Session, now: list[float], change: Callable[[Session], None]) -> None:
    session.restore([1])
    session.land(1)
    session.unpack([1])
    now[0] += 0.3
    change(session)


@pytest.mark.parametrize(
    "act",
    [
        lambda s, now: taken_back_twice(s, now, put_aside),
        lambda s, now: taken_back_twice(s, now, put_askew),
        lambda s, now: under_way(s, now, lambda s: s.look(replace(s.camera, fov=45.0))),
        lambda s, now: under_way(s, now, lambda s: s.look(replace(s.camera, stretch=-np.eye(3)))),
        lambda s, now: under_way(
            s, now, lambda s: s.turn(1, rotation_about((0, 0, 1), 1.5) @ s.camera.rotation)
        ),
    ],
    ids=["moved back", "turned back", "perspective", "mirrored", "turned"],
)
def test_what_changes_while_an_object_flies_changes_where_it_lands(act) -> None:
    session, now = in_the_air()
    act(session, now)
    flight = session.flights[1]
    assert not flight.back
    pose = flight.pose(flight.start + flight.seconds, session.camera)
    session.land(1)
    landed = session.poses[1]
    np.testing.assert_allclose(pose.center, landed.center, atol=1e-9)
    np.testing.assert_allclose(pose.rotation, landed.rotation, atol=1e-9)
    assert pose.scale == pytest.approx(landed.scale)


@pytest.mark.parametrize("asked", [0.0, 0.1, 0.201])
def test_taken_out_again_before_its_way_back_has_begun_it_does_not_jump_to_another_slot(
    asked,
) -> None:
    now = [0.0]
    session = session_of(stack_of_plates(), clock=lambda: now[0])
    # Sideways nobody is in another's way.
    session.direction = "+y"
    session.unpack(3)
    session.animated, session.seconds = True, 1.0
    # The last to leave goes back first: the others wait for their turn.
    session.restore(3)
    waiting = sorted(session.flights, key=lambda i: session.flights[i].start)[1]
    now[0] = asked
    stood = session.flights[waiting].pose(now[0], session.camera).center
    session.unpack([waiting])
    went = session.flights[waiting]
    assert np.linalg.norm(went.target.center - stood) > 1
    there = [went.pose(asked + t, session.camera).center for t in np.linspace(0, 1, 201)]
    np.testing.assert_allclose(there[0], stood, atol=1e-9)
    assert np.linalg.norm(np.diff(there, axis=0), axis=1).max() < 0.5
    session.land(waiting)
    np.testing.assert_allclose(there[-1], session.poses[waiting].center, atol=1e-9)


def turns(flight: Flight) -> int:
    """Count the flights that one turns from."""
    return 0 if flight.before is None else 1 + turns(flight.before)


def test_however_often_the_view_changes_a_flight_turns_from_one_other_at_most() -> None:
    session, now = in_the_air()
    session.look(replace(session.camera, fov=30.0))
    session.restore([1])
    session.land(1)
    session.unpack([1])
    now[0] = 0.4
    session.turn(1, rotation_about((0, 0, 1), 1.5) @ session.camera.rotation)
    assert turns(session.flights[1]) == 1
    for k in range(1, 91):
        now[0] += 0.005
        before = session.flights[1].pose(now[0], session.camera)
        session.look(replace(session.camera, fov=30.0 + 0.01 * k))
        # The turn that was begun goes on: a hundredth of a degree more makes nothing jump.
        after = session.flights[1].pose(now[0], session.camera)
        np.testing.assert_allclose(after.rotation, before.rotation, atol=1e-3)
        np.testing.assert_allclose(after.center, before.center, atol=0.1)
    assert turns(session.flights[1]) == 1
    pose = session.flights[1].pose(9.0, session.camera)
    session.land(1)
    np.testing.assert_allclose(pose.center, session.poses[1].center, atol=1e-9)
    np.testing.assert_allclose(pose.rotation, session.poses[1].rotation, atol=1e-9)


def test_a_view_that_differs_by_rounding_sends_no_flight_elsewhere() -> None:
    session, now = in_the_air()
    session.look(replace(session.camera, fov=30.0))
    session.unpack(1)
    flights, now[0] = dict(session.flights), 0.3
    assert flights
    session.look(replace(session.camera, fov=30.0 + 1e-8))
    assert dict(session.flights) == flights
