"""Bags that napari mirrors, stretches or shears: the same images as of the bag made so."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unpack.geometry.transforms import Pose
from napari_unpack.geometry.view import Camera
from napari_unpack.io.session_json import record_of, session_from
from napari_unpack.layers.view_camera import camera_in_session, parts_of
from napari_unpack.rendering.compose import object_image, packed_image, scene_image, sprite_image
from napari_unpack.rendering.image_patch import compose
from napari_unpack.session import Session
from napari_unpack.unpacking import Ball, Flight

SIZE = (90, 120)
SPACING = np.array([1.0, 0.8, 1.3])


def bag() -> tuple[np.ndarray, np.ndarray]:
    """A wedge, a ball and a bent rod: none is its own mirror image."""
    z, y, x = np.indices((26, 30, 34))
    labels = np.zeros(z.shape, np.uint16)
    labels[(z > 3) & (y > 4) & (x > 3) & (2 * z + y + 3 * x < 60)] = 1
    labels[(z - 17) ** 2 + (y - 20) ** 2 + (x - 24) ** 2 <= 49] = 2
    labels[21:24, 3:7, 3:30] = 3
    labels[8:24, 3:7, 26:30] = 3
    volume = np.where(labels > 0, 700 + 200 * labels, 0).astype(np.uint16)
    return volume, labels


def session_of(volume: np.ndarray, labels: np.ndarray, spacing=SPACING) -> Session:
    session = Session(volume, labels, spacing)
    session.backend = "cpu"
    return session


def napari_from_voxel(seed: int, kind: str) -> np.ndarray:
    """A turned layer, mirrored, stretched or sheared besides."""
    rng = np.random.default_rng(seed)
    turn = Camera.looking(rng.normal(size=3), rng.normal(size=3), (0, 0, 0), 1.0).rotation
    shape = np.eye(3)
    if kind == "mirrored":
        shape[1, 1] = -1
    elif kind == "stretched":
        shape = np.diag([1.9, 1.0, 0.6])
    elif kind == "sheared":
        shape[1, 0], shape[2, 1] = np.tan(np.radians(15)), -0.3
    matrix = np.eye(4)
    matrix[:3, :3] = 2.5 * turn @ shape @ np.diag(SPACING)
    matrix[:3, 3] = rng.normal(0, 30, 3)
    return matrix


def seen_by_napari(matrix: np.ndarray, fov: float) -> Camera:
    """A camera of napari's world that looks at the middle of the bag."""
    middle = matrix[:3, :3] @ [12.5, 14.5, 16.5] + matrix[:3, 3]
    return Camera.looking((0.7, 0.5, 0.4), (0.1, -1.0, 0.2), middle, 150.0, fov)


def camera_for(matrix: np.ndarray, fov: float, spacing=SPACING) -> Camera:
    return camera_in_session(seen_by_napari(matrix, fov), matrix @ np.diag([*1 / spacing, 1]))


def flipped(matrix: np.ndarray, axis: int, count: int) -> np.ndarray:
    """The map of voxels numbered from the other end of an axis."""
    swap = np.eye(4)
    swap[axis, axis], swap[axis, 3] = -1, count - 1
    return matrix @ swap


def differing(a: np.ndarray, b: np.ndarray) -> float:
    """Share of pixels that differ by more than two of 255 parts."""
    assert a[..., 3].max() > 0.5
    return float((np.abs(a - b).max(axis=-1) > 2 / 255).mean())


