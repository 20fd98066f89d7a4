"""The pictures of a session: patches of objects at poses, sprites, scenes."""

from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from napari_unpack.appearance import Surroundings
from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.geometry.grow_labels import grow_labels
from napari_unpack.geometry.transforms import Pose, packed_pose, rotation_about
from napari_unpack.geometry.view import Camera, View
from napari_unpack.rendering import compose
from napari_unpack.rendering.object_style import ObjectStyle

object_patch = partial(compose.object_patch, backend="cpu")
packed_patch = partial(compose.packed_patch, backend="cpu")
sprite_patch = partial(compose.sprite_patch, backend="cpu")
scene = partial(compose.scene, backend="cpu")
SIZE = (120, 160)


class FakeSession(SimpleNamespace):
    """What pictures ask of a session, and nothing more."""

    __hash__ = object.__hash__
    clipping = np.zeros((0, 2, 3))

    def packed_tints(self) -> np.ndarray:
        tints = np.zeros((4, 4), np.float32)
        for i in (1, 2, 3):
            if i not in self.poses and i not in self.flights:
                tints[i] = COLORS[i]
        return tints

    def solo_tints(self, object_id: int) -> np.ndarray:
        tints = np.zeros((4, 4), np.float32)
        tints[object_id] = COLORS[object_id]
        return tints

    def study(self, object_id: int) -> ObjectStyle:
        return ObjectStyle()

    def transfer_function_of(self, object_id: int) -> Any:
        return self.transfer_function


COLORS = {1: (1, 0.2, 0.2, 1), 2: (0.2, 1, 0.2, 1), 3: (0.2, 0.2, 1, 1)}


def make_session(spacing: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Any:
    """A box, a ball and a rod, apart from each other, in noise-free air."""
    shape = (40, 48, 56)
    z, y, x = np.indices(shape)
    labels = np.zeros(shape, np.uint16)
    labels[4:16, 5:20, 6:14] = 1
    labels[(z - 26) ** 2 + (y - 30) ** 2 + (x - 40) ** 2 <= 81] = 2
    labels[30:34, 4:12, 4:50] = 3
    volume = np.where(labels > 0, 1000, 0).astype(np.uint16)
    ramp = np.array([[1, 1, 1, 0], [1, 1, 1, 0.5], [1, 1, 1, 0.5]], np.float32)
    return FakeSession(
        volume=volume,
        display_labels=grow_labels(labels),
        boxes=label_boxes(labels),
        spacing=np.asarray(spacing, float),
        transfer_function=SimpleNamespace(table=lambda n=3: ramp, domain=(0.0, 1000.0)),
        poses={},
        flights={},
        states={},
        surroundings=Surroundings.of("black"),
    )


@pytest.mark.parametrize("fov", [0.0, 40.0])
@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (2.0, 1.0, 0.8)])
def test_an_object_at_its_packed_pose_looks_as_it_does_alone_in_the_bag(
    fov: float, spacing: tuple[float, float, float]
) -> None:
    session = make_session(spacing)
    camera = View((0.3, 0.5, 1.0), fov=fov).camera(session.volume.shape, spacing)
    pose = packed_pose(session.boxes.center(2, session.spacing), camera)
    flying = object_patch(session, 2, pose, camera, SIZE)
    session.packed_tints = lambda: session.solo_tints(2)
    packed = packed_patch(session, camera, SIZE)

    whole = np.zeros((*SIZE, 4), np.float32)
    r, c = packed.row, packed.col
    whole[r : r + packed.size[0], c : c + packed.size[1]] = packed.rgba
    alone = np.zeros_like(whole)
    depth = np.full(SIZE, np.inf, np.float32)
    r, c = flying.row, flying.col
    alone[r : r + flying.size[0], c : c + flying.size[1]] = flying.rgba
    depth[r : r + flying.size[0], c : c + flying.size[1]] = flying.depth
    assert whole[..., 3].max() > 0.9
    assert flying.rgba.size < 0.25 * whole.size
    differs = np.abs(whole - alone).max(-1) > 2 / 255
    assert differs.sum() <= 3
    solid = np.isfinite(flying.depth)
    there = packed.depth[r - packed.row :, c - packed.col :][: flying.size[0], : flying.size[1]]
    # Rounding may carry alpha over 0.5 one sample later.
    assert (np.abs(flying.depth[solid] - there[solid]) > 1e-3).sum() <= 3


