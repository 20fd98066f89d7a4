from __future__ import annotations

import importlib
import tracemalloc

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from napari_unpack.geometry.transforms import rotation_about
from napari_unpack.geometry.view import View
from napari_unpack.unpacking import (
    bag_up,
    broad_side,
    hull_vertices,
    image_extent,
    named,
    oriented_box,
    outline,
    towards_viewer,
)


def turned_box(size, rotation, center=(0.0, 0.0, 0.0)) -> np.ndarray:
    """Return the corners of a box whose edges along z, y, x are turned by a rotation."""
    corners = (np.indices((2, 2, 2)).reshape(3, -1).T - 0.5) * np.asarray(size, float)
    return corners @ rotation.T + np.asarray(center)


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.1])
def test_the_oriented_box_of_a_turned_box_is_that_box(angle):
    turn = rotation_about((1.0, 2.0, 0.5), angle)
    found = oriented_box(turned_box((40, 10, 70), turn, (5, 6, 7)))
    np.testing.assert_allclose(found.size, [70, 40, 10], rtol=1e-2)
    np.testing.assert_allclose(found.center, [5, 6, 7], atol=1e-2)
    # Longest edge was x, then z, then y.
    for axis, edge in zip(found.axes, (turn[:, 2], turn[:, 0], turn[:, 1]), strict=True):
        assert abs(axis @ edge) == pytest.approx(1.0, abs=1e-4)
    assert np.linalg.det(found.axes) == pytest.approx(1.0)


@pytest.mark.parametrize("count", [2, 3, 30])
def test_points_in_a_line_have_a_box_too(count):
    points = np.arange(count)[:, None] * np.array([[0.0, 1.0, 0.0]])
    found = oriented_box(points, (1.0, 1.0, 1.0))
    assert found.size[0] == pytest.approx(count, rel=1e-6)


def test_a_single_voxel_has_a_box_around_it_that_is_not_flat():
    found = oriented_box(np.array([[3.0, 4.0, 5.0]]), (1.0, 1.0, 1.0))
    assert found.size.min() >= 0.5
    assert found.size.max() <= 1.0
    np.testing.assert_allclose(found.center, [3, 4, 5], atol=1e-9)


def test_the_outline_keeps_both_ends_of_every_row():
    mask = np.zeros((2, 3, 5), bool)
    mask[1, 2, 1:4] = True
    points = outline(mask, (10, 20, 30), (2.0, 1.0, 0.5))
    # Row z = 11, y = 22, from x = 31 to x = 33, times the spacing.
    np.testing.assert_allclose(points, [[22, 22, 15.5], [22, 22, 16.5]])


def test_up_of_a_lying_bag_is_the_normal_of_its_largest_face_away_from_the_table():
    # A suitcase 30 high along y; rows grow downwards to the table, so up is -y.
    lying = oriented_box(turned_box((50, 30, 80), np.eye(3)))
    np.testing.assert_allclose(bag_up(lying), [0, -1, 0], atol=1e-6)
    tilt = rotation_about((0.0, 0.0, 1.0), 0.4)
    tilted = oriented_box(turned_box((50, 30, 80), tilt))
    np.testing.assert_allclose(bag_up(tilted), -tilt[:, 1], atol=1e-3)


def test_up_of_a_bag_on_edge_does_not_hang_on_rounding():
    standing = oriented_box(turned_box((20, 60, 80), np.eye(3)))
    np.testing.assert_allclose(bag_up(standing), [-1, 0, 0], atol=1e-6)


def test_named_directions():
    np.testing.assert_allclose(named("-y"), [0, -1, 0])
    np.testing.assert_allclose(named((0, 3, 4)), [0, 0.6, 0.8])
    with pytest.raises(ValueError, match="direction must be one of"):
        named("north")
    with pytest.raises(ValueError, match="must not be zero"):
        named((0, 0, 0))


def test_by_default_objects_leave_towards_the_viewer():
    camera = View(direction=(0.0, 2.0, 0.0)).camera((9, 9, 9), (1, 1, 1))
    np.testing.assert_allclose(towards_viewer(camera), [0, -1, 0], atol=1e-12)


def upright(turn):
    """Take the slant of 18 and -24 degrees off a turn."""
    right, down = (
        rotation_about((0, 0, 1), np.radians(18)),
        rotation_about((0, 1, 0), np.radians(-24)),
    )
    return (right @ down).T @ turn


