"""The images of a scene: patches of objects at poses, sprites, scenes."""

import tracemalloc
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from napari_unpack.appearance import Decorations, TransferFunction
from napari_unpack.geometry.boxes import LabelBoxes, label_boxes
from napari_unpack.geometry.grow_labels import grow_labels
from napari_unpack.geometry.transforms import Pose, packed_pose, rotation_about
from napari_unpack.geometry.view import Camera, View
from napari_unpack.io.images import straight_bytes
from napari_unpack.memory import PICTURE_BYTES
from napari_unpack.rendering import compose, object_casting
from napari_unpack.rendering.image_patch import ImagePatch
from napari_unpack.rendering.rulers import Ruler, number_places, strokes_of
from napari_unpack.rendering.scene import Scene, SceneDifference
from napari_unpack.session import Session
from napari_unpack.simulation import simulate_bag
from napari_unpack.thread_count import SETTING
from napari_unpack.unpacking import Ball, Flight

object_image = partial(compose.object_image, backend="cpu")
packed_image = partial(compose.packed_image, backend="cpu")
sprite_image = partial(compose.sprite_image, backend="cpu")
scene_image = partial(compose.scene_image, backend="cpu")
SIZE = (120, 160)


@dataclass(frozen=True, eq=False)
class Objects:
    """Labels, grown as images show them, and their boxes."""

    labels: np.ndarray

    @cached_property
    def display(self) -> np.ndarray:
        return grow_labels(self.labels)

    @cached_property
    def boxes(self) -> LabelBoxes:
        return label_boxes(self.labels)


def make_scene(spacing: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Scene:
    """A red box, a green ball and a blue rod, apart from each other, in noise-free air."""
    shape = (40, 48, 56)
    z, y, x = np.indices(shape)
    labels = np.zeros(shape, np.uint16)
    labels[4:16, 5:20, 6:14] = 1
    labels[(z - 26) ** 2 + (y - 30) ** 2 + (x - 40) ** 2 <= 81] = 2
    labels[30:34, 4:12, 4:50] = 3
    white = [(0.0, (1, 1, 1)), (1.0, (1, 1, 1))]
    return Scene(
        volume=np.where(labels > 0, 1000, 0).astype(np.uint16),
        label_data=Objects(labels),
        spacing=np.asarray(spacing, float),
        transfer_function=TransferFunction([(0, 0), (500, 0.5), (1000, 0.5)], white),
        packed=frozenset({1, 2, 3}),
        hues={1: 0.0, 2: 1 / 3, 3: 2 / 3},
        tint_mode="hsv",
        mean_densities=dict.fromkeys((1, 2, 3), 1000.0),
        decorations=Decorations.of("black"),
    )


@pytest.mark.parametrize("fov", [0.0, 40.0])
@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (2.0, 1.0, 0.8)])
def test_an_object_at_its_packed_pose_looks_as_it_does_alone_in_the_bag(
    fov: float, spacing: tuple[float, float, float]
) -> None:
    scene = make_scene(spacing)
    camera = View((0.3, 0.5, 1.0), fov=fov).camera(scene.volume.shape, spacing)
    pose = packed_pose(scene.boxes.center(2, scene.spacing), camera)
    flying = object_image(scene, 2, pose, camera, SIZE)
    packed = packed_image(replace(scene, packed=frozenset({2})), camera, SIZE)

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
    scene = make_scene()
    camera = View((0.0, 0.0, 1.0), fov=fov, height=100.0).camera((40, 48, 56), (1, 1, 1))
    # The ball, radius 9, in the pivot plane: 20 mm down, 30 mm left; 1.2 pixels a mm.
    pose = Pose(np.array([0.0, 20.0, -30.0]), rotation_about((1, 1, 0), 0.7))
    patch = object_image(scene, 2, pose, camera, SIZE)
    rows, cols = np.nonzero(patch.rgba[..., 3] > 0.5)
    assert rows.mean() + patch.row == pytest.approx(59.5 + 20 * 1.2, abs=0.7)
    assert cols.mean() + patch.col == pytest.approx(79.5 - 30 * 1.2, abs=0.7)
    assert patch.plane == pytest.approx(0.0)
    assert patch.depth.min() == pytest.approx(-9.0, abs=1.0)