@pytest.mark.parametrize("fov", [0.0, 30.0])
def test_an_object_appears_where_its_pose_says(fov: float) -> None:
    session = make_session()
    camera = View((0.0, 0.0, 1.0), fov=fov, height=100.0).camera((40, 48, 56), (1, 1, 1))
    # The ball, radius 9, in the pivot plane: 20 mm down, 30 mm left; 1.2 pixels a mm.
    pose = Pose(np.array([0.0, 20.0, -30.0]), rotation_about((1, 1, 0), 0.7))
    patch = object_patch(session, 2, pose, camera, SIZE)
    rows, cols = np.nonzero(patch.rgba[..., 3] > 0.5)
    assert rows.mean() + patch.row == pytest.approx(59.5 + 20 * 1.2, abs=0.7)
    assert cols.mean() + patch.col == pytest.approx(79.5 - 30 * 1.2, abs=0.7)
    assert patch.plane == pytest.approx(0.0)
    assert patch.depth.min() == pytest.approx(-9.0, abs=1.0)


def test_a_scaled_object_is_larger_and_just_as_opaque() -> None:
    session = make_session()
    camera = View((0.0, 0.0, 1.0), height=200.0).camera((40, 48, 56), (1, 1, 1))
    small = object_patch(session, 2, Pose(np.zeros(3), np.eye(3), 1.0), camera, (200, 200))
    large = object_patch(session, 2, Pose(np.zeros(3), np.eye(3), 3.0), camera, (200, 200))
    area_small = (small.rgba[..., 3] > 0.5).sum()
    area_large = (large.rgba[..., 3] > 0.5).sum()
    assert area_large / area_small == pytest.approx(9.0, rel=0.08)
    assert large.rgba[..., 3].max() == pytest.approx(small.rgba[..., 3].max(), abs=0.01)


def test_an_object_out_of_the_picture_or_behind_the_eye_has_no_pixels() -> None:
    session = make_session()
    camera = View((0.0, 0.0, 1.0), fov=30, height=100.0).camera((40, 48, 56), (1, 1, 1))
    aside = Pose(np.array([0.0, 500.0, 0.0]), np.eye(3))
    behind = Pose(np.array([camera.distance + 50.0, 0.0, 0.0]), np.eye(3))
    assert object_patch(session, 2, aside, camera, SIZE).is_empty
    assert object_patch(session, 2, behind, camera, SIZE).is_empty


def test_an_object_at_the_eye_does_not_break_the_picture() -> None:
    session = make_session()
    camera = View((0.0, 0.0, 1.0), fov=30, height=100.0).camera((40, 48, 56), (1, 1, 1))
    patch = object_patch(
        session, 2, Pose(np.array([camera.distance, 0, 0]), np.eye(3)), camera, SIZE
    )
    assert np.isfinite(patch.rgba).all()


def test_an_unknown_object_is_named() -> None:
    session = make_session()
    with pytest.raises(KeyError, match="no object 7"):
        sprite_patch(session, 7, Pose(np.zeros(3), np.eye(3)), 1.0)


def test_a_sprite_is_tight_and_centred() -> None:
    session = make_session()
    # The rod, 4 x 8 x 46 voxels, seen along z: 8 down, 46 right; twice as many pixels.
    patch = sprite_patch(session, 3, Pose(np.array([5.0, 6.0, 7.0]), np.eye(3)), 2.0)
    height, width = patch.size
    assert 16 <= height <= 20
    assert 92 <= width <= 96
    alpha = patch.rgba[..., 3]
    for edge in (alpha[0], alpha[-1], alpha[:, 0], alpha[:, -1]):
        assert edge.max() > 0
    assert patch.row == -(height - 1) / 2
    assert patch.col == -(width - 1) / 2
    solid = patch.depth[np.isfinite(patch.depth)]
    assert patch.plane == 0.0
    assert np.median(solid) == pytest.approx(-2.0, abs=1.5)


def test_a_sprite_needs_a_resolution() -> None:
    with pytest.raises(ValueError, match="pixels_per_mm must be a positive number"):
        sprite_patch(make_session(), 3, Pose(np.zeros(3), np.eye(3)), 0.0)