def test_the_broad_side_faces_the_viewer_and_the_turn_is_the_smallest():
    # A tablet lying flat (thin along y), seen from the front (looking along z).
    tablet = oriented_box(turned_box((40, 2, 60), np.eye(3)))
    seen = View(direction=(1.0, 0.0, 0.0)).camera((9, 9, 9), (1, 1, 1)).rotation
    turn = upright(broad_side(tablet, seen))
    assert abs(turn[0] @ [0, 1, 0]) == pytest.approx(1.0, abs=1e-6)  # thin axis to the viewer
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    # Right in the image stays right: x was right before.
    np.testing.assert_allclose(turn[2], seen[2], atol=1e-6)
    width, height = image_extent(turned_box((40, 2, 60), np.eye(3)), turn, (0, 0, 0), (0, 0, 0))
    assert (width, height) == pytest.approx((60, 40), rel=1e-2)


def test_an_object_already_broadside_only_gets_the_slant():
    plate = oriented_box(turned_box((2, 40, 60), np.eye(3)))
    turn = broad_side(plate, np.eye(3))
    assert turn[0] @ [1, 0, 0] == pytest.approx(np.cos(np.radians(18)) * np.cos(np.radians(24)))


def least_by_all_faces(points, thickness):
    """Try every face of the hull of the voxels' corners with a fine turn about its normal."""
    half = np.array(np.meshgrid(*[(-t / 2, t / 2) for t in thickness])).reshape(3, -1).T
    hull = ConvexHull((points[:, None] + half).reshape(-1, 3))
    corners, best = hull.points[hull.vertices], np.inf
    for normal in np.unique(hull.equations[:, :3].round(3), axis=0):
        u = np.linalg.svd(normal[None])[2][1:]
        deep = np.ptp(corners @ (normal / np.linalg.norm(normal)))
        for angle in np.linspace(0, np.pi / 2, 60, endpoint=False):
            turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
            best = min(best, deep * np.prod(np.ptp(corners @ (turn @ u).T, axis=0)))
    return best


@pytest.mark.parametrize("kind", ["ball", "bottle", "wedge", "banana"])
def test_a_box_found_among_a_few_faces_is_near_the_least_and_holds_everything(kind):
    z, y, x = np.indices((40, 44, 48)) - 20.0
    mask = {
        "ball": z**2 + 1.5 * y**2 + x**2 < 300,
        "bottle": (z**2 + y**2 < np.where(x > 8, 12, 90)) & (np.abs(x - 2) < 20),
        "wedge": (z > -9) & (y > -9) & (x > -12) & (z + y + 0.4 * x < 6),
        "banana": (np.hypot(z, y) - 13) ** 2 + x**2 < 14,
    }[kind]
    points = np.argwhere(mask) @ np.diag([1.2, 1.0, 0.8])
    found = oriented_box(points, (1.2, 1.0, 0.8))
    along = (points - found.center) @ found.axes.T
    assert (np.abs(along) <= found.size / 2 + 1e-9).all()
    np.testing.assert_allclose(found.axes @ found.axes.T, np.eye(3), atol=1e-9)
    least = least_by_all_faces(points, (1.2, 1.0, 0.8))
    assert np.prod(found.size) <= 1.03 * least


def test_few_faces_are_looked_at_closely_however_round_a_thing_is(monkeypatch):
    z, y, x = np.indices((60, 60, 60)) - 29.5
    points = np.argwhere(z**2 + y**2 + x**2 < 800).astype(float)
    module, closely = importlib.import_module("napari_unpack.unpacking.oriented_box"), []
    whole = module.least_rectangle
    monkeypatch.setattr(
        module, "least_rectangle", lambda *given: closely.append(len(given[0])) or whole(*given)
    )
    oriented_box(points, (1.0, 1.0, 1.0))
    assert len(closely) <= 20
    assert max(closely) < 1500


def test_the_corners_of_many_points_take_little_memory():
    points = np.random.default_rng(0).normal(size=(50_000, 3))
    tracemalloc.start()
    hull_vertices(points)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 300 * len(points)


@pytest.mark.parametrize("voxels", [(1, 1, 1), (1, 1, 6), (1, 2, 1), (1, 5, 9), (4, 1, 1)])
@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (2.0, 1.0, 0.5)])
def test_the_box_of_a_single_layer_is_as_large_as_its_voxels(voxels, spacing):
    points = outline(np.ones(voxels, bool), (0, 0, 0), spacing)
    size = oriented_box(points, spacing).size
    np.testing.assert_allclose(np.sort(size), np.sort(np.multiply(voxels, spacing)), rtol=1e-6)