@pytest.mark.parametrize("kind", ["as it is", "stretched", "sheared"])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_volume_numbered_from_the_other_end_looks_the_same_where_it_stands_the_same(
    kind: str, axis: int
) -> None:
    matrix, fov = napari_from_voxel(axis, kind), 0.0 if axis == 1 else 30.0
    volume, labels = bag()
    one = session_of(volume, labels)
    other = session_of(np.flip(volume, axis).copy(), np.flip(labels, axis).copy())
    cameras = [
        camera_for(matrix, fov),
        camera_for(flipped(matrix, axis, volume.shape[axis]), fov),
    ]
    assert np.linalg.det(cameras[0].stretch) * np.linalg.det(cameras[1].stretch) < 0
    pictures = [
        scene_image(session.scene(), camera, SIZE, backend="cpu")
        for session, camera in zip((one, other), cameras, strict=True)
    ]
    assert differing(*pictures) < 0.001
    # Also in the air, and as sprites: no object is turned inside out.
    mirror = np.eye(3)
    mirror[axis, axis] = -1
    held = Camera.looking((1, 2, 3), None, (0, 0, 0), 1.0).rotation
    turns = [held, parts_of(held @ cameras[0].stretch @ mirror)[1]]
    ways = [np.array([0.6, -0.64, 0.48]), mirror @ [0.6, -0.64, 0.48]]
    flights = []
    for session, camera, turn, way in zip((one, other), cameras, turns, ways, strict=True):
        target = Pose(np.array([0.0, 30.0, -40.0]), turn, 1.2, camera.stretch)
        center = session.boxes.center(3, session.spacing)
        around = Ball(session.bag.center, 40.0)
        flights.append(Flight(3, center, way, 20.0, target, around))
    for gone in (0.0, 0.25, 0.75, 1.0):
        patches = [
            object_image(
                session.scene(), 3, flight.pose_at(gone, camera), camera, SIZE, backend="cpu"
            )
            for session, flight, camera in zip((one, other), flights, cameras, strict=True)
        ]
        assert patches[0].size == patches[1].size
        assert differing(patches[0].rgba, patches[1].rgba) < 0.004
        same = np.isclose(patches[0].depth, patches[1].depth, atol=0.05)
        assert same.mean() > 0.98
    sprites = [
        sprite_image(session.scene(), 3, flight.target, 2.0, backend="cpu").rgba
        for session, flight in zip((one, other), flights, strict=True)
    ]
    assert sprites[0].shape == sprites[1].shape
    assert differing(*sprites) < 0.01


@pytest.mark.parametrize("fov", [0.0, 30.0])
@pytest.mark.parametrize("kind", ["as it is", "mirrored", "stretched", "sheared"])
def test_the_first_object_of_every_ray_is_that_of_the_ray_in_naparis_world(
    kind: str, fov: float
) -> None:
    matrix = napari_from_voxel(5, kind)
    volume, labels = bag()
    session = session_of(volume, labels)
    found = session.ray_queries.object_ids(
        camera_for(matrix, fov), np.arange(4) > 0, SIZE, 1, session.clipping, "auto"
    )[0]
    seen = seen_by_napari(matrix, fov)
    # Towards the viewer x down is right, as CONVENTIONS.md has it.
    right = np.cross(-seen.direction, -seen.up)
    rows, cols = np.indices(SIZE)
    pixel = seen.height / SIZE[0]
    plane = (
        seen.center
        - ((rows - (SIZE[0] - 1) / 2) * pixel)[..., None] * seen.up
        + ((cols - (SIZE[1] - 1) / 2) * pixel)[..., None] * right
    )
    eye = None if not fov else seen.center - seen.direction * 75.0 / np.tan(np.radians(fov / 2))
    first = np.zeros(SIZE, np.int64)
    back = np.linalg.inv(matrix)
    for t in np.arange(-160.0, 160.0, 0.4):
        point = plane + t * seen.direction
        if eye is not None:
            reach = np.linalg.norm(seen.center - eye)
            point = eye + (plane - eye) * (reach + t) / reach
        spot = np.rint(point @ back[:3, :3].T + back[:3, 3]).astype(int)
        inside = ((spot >= 0) & (spot < labels.shape)).all(axis=-1)
        met = np.where(inside, labels[tuple(np.where(inside[..., None], spot, 0).T)].T, 0)
        first = np.where(first == 0, met, first)
    assert len(np.unique(first)) == 4
    assert (first != found).mean() < 0.01


