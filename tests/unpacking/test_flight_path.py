from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from napari_unpack.geometry.axes import transform_points
from napari_unpack.geometry.transforms import Pose, packed_pose, rotation_about
from napari_unpack.geometry.view import Camera, View
from napari_unpack.unpacking import Ball, Flight, clearance
from napari_unpack.unpacking.flight_path import path_around_bag

SHAPE, SPACING = (100, 100, 100), (1.0, 1.0, 1.0)
CENTER = np.array([30.0, 40.0, 50.0])
BALL = Ball(np.array([50.0, 50.0, 50.0]), 100.0)


def camera(direction=(0.0, 0.0, 1.0), fov=0.0) -> Camera:
    return View(direction=direction, fov=fov, height=400.0).camera(SHAPE, SPACING)


def flight(**changes) -> Flight:
    target = Pose(np.array([0.0, 20.0, 150.0]), rotation_about((0, 1, 1), 0.7), 0.5)
    settings = {"start": 10.0, "seconds": 2.0, **changes}
    return Flight(7, CENTER, np.array([0.0, 0.0, -1.0]), 60.0, target, BALL, **settings)


def assert_same(a: Pose, b: Pose, atol: float = 1e-9) -> None:
    np.testing.assert_allclose(a.center, b.center, atol=atol)
    np.testing.assert_allclose(a.rotation, b.rotation, atol=atol)
    assert a.scale == pytest.approx(b.scale, abs=atol)


def test_clearance_is_the_shortest_way_out_of_the_box_along_d():
    bag = (0, 0, 0), (100, 100, 100)
    # The object spans 20 to 40 along every axis: against +z its lower face must reach 100.
    low, high = (20, 20, 20), (40, 40, 40)
    assert clearance(low, high, *bag, (1, 0, 0)) == pytest.approx(80)
    assert clearance(low, high, *bag, (-1, 0, 0)) == pytest.approx(40)
    # Along a diagonal one axis is enough: 40 / (1 / sqrt 2) against -y, less than 80 sqrt 2.
    d = np.array([0, -1, 1]) / np.sqrt(2)
    assert clearance(low, high, *bag, d) == pytest.approx(40 * np.sqrt(2))
    assert clearance((120, 20, 20), (140, 40, 40), *bag, (1, 0, 0)) == 0


@pytest.mark.parametrize("fov", [0.0, 30.0])
@pytest.mark.parametrize("direction", [(0.0, 0.0, 1.0), (0.3, -0.5, 0.8)])
def test_a_flight_starts_packed_and_ends_at_its_slot(fov, direction):
    now = camera(direction, fov)
    assert_same(flight().pose(10.0, now), packed_pose(CENTER, now))
    assert_same(flight().pose(12.0, now), flight().target)
    assert_same(flight().pose(-5.0, now), packed_pose(CENTER, now))
    assert_same(flight().pose(99.0, now), flight().target)


def test_it_is_seen_as_the_bag_is_until_clear_of_it_and_as_its_sprite_at_its_slot():
    now, going = camera(fov=30.0), flight()
    clear = 10.0 + 2.0 * going.first_leg(now)
    flat = [going.flatness(time, now) for time in (-5.0, 10.0, clear, 12.0, 99.0)]
    assert flat == pytest.approx([0, 0, 0, 1, 1], abs=1e-12)
    # Smoothly: half of it half way through the rest.
    assert going.flatness((clear + 12.0) / 2, now) == pytest.approx(0.5)
    # Turned round, and sent elsewhere, it does not jump.
    back, bent = going.reversed(11.5), going.toward(replace(going.target, scale=1.0), 11.5)
    for other in (back, bent):
        assert other.flatness(11.5, now) == pytest.approx(going.flatness(11.5, now))
    assert (back.flatness(13.0, now), bent.flatness(12.5, now)) == (0, 1)


def test_the_box_centre_lands_on_u():
    """Eqs. 3 and 4: the moved centre of the box projects onto the slot."""
    now = camera((0.3, -0.5, 0.8), 30.0)
    pose = flight().pose(12.0, now)
    world = transform_points(pose.world_from_world(CENTER, now), CENTER)
    seen = transform_points(now.pivot_from_world(), world)
    np.testing.assert_allclose(seen, flight().target.center, atol=1e-6)


