"""Sprites that a person turned or moved, in windows of every shape."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from bags import session_of

from napari_unpack.geometry.axes import transform_points
from napari_unpack.geometry.transforms import rotation_about
from napari_unpack.session import Session

SHAPES = [(600, 900), (300, 1500), (950, 260), (90, 120), (1000, 1000)]


def rods(count: int = 5) -> np.ndarray:
    """Long rods side by side, of different lengths, all free along z."""
    labels = np.zeros((8, 6 * count + 2, 44), np.uint16)
    for i in range(count):
        labels[2:6, 6 * i + 2 : 6 * i + 6, 2 : 42 - 3 * i] = i + 1
    return labels


def landed(session: Session) -> None:
    """Let all that is in the air arrive."""
    for object_id in session.ids:
        session.land(object_id)


@pytest.fixture
def unpacked() -> Session:
    session = session_of(rods())
    session.canvas_size = SHAPES[0]
    session.unpack(5)
    return session


def rectangle(session: Session, object_id: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the (down, right) ends in mm of all an object's voxels where its sprite is."""
    pose = session.poses[object_id]
    voxels = np.argwhere(session.labels == object_id)
    corners = (voxels[:, None] + np.indices((2, 2, 2)).reshape(3, 8).T - 0.5).reshape(-1, 3)
    center = session.boxes.center(object_id, session.spacing)
    flat = transform_points(pose.pivot_from_world(center), corners)[:, 1:]
    return flat.min(axis=0), flat.max(axis=0)


def test_turned_sprites_overlap_nobody_in_a_window_of_any_shape(unpacked: Session) -> None:
    rng = np.random.default_rng(5)
    for object_id in unpacked.ids:
        for _ in range(3):
            way = rotation_about(rng.normal(size=3), rng.uniform(0.3, 3.0))
            unpacked.turn(object_id, way @ unpacked.poses[object_id].rotation)
    for shape in SHAPES:
        unpacked.canvas_size = shape
        found = [rectangle(unpacked, i) for i in unpacked.ids]
        for k, (low, high) in enumerate(found):
            assert (np.abs([low, high]) <= np.array(unpacked.slots.window_mm) / 2).all()
            for other_low, other_high in found[:k]:
                assert ((high <= other_low) | (other_high <= low)).any(), shape


def test_a_lopsided_sprite_stays_within_its_slot() -> None:
    """A wedge: held askew it reaches further to one side of its box's middle."""
    depth, down, right = np.indices((40, 40, 40))
    labels = np.pad((depth + 2 * down + 3 * right < 60).astype(np.uint16), 3)
    session = session_of(labels)
    session.unpack(1)
    rng = np.random.default_rng(2)
    reaches = []
    for _ in range(20):
        low, high = rectangle(session, 1)
        at, half = session.poses[1].center[1:], session.slots.cell_mm / 2
        reaches += [*(at - low), *(high - at)]
        # Corners of voxels; that a voxel turned is longer is left to the margin.
        assert max(reaches) < half + 1.5 * session.poses[1].scale
        turn = rotation_about(rng.normal(size=3), rng.uniform(0.3, 3.0))
        session.turn(1, turn @ session.poses[1].rotation)
    assert max(reaches) > 0.9 * half


def test_the_next_to_leave_keeps_clear_of_what_was_moved_to_an_empty_slot() -> None:
    session = session_of(rods())
    session.canvas_size = SHAPES[0]
    session.unpack(4)
    moved, *_, latest = session.state.placements
    emptied = session.slots.centers[session.state.placements[latest].slot]
    session.restore(1)
    landed(session)
    session.place(moved, replace(session.poses[moved], center=emptied + session.slots.cell_mm / 4))
    session.unpack(1)
    landed(session)
    low, high = rectangle(session, latest)
    moved_low, moved_high = rectangle(session, moved)
    assert ((high <= moved_low) | (moved_high <= low)).any()
    # Where no other is left, the slot beneath it is taken.
    session.unpack(1)
    assert {placement.slot for placement in session.state.placements.values()} == set(range(5))


def test_those_for_whom_new_slots_are_planned_keep_clear_of_what_was_moved_there() -> None:
    session, after = session_of(rods(24)), session_of(rods(24))
    session.canvas_size = after.canvas_size = SHAPES[0]
    session.unpack(4)
    moved = next(iter(session.state.placements))
    after.unpack(5)
    assert len(session.slots.centers) == 4
    assert len(after.slots.centers) == 8
    session.place(moved, replace(session.poses[moved], center=after.slots.centers[4]))
    session.unpack(1)
    landed(session)
    moved_low, moved_high = rectangle(session, moved)
    for low, high in (rectangle(session, i) for i in session.poses if i != moved):
        assert ((high <= moved_low) | (moved_high <= low)).any()


def covered(session: Session) -> list[tuple[int, int]]:
    """Return the pairs of sprites of which one lies over the other."""
    found = {i: rectangle(session, i) for i in session.poses}
    pairs = combinations(found, 2)
    return [
        (a, b)
        for a, b in pairs
        if (found[a][1] > found[b][0]).all() and (found[b][1] > found[a][0]).all()
    ]