def test_a_scene_shows_the_bag_what_flies_and_the_sprites() -> None:
    session = make_session()
    camera = Camera(np.eye(3), np.array([19.5, 23.5, 27.5]), 150.0)
    full = scene(session, camera, SIZE)
    pose = Pose(np.array([0.0, 0.0, 60.0]), np.eye(3))
    session.poses = {1: pose}
    session.flights = {
        2: SimpleNamespace(pose=lambda time, camera: Pose(np.array([50.0, -time, -60]), np.eye(3)))
    }
    later = scene(session, camera, SIZE, time=40.0)

    def seen(image: np.ndarray, channel: int) -> tuple[float, float]:
        others = [c for c in range(3) if c != channel]
        rows, cols = np.nonzero(image[..., channel] > 2 * image[..., others].max(-1) + 0.05)
        return rows.mean(), cols.mean()

    # 0.8 pixels a mm; the box's packed centre is (9.5, 12, 9.5), its upper half behind the rod.
    assert seen(full, 0)[1] == pytest.approx(79.5 + (9.5 - 27.5) * 0.8, abs=1)
    assert seen(later, 0) == pytest.approx((59.5, 79.5 + 48), abs=1)
    assert seen(later, 1) == pytest.approx((59.5 - 32, 79.5 - 48), abs=1)
    assert seen(later, 2) == pytest.approx(seen(full, 2), abs=0.5)
    assert full.shape == (*SIZE, 4)
    assert later[..., 3].min() == pytest.approx(1.0)


def test_a_frame_casts_neither_the_bag_nor_the_sprites_again(monkeypatch: Any) -> None:
    session = make_session()
    camera = Camera(np.eye(3), np.array([19.5, 23.5, 27.5]), 150.0)
    session.poses = {1: Pose(np.array([0.0, 0.0, 60.0]), np.eye(3))}
    casts: list[int] = []
    real = compose.cast_crop
    monkeypatch.setattr(compose, "cast_crop", lambda *a: (casts.append(1), real(*a))[1])
    first = scene(session, camera, SIZE)
    assert len(casts) == 2
    np.testing.assert_array_equal(scene(session, camera, SIZE), first)
    assert len(casts) == 2
    scene(session, Camera(np.eye(3), np.array([19.5, 20.0, 27.5]), 150.0), SIZE)
    assert len(casts) == 3, "the bag has moved in the picture, the sprite has not"
    session.volume = session.volume.copy()
    scene(session, camera, SIZE)
    assert len(casts) == 5, "another volume looks another way"


def test_an_inspected_object_stands_large_before_the_dimmed_rest() -> None:
    session = make_session()
    camera = Camera(np.eye(3), np.array([19.5, 60.0, 27.5]), 150.0)
    plain = scene(session, camera, SIZE)
    session.states = {2: SimpleNamespace(value="inspected")}
    session.poses = {2: Pose(np.array([0.0, 0.0, 60.0]), np.eye(3))}
    image = scene(session, camera, SIZE)
    green = image[..., 1] > 2 * image[..., (0, 2)].max(-1) + 0.05
    rows, cols = np.nonzero(green)
    # The ball's box of 19 mm has a diagonal of 32.9 mm that fills 0.72 of 120 pixels.
    assert rows.mean() == pytest.approx(59.5, abs=0.5)
    assert cols.mean() == pytest.approx(79.5, abs=0.5)
    assert np.ptp(rows) + 1 == pytest.approx(0.72 * 120 * 19 / 32.9, abs=3)
    # The rod, at y = 4 to 12, is far above the ball.
    rod = plain[..., 2] > 0.5
    assert rod.sum() > 30
    assert image[rod][:, 2].mean() == pytest.approx(0.16 * plain[rod][:, 2].mean(), rel=0.05)


def test_a_scene_has_the_surroundings_asked_for_sprites_before_the_box() -> None:
    session = make_session()
    camera = Camera(np.eye(3), np.array([19.5, 23.5, 27.5]), 150.0)
    light = scene(session, camera, SIZE, surroundings=Surroundings.of("white", ["box", "scale"]))
    assert light[..., 3].min() == 1.0
    np.testing.assert_allclose(light[0, 0], 1.0)
    # The front face of the box around voxels 4 to 34: its edges are dark on white.
    corner = camera.project([[3.5, 3.5, 3.5]], SIZE)[0]
    row, col = np.rint(corner).astype(int)
    assert light[row, col : col + 8, :3].mean() < 0.9
    assert (light[-24:, -60:, :3].min(axis=2) < 0.5).any(), "the scale bar"
    # A sprite towards the viewer covers the box's edge.
    towards = camera.rotation[0] @ (np.array([3.5, 3.5, 20.0]) - camera.center) + 40
    down, right = camera.rotation[1:] @ (np.array([3.5, 3.5, 20.0]) - camera.center)
    session.poses = {2: Pose(np.array([towards, down, right]), np.eye(3))}
    covered = scene(session, camera, SIZE, surroundings=Surroundings.of("black", ["box"]))
    row, col = np.rint(camera.project([[3.5, 3.5, 20.0]], SIZE)[0]).astype(int)
    hidden = scene(session, camera, SIZE)
    # The edge shines through what the object itself lets through, no more.
    np.testing.assert_allclose(covered[row, col], hidden[row, col], atol=0.01)