def test_until_it_is_clear_of_the_bag_an_object_goes_straight_along_d_and_does_not_turn():
    now = camera((0.3, -0.5, 0.8))
    home = packed_pose(CENTER, now)
    along = now.rotation @ flight().direction
    gone = []
    for fraction in np.linspace(0, 1, 400):
        pose = flight().pose_at(fraction, now)
        moved = pose.center - home.center
        way = float(moved @ along)
        if way < 60.0 - 1e-6 and fraction < 0.42:
            np.testing.assert_allclose(moved, way * along, atol=1e-9)
            np.testing.assert_allclose(pose.rotation, now.rotation, atol=1e-12)
            assert pose.scale == 1.0
            gone.append(way)
    assert len(gone) > 50
    assert (np.diff(gone) >= 0).all()


def test_the_way_is_continuous():
    now = camera((0.3, -0.5, 0.8), 30.0)
    poses = [flight().pose_at(f, now) for f in np.linspace(0, 1, 2001)]
    steps = np.linalg.norm(np.diff([p.center for p in poses], axis=0), axis=1)
    assert steps.max() < 1.5
    turns = [np.abs(a.rotation - b.rotation).max() for a, b in pairwise(poses)]
    assert max(turns) < 0.01


@pytest.mark.parametrize("clear", [15.0, 148.0])
@pytest.mark.parametrize("target", [(0.0, 20.0, 150.0), (0.0, 130.0, -60.0)])
def test_it_neither_jerks_nor_halts_on_the_way(clear: float, target: tuple[float, ...]) -> None:
    going = replace(flight(), clear=clear, target=Pose(np.array(target), np.eye(3), 0.5))
    now = camera((0.3, -0.5, 0.8))
    centers = [going.pose_at(f, now).center for f in np.linspace(0, 1, 401)]
    speeds = np.linalg.norm(np.diff(centers, axis=0), axis=1)
    # A sharp bend, of which a step sees the chord, takes a sixth of the mean.
    assert np.abs(np.diff(speeds)).max() < 0.2 * speeds.mean()
    assert speeds[60:340].min() > 0.25 * speeds.mean()


def test_what_leaves_together_goes_the_first_leg_side_by_side_wherever_it_is_going() -> None:
    now, near = camera((0.3, -0.5, 0.8)), flight()
    far = replace(near, target=Pose(np.array([0.0, 300.0, -400.0]), np.eye(3), 0.3))
    assert near.first_leg(now) == far.first_leg(now) > 0.2
    for fraction in np.linspace(0, near.first_leg(now), 9)[:-1]:
        assert_same(near.pose_at(fraction, now), far.pose_at(fraction, now))


def test_the_way_back_is_the_way_out_backwards_also_after_the_bag_was_turned():
    back = flight(back=True)
    for now in (camera(), camera((1.0, 0.2, 0.1))):
        for passed in np.linspace(0, 2, 9):
            assert_same(back.pose(10 + passed, now), flight().pose(12 - passed, now))
        assert_same(back.pose(12.0, now), packed_pose(CENTER, now))


@settings(max_examples=40, deadline=None)
@given(st.floats(10, 12), st.booleans())
def test_turning_round_in_mid_air_does_not_jump_and_takes_as_long_as_it_has_been_under_way(t, back):
    going, now = flight(back=back), camera((0.2, 0.9, 0.1))
    turned = going.reversed(t)
    assert turned.back is not back
    assert_same(turned.pose(t, now), going.pose(t, now), atol=1e-6)
    assert turned.start + turned.seconds == pytest.approx(t + (t - 10.0))


def test_nobody_flies_through_the_eye():
    near = View(direction=(0, 0, 1), fov=120.0, height=100.0).camera(SHAPE, SPACING)
    for fraction in np.linspace(0, 1, 50):
        assert flight().pose_at(fraction, near).center[0] <= 0.6 * near.distance + 1e-9


def test_what_has_no_room_towards_the_eye_turns_aside_at_once() -> None:
    near = View(direction=(0, 0, 1), fov=120.0, height=20.0).camera(SHAPE, SPACING)
    towards = replace(flight(), box_center=np.array([50.0, 50.0, 12.0]))
    assert towards.first_leg(near) == 0.0
    start, soon = (towards.pose_at(f, near).center for f in (0.0, 0.2))
    assert np.linalg.norm(soon - start) > 1.0


