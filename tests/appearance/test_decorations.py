from __future__ import annotations

import numpy as np
import pytest

from napari_unpack.appearance.decorations import (
    box_edges,
    draw_edges,
    round_length,
    scale_mark,
    stroke_cover,
)
from napari_unpack.geometry.length_unit import MM
from napari_unpack.geometry.view import Camera

INK = (1.0, 1.0, 1.0, 1.0)


def camera(fov=0.0):
    return Camera(np.eye(3), np.array([5.0, 10.0, 20.0]), 40.0, fov)


def test_a_box_seen_from_the_front_is_a_rectangle_at_its_corners():
    lower, upper = np.array([0.0, 0.0, 10.0]), np.array([10.0, 20.0, 30.0])
    rgba, depth = draw_edges(box_edges(lower, upper, camera()), camera(), (80, 120), INK)
    rows, cols = np.nonzero(rgba[..., 3] > 0.1)
    # Two pixels a mm: rows 39.5 -+ 20, columns 59.5 -+ 20.
    assert (rows.min(), rows.max()) == (19, 60)
    assert (cols.min(), cols.max()) == (39, 80)
    assert rgba[40, 60, 3] == 0
    assert depth[40, 60] == np.inf


@pytest.mark.parametrize("fov", [0.0, 40.0])
def test_depths_along_an_edge_are_those_of_its_points(fov):
    ends = np.array([[[-9.0, -12.0, -15.0], [12.0, 9.0, 13.0]]])
    eye = camera(fov)
    rgba, depth = draw_edges(ends, eye, (200, 200), INK)
    for share in (0.1, 0.35, 0.5, 0.8):
        point = ends[0, 0] + share * (ends[0, 1] - ends[0, 0])
        row, col = np.rint(eye.pixels(point, (200, 200))).astype(int)
        assert rgba[row, col, 3] > 0.1
        assert depth[row, col] == pytest.approx(-point[0], abs=0.2)


def test_edges_behind_the_eye_are_left_out():
    eye = camera(40.0)
    ends = np.array([[[eye.distance + 5, 0.0, 0.0], [0.0, 5.0, 5.0]]])
    assert not draw_edges(ends, eye, (50, 50), INK)[0].any()


@pytest.mark.parametrize("far", [1e4, 1e20, 1e300])
@pytest.mark.parametrize("way", [(0.0, 1.0), (-1.0, 0.0), (1.0, 1.0), (0.3, -1.0)])
def test_a_line_to_a_far_point_is_drawn_up_to_the_edge(far, way):
    start, way = np.array([20.0, 30.0]), np.array(way)
    near, long = (np.array([start, start + reach * way]) for reach in (200.0, far))
    wanted = stroke_cover([near], (50, 60), 1.2)
    assert wanted.any()
    np.testing.assert_allclose(stroke_cover([long], (50, 60), 1.2), wanted, atol=1e-5)
    # Both ends are far off, on two sides and on one.
    through = np.array([start - far * way, start + far * way])
    if not np.prod(way):
        assert stroke_cover([through], (50, 60), 1.2).max() == 1.0
    assert not stroke_cover([long + far * way], (50, 60), 1.2).any()


def test_an_edge_that_is_cut_keeps_the_depths_of_its_points():
    eye = camera(40.0)
    # From the middle of the image to far behind and beside it.
    ends = np.array([[[0.0, 0.0, 0.0], [-1e6, 0.0, 1e6]]])
    _, depth = draw_edges(ends, eye, (200, 200), INK)
    for t in (5.0, 10.0, 15.0):
        row, col = np.rint(eye.pixels([-t, 0.0, t], (200, 200))).astype(int)
        assert depth[row, col] == pytest.approx(t, abs=0.3)


def test_a_line_has_the_same_strength_at_any_angle():
    sums = []
    for angle in np.radians([0, 10, 30, 45, 80]):
        way = 15 * np.array([0.0, np.sin(angle), np.cos(angle)])
        rgba, _ = draw_edges(np.array([[-way, way]]), camera(), (200, 200), INK)
        sums.append(rgba[..., 3].sum())
    assert np.ptp(sums) < 0.08 * np.mean(sums)


@pytest.mark.parametrize(
    ("longest", "length", "words"),
    [(7.0, 5.0, "5 mm"), (100.0, 100.0, "100 mm"), (0.03, 0.02, "20 µm"), (2600.0, 2000.0, "2 m")],
)
def test_lengths_are_round(longest, length, words):
    assert round_length(longest) == (pytest.approx(length), words)


def test_the_scale_bar_is_as_long_as_it_says():
    rgba, _, _ = scale_mark(camera(), (400, 600), INK, MM)
    rows = np.flatnonzero((rgba[..., 3] > 0.5).any(1))
    bar = rgba[rows[-1], :, 3] > 0.5
    # 40 mm are 400 pixels; a fifth of the width is 12 mm, so the bar says 10 mm.
    assert bar.sum() == 100