def test_a_scaled_object_is_larger_and_just_as_opaque() -> None:
    scene = make_scene()
    camera = View((0.0, 0.0, 1.0), height=200.0).camera((40, 48, 56), (1, 1, 1))
    small = object_image(scene, 2, Pose(np.zeros(3), np.eye(3), 1.0), camera, (200, 200))
    large = object_image(scene, 2, Pose(np.zeros(3), np.eye(3), 3.0), camera, (200, 200))
    area_small = (small.rgba[..., 3] > 0.5).sum()
    area_large = (large.rgba[..., 3] > 0.5).sum()
    assert area_large / area_small == pytest.approx(9.0, rel=0.08)
    assert large.rgba[..., 3].max() == pytest.approx(small.rgba[..., 3].max(), abs=0.01)


def test_an_object_out_of_the_picture_or_behind_the_eye_has_no_pixels() -> None:
    scene = make_scene()
    camera = View((0.0, 0.0, 1.0), fov=30, height=100.0).camera((40, 48, 56), (1, 1, 1))
    aside = Pose(np.array([0.0, 500.0, 0.0]), np.eye(3))
    behind = Pose(np.array([camera.distance + 50.0, 0.0, 0.0]), np.eye(3))
    assert object_image(scene, 2, aside, camera, SIZE).is_empty
    assert object_image(scene, 2, behind, camera, SIZE).is_empty


def test_an_object_at_the_eye_does_not_break_the_picture() -> None:
    scene = make_scene()
    camera = View((0.0, 0.0, 1.0), fov=30, height=100.0).camera((40, 48, 56), (1, 1, 1))
    patch = object_image(scene, 2, Pose(np.array([camera.distance, 0, 0]), np.eye(3)), camera, SIZE)
    assert np.isfinite(patch.rgba).all()


def test_an_unknown_object_is_named() -> None:
    scene = make_scene()
    with pytest.raises(KeyError, match="no object 7"):
        sprite_image(scene, 7, Pose(np.zeros(3), np.eye(3)), 1.0)


def test_a_sprite_is_tight_and_centred() -> None:
    scene = make_scene()
    # The rod, 4 x 8 x 46 voxels, seen along z: 8 down, 46 right; twice as many pixels.
    patch = sprite_image(scene, 3, Pose(np.array([5.0, 6.0, 7.0]), np.eye(3)), 2.0)
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