@pytest.mark.parametrize("d", [(0.0, 0.0, -1.0), (0.4, -0.5, -0.9)])
@pytest.mark.parametrize("height", [200.0, 100.0, 40.0, 20.0])
def test_in_a_view_zoomed_in_an_object_never_goes_back_nor_aside_on_its_first_leg(d, height):
    near = View(direction=(0, 0, 1), fov=60.0, height=height).camera(SHAPE, SPACING)
    box_center = np.array([30.0, 40.0, 20.0])
    along = np.array(d) / np.linalg.norm(d)
    going = replace(flight(), box_center=box_center, direction=along)
    start, along = packed_pose(box_center, near).center, near.rotation @ going.direction
    first = going.first_leg(near)
    gone = [going.pose_at(f, near).center - start for f in np.linspace(0, first, 50)]
    way = np.array(gone) @ along
    assert (np.diff(way) >= -1e-9).all()
    np.testing.assert_allclose(gone, way[:, None] * along, atol=1e-9)
    # From there on it keeps as far from the eye as it was allowed to come.
    limit = max(0.6 * near.distance, start[0])
    depths = [going.pose_at(f, near).center[0] for f in np.linspace(0, 1, 50)]
    assert max(depths) <= limit + 1e-9


def test_an_object_outside_the_bag_goes_straight_to_its_slot():
    free = Flight(1, CENTER, np.array([0.0, 0.0, -1.0]), 0.0, flight().target, BALL)
    np.testing.assert_allclose(free.pose_at(0.0, camera()).rotation, camera().rotation)
    assert not np.allclose(free.pose_at(0.1, camera()).rotation, camera().rotation)


def test_progress_and_arrival():
    assert [flight().progress(t) for t in (9, 10, 11, 12, 13)] == [0, 0, 0.5, 1, 1]
    assert [flight().done(t) for t in (11.9, 12.0)] == [False, True]
    with pytest.raises(ValueError, match="seconds must be positive"):
        flight(seconds=0.0)


def test_round_a_ball_the_way_begins_and_ends_where_it_should_and_keeps_out():
    start, along, center = np.array([0.0, 40.0, 10.0]), np.array([0.0, 1.0, 0.0]), np.zeros(3)
    for target in ([0.0, -130.0, 0.0], [0.0, 20.0, 125.0], [0.0, 140.0, 0.0], [0.0, -90.0, -90.0]):
        gone = np.linspace(0, 1, 501)
        way = path_around_bag(start, along, np.array(target), center, 100.0, gone)
        np.testing.assert_allclose(way[0], start, atol=1e-9)
        np.testing.assert_array_equal(way[-1], target)
        steps = np.linalg.norm(np.diff(way, axis=0), axis=1)
        assert steps.max() < 2.5
        distances = np.linalg.norm(way, axis=1)
        assert distances[distances.argmax() :].min() >= 100.0


def test_to_the_opposite_side_it_passes_before_the_bag():
    start, along = np.array([0.0, 120.0, 0.0]), np.array([0.0, 1.0, 0.0])
    way = path_around_bag(start, along, -start, np.zeros(3), 100.0, np.linspace(0, 1, 21))
    assert max(p[0] for p in way) > 100.0
    assert min(p[0] for p in way) >= -1e-9


def test_an_object_shrinks_as_fast_as_it_goes_so_that_it_stays_in_the_window():
    """It ends small beside the window's edge: still large there, it would reach out of it."""
    now = camera()
    sideways = now.in_world((0.0, 0.0, 1.0))
    home = packed_pose(CENTER, now).center
    target = Pose(home + np.array([0.0, 0.0, 200.0]), np.eye(3), 0.25)
    leaving = Flight(7, CENTER, sideways, 60.0, target, BALL)
    # Of a box 80 mm wide: how far right its right side is.
    poses = [leaving.pose_at(f, now) for f in np.linspace(0, 1, 200)]
    reach = [pose.center[2] + 40 * pose.scale for pose in poses]
    # The last of the way is an arc about the ball's centre, from which the slot lies 180 mm to the
    # right and 10 mm up: no place on it is further right than hypot(180, 10) = 180.28 mm.
    assert max(reach) <= home[2] + 200 + 40 * 0.25 + (np.hypot(180, 10) - 180)