def test_voxels_stretched_by_the_layer_are_as_voxels_of_that_size() -> None:
    volume, labels = bag()
    matrix = np.diag([2.0, 1.0, 1.0, 1.0])
    long, cubes = session_of(volume, labels, (2, 1, 1)), session_of(volume, labels, (1, 1, 1))
    seen = seen_by_napari(matrix, 20.0)
    ids = [
        session.ray_queries.object_ids(
            camera_in_session(seen, matrix @ np.diag([*1 / session.spacing, 1])),
            np.arange(4) > 0, SIZE, 2, session.clipping, "auto",
        )
        for session in (long, cubes)
    ]  # fmt: skip
    assert (ids[0] != ids[1]).mean() < 0.003


@pytest.mark.parametrize("kind", ["mirrored", "stretched", "sheared"])
def test_a_flight_begins_as_the_packed_picture_shows_the_object(kind: str) -> None:
    session = session_of(*bag())
    camera = camera_for(napari_from_voxel(7, kind), 25.0)
    session.look(camera)
    session.isolate(3)
    packed = packed_image(session.scene(), camera, SIZE, backend="cpu")
    session.show()
    session.animated = True
    session.unpack(3)
    flight = session.flights[3]
    np.testing.assert_array_equal(flight.target.stretch, camera.stretch)
    alone = object_image(
        session.scene(), 3, flight.pose_at(0.0, camera), camera, SIZE, backend="cpu"
    )
    assert differing(compose(SIZE, [packed]), compose(SIZE, [alone])) < 0.002


@pytest.mark.parametrize("kind", ["mirrored", "stretched", "sheared"])
def test_sprites_stand_clear_of_the_bag_and_of_each_other(kind: str) -> None:
    session = session_of(*bag())
    session.canvas_size = (600, 800)
    session.look(camera_for(napari_from_voxel(9, kind), 0.0))
    camera = session.overview()
    session.look(camera)
    session.unpack(2)
    poses = session.poses
    assert len(poses) == 2
    corners = session.boxes.corners(next(iter(set(session.ids) - set(poses))), session.spacing)
    bag_points = camera.project(np.concatenate([corners]), session.canvas_size)
    middle = (np.array(session.canvas_size) - 1) / 2
    assert np.linalg.norm(bag_points - middle, axis=1).max() <= session.slots.bag_radius_px + 1
    for object_id, pose in poses.items():
        np.testing.assert_array_equal(pose.stretch, camera.stretch)
        patch = sprite_image(session.scene(), object_id, pose, 4.0, backend="cpu")
        # A pixel and the fringe more than the cell.
        assert max(patch.size) / 4.0 <= session.slots.cell_mm + 4 * session.spacing.max()


def test_the_stretch_is_saved_with_the_session_and_what_is_none_is_refused() -> None:
    session = session_of(*bag())
    session.look(camera_for(napari_from_voxel(3, "sheared"), 0.0))
    record = record_of(session)
    again = session_from(record, session.volume, session.labels)
    np.testing.assert_allclose(again.camera.stretch, session.camera.stretch)
    record["camera"]["stretch"] = [[1, 0, 0], [0, 1, 0.5], [0, 0, 1]]
    with pytest.raises(ValueError, match="stretch must be symmetric"):
        session_from(record, session.volume, session.labels)
    del record["camera"]["stretch"]
    old = session_from(record, session.volume, session.labels)
    np.testing.assert_array_equal(old.camera.stretch, np.eye(3))


def test_sprites_are_mirrored_when_the_bag_is() -> None:
    session = session_of(*bag())
    plain = Camera.looking((0.7, 0.5, 0.4), (0.1, -1.0, 0.2), session.bag.center, 60.0)
    session.look(plain)
    session.unpack(3)
    before = sprite_image(session.scene(), 3, session.poses[3], 3.0, backend="cpu").rgba
    session.look(Camera.looking(plain.direction, plain.up, plain.center, 60.0, stretch=-np.eye(3)))
    after = sprite_image(session.scene(), 3, session.poses[3], 3.0, backend="cpu").rgba
    assert before.shape == after.shape
    assert differing(before[:, ::-1], after) < 0.01
