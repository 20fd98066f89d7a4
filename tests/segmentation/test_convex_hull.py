import numpy as np
import pytest

from napari_unpack.segmentation.common.convex_hull import hull_volume, support_points


def test_the_support_points_of_a_box_span_it_and_those_of_a_ball_nearly():
    corners = np.array(np.meshgrid([0, 4], [0, 5], [0, 6])).reshape(3, -1).T.astype(float)
    rng = np.random.default_rng(0)
    filling = rng.uniform(0, 4, (500, 3))
    assert hull_volume(support_points(np.concatenate([filling, corners]))) == 4 * 5 * 6
    sphere = rng.normal(size=(20000, 3))
    sphere /= np.linalg.norm(sphere, axis=1)[:, None]
    few = support_points(sphere)
    assert len(few) <= 96
    assert 0.9 < hull_volume(few) / (4 / 3 * np.pi) < 1


def test_the_support_points_of_a_needle_span_it_too():
    grid = np.stack(np.indices((5, 6, 7)), axis=-1).reshape(-1, 3)
    tips = [[-1, 2.5, 3], [5, 2.5, 3]]
    needle = np.concatenate([grid, tips]) * np.array([500, 0.5, 0.5])
    # A box of 2000 x 2.5 x 3, and two pyramids of 500.
    assert hull_volume(support_points(needle)) == pytest.approx(15000 + 2 * 7.5 * 500 / 3)
    flat = needle * np.array([1, 1, 0])
    assert len(support_points(flat)) > 0