def test_those_that_are_out_already_keep_clear_of_what_was_moved_when_places_are_planned_anew() -> (
    None
):
    session, after = session_of(rods(24)), session_of(rods(24))
    session.canvas_size = after.canvas_size = SHAPES[0]
    session.unpack(4)
    landed(session)
    after.unpack(5)
    moved, other = list(session.state.placements)[:2]
    slot = session.state.placements[other].slot
    # There the second of them will wait once eight places are planned.
    share = np.array(session.slots.window_mm) / after.slots.window_mm
    to = after.slots.centers[slot] * np.array([1.0, *share])
    session.place(moved, replace(session.poses[moved], center=to))
    at = session.poses[moved].center / np.array([1.0, *session.slots.window_mm])
    before = session.state
    session.unpack(1)
    landed(session)
    assert covered(session) == []
    # It is where a person put it.
    now = session.poses[moved].center / np.array([1.0, *session.slots.window_mm])
    np.testing.assert_allclose(now, at)
    then = {i: pose.center for i, pose in session.poses.items()}
    session.undo()
    assert session.state.placements == before.placements
    session.redo()
    landed(session)
    # Undone and redone, or run to and fro, everything is where it was.
    for step in (3, 0, 5):
        session.go_to(step)
        landed(session)
    assert {i: tuple(pose.center) for i, pose in session.poses.items()} == {
        i: tuple(center) for i, center in then.items()
    }
    # Places that nobody plans anew keep who has them, also where one is put upon another.
    session.place(moved, replace(session.poses[moved], center=session.poses[other].center))
    there = session.poses[other].center
    session.unpack(1)
    landed(session)
    np.testing.assert_array_equal(session.poses[other].center, there)


@pytest.mark.parametrize("seed", [6, 12])
def test_nobody_is_covered_by_what_was_moved_however_many_come_and_go(seed: int) -> None:
    session, rng = session_of(rods(24)), np.random.default_rng(seed)
    session.canvas_size = SHAPES[seed % 2]
    for count in (4, 1, 1, -2, 3, 2, -5, -2, 4, 3, -6):
        # The slider takes the same way with what it has taken back still known.
        if seed == 12:
            session.go_to(session.step + count)
        else:
            (session.unpack if count > 0 else session.restore)(abs(count))
        landed(session)
        assert covered(session) == []
        slots = [placement.slot for placement in session.state.placements.values()]
        assert len(set(slots)) == len(slots)
        put_aside(session, int(rng.choice(list(session.poses))), rng)


def put_aside(session: Session, object_id: int, rng: np.random.Generator) -> None:
    """Move a sprite a little, to where it covers nobody."""
    pose, cell = session.poses[object_id], session.slots.cell_mm
    edge = (np.array(session.slots.window_mm) - cell) / 2
    for _ in range(40):
        at = pose.center[1:] + rng.normal(scale=cell, size=2)
        session.place(object_id, replace(pose, center=np.array([0.0, *np.clip(at, -edge, edge)])))
        if not covered(session):
            return
    session.place(object_id, pose)


def test_a_turn_keeps_the_size_where_there_is_room_and_is_given_back(unpacked: Session) -> None:
    before = unpacked.poses[5]
    end_on = rotation_about((0.0, 1.0, 0.0), np.pi / 2)
    unpacked.turn(5, end_on)
    # Seen from its end it is a small square, and no larger than it was.
    assert unpacked.poses[5].scale == pytest.approx(before.scale)
    assert unpacked.pose_turned(5, before.rotation).scale == pytest.approx(before.scale)
    # From corner to corner the longest rod is longer than its place.
    held = unpacked.poses[1]
    askew = rotation_about((1.0, 0.0, 0.0), np.pi / 4)
    assert unpacked.pose_turned(1, askew).scale <= held.scale
    unpacked.undo()
    assert np.array_equal(unpacked.poses[5].rotation, before.rotation)
    unpacked.restore([1])
    with pytest.raises(ValueError, match="Object 1 is not unpacked"):
        unpacked.turn(1, askew)


def test_a_moved_sprite_keeps_its_share_of_the_way_to_the_edge(unpacked: Session) -> None:
    height, width = unpacked.slots.window_mm
    center = np.array([0.0, -0.4 * height, 0.45 * width])
    put = replace(unpacked.poses[2], center=center)
    unpacked.place(2, put)
    assert unpacked.poses[2].center == pytest.approx(center)
    assert unpacked.poses[2].scale == put.scale
    for shape in SHAPES:
        unpacked.canvas_size = shape
        height, width = unpacked.slots.window_mm
        assert unpacked.poses[2].center == pytest.approx([0.0, -0.4 * height, 0.45 * width])
        assert unpacked.poses[2].scale == pytest.approx(
            unpacked.slots.scale(*unpacked.state.placements[2].image_mm)
        )
    unpacked.canvas_size = SHAPES[0]
    assert unpacked.poses[2].center == pytest.approx(center)