@pytest.mark.parametrize("center", [(0.0, 0.0, 0.0), (3.0, 9.0, 2.4), (0.0, 0.0, 300.0)])
def test_of_a_sprite_larger_than_the_image_only_what_is_in_it_is_cast(
    center: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = replace(make_scene(), packed=frozenset())
    camera = View((0.2, 0.1, 1.0), height=6.0).camera((40, 48, 56), (1, 1, 1))
    pose, pixels_per_mm = Pose(np.array(center), np.eye(3)), SIZE[0] / 6.0
    whole = sprite_image(scene, 2, pose, pixels_per_mm)
    row, col = (round(float(n)) for n in camera.pixels(pose.center, SIZE))
    patch = whole.at(whole.row + row, whole.col + col, whole.plane - center[0])
    wanted = compose.compose(SIZE, [patch], "black")
    casts: list[ImagePatch] = []
    cast = compose.cast_subvolume
    monkeypatch.setattr(
        compose, "cast_subvolume", lambda *given: casts.append(cast(*given)) or casts[-1]
    )
    seen = scene_image(replace(scene, poses={2: pose}), camera, SIZE)
    np.testing.assert_allclose(seen, wanted, atol=1e-6)
    assert whole.size > (300, 300)
    assert max(made.size for made in casts) <= SIZE


def test_an_image_takes_the_memory_that_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    # Each thread has a few megabytes of its own: sixteen of them need more than this small image.
    monkeypatch.setenv(SETTING, "2")
    scene = make_scene()
    camera, size = View((0.2, 0.1, 1.0)).camera((40, 48, 56), (1, 1, 1)), (600, 800)
    scene_image(scene, camera, (6, 8))
    tracemalloc.start()
    straight_bytes(scene_image(scene, camera, size))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert 0.4 < peak / (600 * 800 * PICTURE_BYTES) < 1.0


@pytest.mark.parametrize("smooth", [False, True])
def test_no_rim_of_an_object_near_the_eye_is_cut_by_its_window(
    smooth: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Fog around the objects: all that the labels claim shows.
    white = [(0.0, (1, 1, 1)), (1.0, (1, 1, 1))]
    fog = TransferFunction([(0, 0.3), (1000, 0.3)], white)
    scene = replace(make_scene(), transfer_function=fog)
    camera = View((0.0, 0.0, 1.0), fov=40, height=90.0).camera((40, 48, 56), (1, 1, 1))
    # Its box stands along the image, so that it touches whole sides of its window.
    pose = Pose(np.array([0.6 * camera.distance, 2.0, -3.0]), camera.rotation)
    patch = object_image(scene, 1, pose, camera, SIZE, smooth=smooth)
    monkeypatch.setattr(object_casting, "window_of", lambda *_: (0, 0, *SIZE))
    whole = object_image(scene, 1, pose, camera, SIZE, smooth=smooth)
    np.testing.assert_allclose(
        compose.compose(SIZE, [patch]), compose.compose(SIZE, [whole]), atol=3 / 255
    )


def test_a_sprite_needs_a_resolution() -> None:
    with pytest.raises(ValueError, match="pixels_per_mm must be a positive number"):
        sprite_image(make_scene(), 3, Pose(np.zeros(3), np.eye(3)), 0.0)


def test_a_scene_shows_the_bag_what_flies_and_the_sprites() -> None:
    scene = make_scene()
    camera = Camera(np.eye(3), np.array([19.5, 23.5, 27.5]), 150.0)
    full = scene_image(scene, camera, SIZE)
    pose = Pose(np.array([0.0, 0.0, 60.0]), np.eye(3))
    flight = SimpleNamespace(
        pose=lambda time, camera: Pose(np.array([50.0, -time, -60]), np.eye(3)),
        flatness=lambda time, camera: 0.5,
    )
    scene = replace(scene, packed=frozenset({3}), poses={1: pose}, flights={2: flight})
    later = scene_image(scene, camera, SIZE, time=40.0)

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


def simulated() -> Any:
    return simulate_bag(shape=(32, 36, 48), count=5, seed=1)


def unpacked_bag(bag: Any, spacing: float) -> Session:
    session = Session(bag.volume, bag.labels, (spacing,) * 3)
    session.unpack(2)
    return session


@pytest.mark.parametrize("direction", [(0, 0, 1), (0, 1, 1), (1, 0, 0)])
def test_an_angle_seen_along_its_own_line_is_drawn(direction) -> None:
    scene = make_scene()
    ends = np.array([[20.0, 20, 10], [20, 20, 20], [20, 20, 35]])
    ruler = Ruler(frozenset({0}), ends, ("10 mm", "15 mm", "180"))
    camera = View(direction=direction).camera(scene.volume.shape, scene.spacing)
    plain = scene_image(scene, camera, SIZE)
    image = scene_image(replace(scene, rulers=(ruler,)), camera, SIZE)
    assert np.isfinite(image).all()
    # Its numbers stand somewhere.
    assert (np.abs(image - plain).max(axis=-1) > 0.1).sum() > 50


@pytest.mark.parametrize("angle", [1.0, 25.0, 60.0, 90.0, 179.0, 180.0])
@pytest.mark.parametrize("turn", [0.0, 35.0, 90.0, 215.0])
def test_numbers_cover_neither_each_other_nor_the_lengths_their_lines(angle, turn) -> None:
    ways = np.radians([turn, turn + angle])
    sides = np.array([[80.0], [60.0]]) * np.stack([np.sin(ways), np.cos(ways)], axis=1)
    middle = np.array([150.0, 200.0])
    drawn = [np.array([middle + sides[0], middle, middle + sides[1]])]
    drawn.append(np.array([middle + sides[0] / 2, middle + sides[1] / 2]))
    boxes = [[(14.0, 50.0)] * 3, [(14.0, 50.0)]]
    places = number_places(drawn, boxes, (300, 400), 1.0)
    every = np.array([place for each in places for place in each])
    apart = np.abs(every[:, None] - every) >= np.array([14.0, 50.0])
    assert (apart.any(axis=-1) | np.eye(4, dtype=bool)).all()
    for pixels, numbers, lengths in zip(drawn, places, (2, 1), strict=True):
        along = strokes_of(pixels, 1.0)[2 * len(pixels)]
        points = np.concatenate([np.linspace(a, b, 99) for a, b in pairwise(along)])
        for number in numbers[:lengths]:
            assert (np.abs(points - number) > np.array([7.0, 25.0])).any(axis=1).all()


def test_numbers_in_a_throng_stay_near_their_lines() -> None:
    drawn = [np.array([[150.0, 100.0], [150.0, 300.0]])] * 9
    first, *others = number_places(drawn, [[(14.0, 50.0)]] * 9, (300, 400), 1.0)
    far = np.linalg.norm(np.array(others) - first, axis=-1)
    assert far[0] > 0
    assert (far < 40).all()
    # Where none is free it is as if it were alone.
    assert far[-1] == 0


def test_numbers_are_in_the_image_where_some_of_their_lines_are() -> None:
    half = np.array([7.0, 25.0])
    lines = {
        ((-200.0, 100.0), (50.0, 100.0)): True,
        ((-50.0, 350.0), (50.0, 450.0)): True,
        ((-60.0, 350.0), (20.0, 450.0)): False,  # past a corner
        ((-3.0, 100.0), (-3.0, 200.0)): False,
        ((150.0, 900.0), (150.0, 900.0)): False,
    }
    drawn = [np.array(ends) for ends in lines]
    places = number_places(drawn, [[tuple(2 * half)]] * len(lines), (300, 400), 1.0)
    for (number,), seen in zip(places, lines.values(), strict=True):
        inside = (number >= half) & (number <= np.array([300, 400]) - half)
        assert inside.all() if seen else (number + half < -5).any()
    # An angle by one of whose sides the image ends.
    angle = np.array([[290.0, 200.0], [310.0, 200.0], [310.0, 350.0]])
    ((one, other, _),) = number_places([angle], [[tuple(2 * half)] * 3], (300, 400), 1.0)
    assert (one > 0).all()
    assert (other < 0).any()


@pytest.mark.parametrize("spacing", [1.0, 1e7, 1e9])
def test_a_sprite_is_cast_anew_for_another_zoom_however_large_voxels_are(spacing) -> None:
    bag = simulated()
    camera = unpacked_bag(bag, spacing).camera
    drawn_before = unpacked_bag(bag, spacing)
    scene_image(drawn_before.scene(), camera, SIZE)
    nearer = replace(camera, height=camera.height / 1.3)
    warm = scene_image(drawn_before.scene(), nearer, SIZE)
    np.testing.assert_allclose(
        warm, scene_image(unpacked_bag(bag, spacing).scene(), nearer, SIZE), atol=1e-3
    )


@pytest.mark.parametrize("fov", [0.0, 60.0])
def test_a_ruler_lies_upon_the_sprite_that_was_measured(fov: float) -> None:
    size, camera = (240, 320), Camera(np.eye(3), np.full(3, 20.0), 60.0, fov)
    # From corner to corner of the face towards the viewer: a rectangle of 14 by 7 mm.
    ends = np.array([[15.0, 5.0, 6.0], [15.0, 19.0, 13.0]])
    still = replace(
        make_scene(),
        packed=frozenset(),
        poses={1: Pose(np.array([0.0, -10.0, 25.0]), np.eye(3))},
        decorations=Decorations.of("black", []),
    )
    # Of a number that nobody sees.
    measured = replace(still, rulers=(Ruler(frozenset({1}), ends, (" ",)),))
    plain = scene_image(still, camera, size)
    seen = np.argwhere(plain[..., :3].max(axis=-1) > 0.1)
    drawn = np.argwhere(np.abs(scene_image(measured, camera, size) - plain).max(-1))
    # 4 pixels a mm; the object is half a voxel wider, the crosses reach 4 pixels.
    np.testing.assert_allclose(seen.mean(axis=0), (79.5, 259.5), atol=1.5)
    np.testing.assert_allclose((drawn.min(axis=0) + drawn.max(axis=0)) / 2, (79.5, 259.5), atol=1.5)
    np.testing.assert_allclose(np.ptp(drawn, axis=0), (14 * 4 + 8, 7 * 4 + 8), atol=3)


@pytest.mark.parametrize("far", [1e20, 1e99, 1e308])
@pytest.mark.parametrize("more", [[], [[20.0, 25.0, 20.0]]])
def test_a_ruler_to_a_far_point_is_drawn_up_to_the_edge_or_not_at_all(far, more) -> None:
    size, camera = (120, 160), Camera(np.eye(3), np.full(3, 20.0), 60.0, 0.0)
    ends = np.array([[20.0, 20.0, far], [20.0, 20.0, 20.0], *more])
    still = replace(make_scene(), packed=frozenset(), decorations=Decorations.of("black", []))
    numbers = ("", "", "")[: 2 * len(more) + 1]
    plain = scene_image(still, camera, size)
    ruler = Ruler(frozenset({0}), ends, numbers)
    image = scene_image(replace(still, rulers=(ruler,)), camera, size)
    assert np.isfinite(image).all()
    drawn = np.abs(image - plain).max(axis=-1) > 0.1
    # Farther than numbers reach there is no line.
    assert drawn[58:62, 100:].any(axis=0).all() == (far < 1e100)


@pytest.mark.parametrize("fov", [0.0, 60.0])
def test_where_a_flight_ends_it_looks_as_its_sprite_does(fov: float) -> None:
    camera = Camera(np.eye(3), np.full(3, 20.0), 60.0, fov)
    target = Pose(np.array([0.0, -10.0, 25.0]), rotation_about((1, 2, 3), 1.0))
    waiting = replace(make_scene(), packed=frozenset(), poses={1: target})
    box_center = waiting.boxes.center(1, waiting.spacing)
    around = Ball(np.full(3, 20.0), 30.0)
    flight = Flight(1, box_center, np.array([1.0, 0.0, 0.0]), 40.0, target, around)
    flying = replace(waiting, flights={1: flight})
    black = Decorations.of("black", [])
    last, sprite = (
        scene_image(scene, camera, (240, 320), time, decorations=black)[..., :3].max(axis=-1) > 0.1
        for scene, time in ((flying, flight.start + flight.seconds), (waiting, None))
    )
    # A sprite stands at whole pixels, and is cast three times as finely.
    assert np.count_nonzero(last != sprite) < 0.05 * np.count_nonzero(sprite)


def test_a_frame_casts_neither_the_bag_nor_the_sprites_again(monkeypatch: Any) -> None:
    scene = make_scene()
    camera = Camera(np.eye(3), np.array([19.5, 23.5, 27.5]), 150.0)
    pose = Pose(np.array([0.0, 0.0, 60.0]), np.eye(3))
    scene = replace(scene, packed=frozenset({2, 3}), poses={1: pose})
    casts: list[int] = []
    real = compose.cast_subvolume
    monkeypatch.setattr(compose, "cast_subvolume", lambda *a: (casts.append(1), real(*a))[1])
    first = scene_image(scene, camera, SIZE)
    assert len(casts) == 2
    np.testing.assert_array_equal(scene_image(scene, camera, SIZE), first)
    assert len(casts) == 2
    scene_image(scene, Camera(np.eye(3), np.array([19.5, 20.0, 27.5]), 150.0), SIZE)
    assert len(casts) == 3, "the bag has moved in the picture, the sprite has not"
    scene_image(replace(scene, volume=scene.volume.copy()), camera, SIZE)
    assert len(casts) == 5, "another volume looks another way"


def test_sprites_out_of_the_picture_are_not_cast_and_rough_ones_not_refined(monkeypatch) -> None:
    def scene(down: float) -> Any:
        poses = {1: Pose(np.array([0.0, down, 20.0]), np.eye(3))}
        return replace(make_scene(), packed=frozenset(), poses=poses)

    camera = Camera(np.eye(3), np.array([19.5, 23.5, 27.5]), 60.0)
    smooth = scene_image(scene(0.0), camera, SIZE)

    def refuse(*_: Any) -> None:
        raise AssertionError

    monkeypatch.setattr(compose, "upsampled", refuse)
    rough = scene_image(scene(0.0), camera, SIZE, smooth=False)
    # Not more than stairs.
    assert 0 < np.abs(rough - smooth).mean() < 0.02
    monkeypatch.setattr(compose, "sprite_image", refuse)
    scene_image(scene(90.0), camera, SIZE)


def test_an_inspected_object_stands_large_before_the_dimmed_rest() -> None:
    scene = make_scene()
    camera = Camera(np.eye(3), np.array([19.5, 60.0, 27.5]), 150.0)
    plain = scene_image(scene, camera, SIZE)
    pose = Pose(np.array([0.0, 0.0, 60.0]), np.eye(3))
    scene = replace(scene, packed=frozenset({1, 3}), poses={2: pose}, inspected=(2,))
    image = scene_image(scene, camera, SIZE)
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


def test_a_scene_has_the_decorations_asked_for_sprites_before_the_box() -> None:
    scene = make_scene()
    camera = Camera(np.eye(3), np.array([19.5, 23.5, 27.5]), 150.0)
    light = scene_image(scene, camera, SIZE, decorations=Decorations.of("white", ["box", "scale"]))
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
    pose = Pose(np.array([towards, down, right]), np.eye(3))
    scene = replace(scene, packed=frozenset({1, 3}), poses={2: pose})
    covered = scene_image(scene, camera, SIZE, decorations=Decorations.of("black", ["box"]))
    row, col = np.rint(camera.project([[3.5, 3.5, 20.0]], SIZE)[0]).astype(int)
    hidden = scene_image(scene, camera, SIZE)
    # The edge shines through what the object itself lets through, no more.
    np.testing.assert_allclose(covered[row, col], hidden[row, col], atol=0.01)


def test_the_difference_of_two_scenes_names_what_the_bag_must_follow() -> None:
    scene = make_scene()
    assert not scene.difference(replace(scene, poses={1: Pose(np.zeros(3), np.eye(3))}))
    others = Objects(scene.label_data.labels.copy())
    assert replace(scene, label_data=others).difference(scene) == SceneDifference(labels=True)
    recolored = replace(scene, hues={**scene.hues, 1: 0.5})
    assert recolored.difference(scene) == SceneDifference(tints=True)
    left = replace(scene, packed=frozenset({2, 3}))
    assert left.difference(scene) == SceneDifference(ids=frozenset({1}))
    plane = np.array([[[0, 0, 12], [0, 0, 1.0]]])
    cut = replace(scene, clipping=plane, packed=frozenset())
    assert cut.difference(scene) == SceneDifference(appearance=True, ids=scene.packed)


def test_a_session_makes_another_scene_only_after_a_change() -> None:
    made = make_scene()
    session = Session(made.volume, made.label_data.labels)
    first = session.scene()
    assert session.scene() is first
    session.look(replace(session.camera, height=99.0))
    assert session.scene() is first
    session.unpack([1])
    second = session.scene()
    assert second.difference(first) == SceneDifference(ids=frozenset({1}))
    assert second.cache is first.cache
    assert set(second.poses) == {1}
    np.testing.assert_array_equal(second.packed_tints, session.packed_tints())
    np.testing.assert_array_equal(second.tints_alone(1), session.solo_tints(1))
