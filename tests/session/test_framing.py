"""Room for sprites grows in steps, in windows of any shape, and what is drawn fits into them."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from napari_unpack import Session, io
from napari_unpack.appearance import Decorations
from napari_unpack.geometry.axes import transform_points
from napari_unpack.geometry.boxes import box_corners
from napari_unpack.geometry.view import View
from napari_unpack.io import movies
from napari_unpack.session.framing import drawn_back, fitted
from napari_unpack.unpacking import room_for


def cubes(across: int) -> Session:
    """Make a block of cubes that leave one by one, two deep."""
    labels = np.zeros((12, 6 * across, 24), np.uint16)
    places = [(z, y, x) for z in (0, 6) for y in range(across) for x in range(4)]
    for object_id, (z, y, x) in enumerate(places, start=1):
        labels[z : z + 5, 6 * y : 6 * y + 5, 6 * x : 6 * x + 5] = object_id
    session = Session(np.where(labels > 0, 1200, 0).astype(np.uint16), labels)
    session.backend = "cpu"
    session.view = View((1.0, 0.2, 0.1), fov=20.0)
    return session


def share(session: Session) -> float:
    """Return the bag's picture, of the window's shorter side; all sprites are in the window."""
    rows, cols = session.canvas_size
    camera = fitted(session)
    # With a margin at the edge.
    half = np.array([1.0, cols / rows]) / 2 - 0.02 * min(1.0, cols / rows)
    half *= camera.height
    for pose in session.poses.values():
        side = session.slots.cell_mm / 2
        assert (np.abs(pose.center[1:]) + side <= half + 1e-6).all()
    flat = (session.bag.silhouette - session.bag.center) @ camera.linear.T
    longer = float(np.ptp(flat[:, 1:], axis=0).max())
    return longer / camera.height * rows / min(rows, cols)


@pytest.mark.parametrize(
    "size", [(1200, 600), (1000, 700), (800, 800), (700, 1000), (600, 1200), (500, 530)]
)
def test_the_bag_stays_large_while_few_are_out_in_windows_of_any_shape(
    size: tuple[int, int],
) -> None:
    session = cubes(3)
    session.canvas_size = size
    shares, sides = [share(session)], [session.slots.cell_mm]
    assert shares[0] > 0.7
    for _ in session.ids[:-1]:
        session.unpack(1)
        shares.append(share(session))
        sides.append(session.slots.cell_mm / fitted(session).height)
    # The first four leave it nearly as it was; then it makes room, and never comes nearer.
    assert shares[4] > 0.62
    assert all(later <= before + 1e-9 for before, later in pairwise(shares))
    assert len(set(np.round(sides[1:], 6))) <= 6
    # Back again all is as it was.
    session.restore(99)
    assert share(session) == pytest.approx(shares[0])


@pytest.mark.parametrize("aside", [(0.0, 0.0, 0.0), (1.0, 5.0, -30.0)])
def test_a_camera_draws_back_for_what_has_come_out_wherever_it_looks(
    aside: tuple[float, float, float],
) -> None:
    session = cubes(2)
    session.canvas_size = (300, 400)
    session.unpack(3)
    near = replace(session.camera, center=session.bag.center + aside, height=5.0)
    seen = drawn_back(session, near, session.poses)
    rows, cols = session.canvas_size
    moved = seen.linear @ (seen.center - session.bag.center)
    half, side = seen.height / 2 * np.array([1.0, cols / rows]), session.slots.cell_mm / 2
    for pose in session.poses.values():
        assert (np.abs(pose.center[1:] - moved[1:]) + side <= half).all()
    assert drawn_back(session, near, ()).height == 5.0
    far = replace(near, height=10 * seen.height)
    assert drawn_back(session, far, session.poses).height == far.height


def test_room_is_planned_for_4_8_16_and_in_the_end_for_all() -> None:
    assert [room_for(n, 40) for n in (0, 4, 5, 8, 9, 16, 17, 40)] == [4, 4, 8, 8, 16, 16, 40, 40]
    assert [room_for(n, 5) for n in (0, 5)] == [5, 5]


def test_what_is_in_the_air_turns_to_its_new_slot_and_what_goes_back_leaves_its_old_one() -> None:
    session = cubes(2)
    session.animated, session.seconds = True, 1.0
    now = [0.0]
    session.clock = lambda: now[0]
    camera = session.camera
    four = session.unpack(4)
    now[0] = 0.9
    before = {i: session.flights[i].pose(now[0], camera) for i in session.flights}
    slots = session.slots
    session.unpack(1)
    assert session.slots is not slots
    for object_id, pose in before.items():
        flight = session.flights[object_id]
        np.testing.assert_allclose(flight.pose(now[0], camera).center, pose.center)
        end = flight.pose(flight.start + 1.0, camera)
        slot = session.state.placements[object_id].pose(session.slots, np.eye(3))
        np.testing.assert_allclose(end.center, slot.center, atol=1e-6)
        assert end.scale == pytest.approx(slot.scale)
    for object_id in list(session.flights):
        session.land(object_id)
    poses = session.poses
    (fifth,) = set(poses) - set(four)
    session.restore(1)
    # Its slot is in no plan any more.
    assert session.state.placements.keys() == set(four)
    flight = session.flights[fifth]
    np.testing.assert_allclose(flight.pose(flight.start, camera).center, poses[fifth].center)


def test_in_films_sprites_glide_to_slots_planned_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = cubes(1)
    frames: list[dict[int, Any]] = []

    def noted(scene: Any, _camera: Any, size: tuple[int, int], *_: Any) -> np.ndarray:
        frames.append({i: pose.center for i, pose in scene.poses.items()})
        return np.zeros((*size, 4), np.float32)

    monkeypatch.setattr(movies, "scene_image", noted)
    io.movie(session, tmp_path / "film", count=5, size=(48, 64), fps=30, seconds=0.5)
    steps: dict[int, list[float]] = {}
    for before, later in pairwise(frames):
        for i in before.keys() & later.keys():
            steps.setdefault(i, []).append(float(np.linalg.norm(later[i] - before[i])))
    # Who was out when the fifth came went its way in many frames, and none in one leap.
    gone = [each for each in steps.values() if sum(each) > 1.0]
    assert len(gone) >= 2
    assert all(max(each) < 0.5 * sum(each) for each in gone)


@pytest.mark.parametrize("size", [(900, 500), (600, 600), (500, 900)])
@pytest.mark.parametrize("fov", [0.0, 40.0])
def test_the_box_and_what_is_drawn_about_the_bag_are_in_view(
    size: tuple[int, int], fov: float
) -> None:
    session = cubes(3)
    session.canvas_size = size
    session.view = View((1.0, 0.8, 0.6), fov=fov)

    def outside(points: np.ndarray, camera: Any) -> int:
        pixels = camera.pixels(transform_points(camera.pivot_from_world(), points), size)
        return int(((pixels < -0.5) | (pixels > np.array(size) - 0.5)).any(axis=1).sum())

    corners = box_corners(session.bag.lower, session.bag.upper)
    far = session.bag.center + 1.5 * (corners - session.bag.center)
    assert outside(far, fitted(session)) > 0
    assert outside(far, fitted(session, None, far)) == 0
    assert fitted(session, None, far[:0]).height == fitted(session).height
    session.decorations = Decorations.of(decorations=["box"])
    assert outside(corners, fitted(session)) == 0


@pytest.mark.parametrize("fov", [0.0, 20.0, 45.0, 70.0])
@pytest.mark.parametrize("shape", [(8, 12, 60), (40, 40, 40), (60, 6, 30)])
def test_the_bag_itself_is_in_view_in_any_perspective(
    fov: float, shape: tuple[int, int, int]
) -> None:
    session = Session(np.full(shape, 1000.0) + np.arange(shape[2]), np.ones(shape, np.uint16))
    session.canvas_size = (400, 500)
    session.view = View((0.2, 0.1, 1.0), fov=fov)
    # The centres of its outermost voxels.
    corners = np.indices((2, 2, 2)).reshape(3, -1).T * (np.array(shape) - 1)
    pixels = fitted(session).project(corners, session.canvas_size)
    assert (pixels >= 0).all()
    assert (pixels <= np.array(session.canvas_size)).all()
    # And no smaller than it must be: it fills half of the window at least.
    assert np.ptp(pixels, axis=0).max() > 0.5 * min(session.canvas_size)
