from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import polar

from napari_unpack.geometry.standard_views import Side, bag_axes, seen_along, seen_from, upright

LINEAR = {
    "as it is": np.eye(3),
    "upside down": np.diag([1.0, -1.0, 1.0]),
    "stretched and mirrored": np.array([[1.3, 0.2, 0.0], [0.0, -1.0, 0.3], [0.1, 0.0, 0.8]]),
}


@pytest.mark.parametrize("linear", LINEAR.values(), ids=list(LINEAR))
@pytest.mark.parametrize("up", [(0, -1, 0), (0, 1, 0), (1, 0, 0), (0.2, -0.9, 0.3)])
def test_the_six_sides_are_square_to_each_other_and_upright(linear, up):
    rotation, stretch = polar(linear / np.cbrt(abs(np.linalg.det(linear))))
    stretch = stretch * np.sign(np.linalg.det(rotation))
    axes = bag_axes(up, stretch)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    above = np.linalg.inv(stretch) @ np.asarray(up, dtype=float)
    seen = {side: seen_from(side, axes) for side in Side}
    for side, camera in seen.items():
        assert np.linalg.det(camera) == pytest.approx(1.0)
        toward, down, right = camera @ above / np.linalg.norm(above)
        steep = {Side.TOP: 1.0, Side.BOTTOM: -1.0}.get(side, 0.0)
        assert toward == pytest.approx(steep, abs=1e-9)
        assert down == pytest.approx(abs(steep) - 1.0, abs=1e-9)
        assert right == pytest.approx(0.0, abs=1e-9)
    front = seen[Side.FRONT]
    np.testing.assert_allclose(seen[Side.RIGHT][0], front[2], atol=1e-12)
    np.testing.assert_allclose(seen[Side.LEFT][0], -front[2], atol=1e-12)
    np.testing.assert_allclose(seen[Side.BACK][0], -front[0], atol=1e-12)
    # From above the front is at the bottom of the picture, and left stays left.
    np.testing.assert_allclose(seen[Side.TOP][1:], [front[0], front[2]], atol=1e-12)
    np.testing.assert_allclose(seen[Side.BOTTOM][1:], [-front[0], front[2]], atol=1e-12)


def test_a_bag_that_hardly_leans_stands_upright():
    assert tuple(upright((0.1, -1.0, 0.1), (0, -1, 0))) == (0, -1, 0)
    np.testing.assert_allclose(upright((0.6, -0.8, 0), (0, -1, 0)), (0.6, -0.8, 0))


def test_the_first_view_is_from_the_front():
    np.testing.assert_allclose(seen_from(Side.FRONT, bag_axes((0, -1, 0), np.eye(3))), np.eye(3))


@pytest.mark.parametrize("direction", [(1, 0, 0), (0, -1, 0), (0, 1, 0), (0.3, -0.4, 2.0)])
def test_what_leaves_along_a_direction_comes_towards_the_viewer(direction):
    camera = seen_along(direction, bag_axes((0, -1, 0), np.eye(3)))
    assert np.linalg.det(camera) == pytest.approx(1.0)
    way = camera @ np.asarray(direction, dtype=float)
    np.testing.assert_allclose(way / np.linalg.norm(way), [1, 0, 0], atol=1e-12)
