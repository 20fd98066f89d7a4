from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from napari_unpack.geometry.view import View
from napari_unpack.unpacking import arrange
from napari_unpack.unpacking.slots import GAP, LEAST_BAG, LEAST_PIXELS

plans = given(
    count=st.integers(0, 200),
    radius=st.floats(5, 500),
    size=st.tuples(st.integers(1, 1400), st.integers(1, 2200)),
    fov=st.sampled_from([0.0, 15.0, 30.0, 60.0]),
)


def pixels(plan, size, fov):
    """Return the cells' centres in pixels from the middle, and the side of a cell."""
    camera = View(height=plan.height_mm, fov=fov).camera((10, 10, 10), (1, 1, 1))
    middle = (np.asarray(size) - 1) / 2
    return camera.pixels(plan.centers, size) - middle, plan.cell_mm * size[0] / plan.height_mm


def within(centers, side, size):
    """Tell which cells lie in the window."""
    return (np.abs(centers) + side / 2 <= np.asarray(size) / 2 + 1e-6).all(axis=1)


@settings(max_examples=150, deadline=None)
@plans
def test_no_sprite_overlaps_another_or_the_bag_at_any_turn_of_it(count, radius, size, fov):
    plan = arrange(count, radius, size, fov)
    centers, side = pixels(plan, size, fov)
    assert centers.shape == (count, 2)
    gap = GAP if side >= LEAST_PIXELS - 1e-6 else side / 8
    apart = np.abs(centers[:, None] - centers[None]).max(axis=-1) + np.eye(count) * 1e9
    assert count < 2 or apart.min() >= side + gap - 1e-6
    # The silhouette of a sphere in perspective is wider than its equator.
    per_mm = size[0] / plan.height_mm
    if fov:
        eye = plan.height_mm / (2 * np.tan(np.radians(fov) / 2))
        assert eye > radius
        bag = per_mm * radius * eye / np.sqrt(eye**2 - radius**2)
    else:
        bag = per_mm * radius
    corner = np.hypot(*np.maximum(np.abs(centers) - side / 2, 0).T)
    assert count == 0 or corner.min() >= bag + gap - 1e-6
    assert LEAST_BAG * min(size) - 1e-6 <= bag <= min(size) / 2 - gap + 1e-6
    assert plan.least_mm <= plan.cell_mm + 1e-9


@settings(max_examples=150, deadline=None)
@plans
def test_all_slots_lie_in_the_window_whatever_its_shape(count, radius, size, fov):
    plan = arrange(count, radius, size, fov)
    centers, side = pixels(plan, size, fov)
    assert len(centers) == count
    assert within(centers, side, size).all()


@pytest.mark.parametrize("size", [(600, 800), (600, 1100), (768, 1024), (1080, 1920), (1100, 700)])
def test_thirty_objects_all_find_room_in_every_usual_window(size):
    centers, side = pixels(arrange(30, 150.0, size), size, 0.0)
    # With a margin at the edge.
    assert within(centers, side + 0.04 * min(size), size).sum() == 30


def test_sprites_shrink_only_where_the_window_has_no_room_and_no_more_than_needed():
    size = (768, 1024)
    few, many = arrange(60, 150.0, size), arrange(200, 150.0, size)
    assert pixels(few, size, 0.0)[1] >= LEAST_PIXELS
    assert 30 <= pixels(many, size, 0.0)[1] < LEAST_PIXELS


def test_beyond_256_objects_the_rest_stands_outside_and_the_first_stay_legible():
    size = (768, 1024)
    plan = arrange(3000, 150.0, size)
    centers, side = pixels(plan, size, 0.0)
    assert side >= 24
    inside = within(centers, side, size)
    assert len(centers) == 3000 > inside.sum() >= 256
    assert inside[:256].all()
    apart = np.abs(centers[:, None] - centers[None]).max(axis=-1) + np.eye(3000) * 1e9
    assert apart.min() >= side


def test_fewer_objects_make_larger_sprites():
    few, many = arrange(8, 150.0, (768, 1024)), arrange(40, 150.0, (768, 1024))
    assert few.cell_mm / few.height_mm > 1.3 * many.cell_mm / many.height_mm


def test_the_first_slots_are_those_that_draw_the_camera_back_least():
    height, width = 700, 1500
    plan = arrange(40, 150.0, (height, width))
    centers, side = pixels(plan, (height, width), 0.0)
    needed = (np.abs(centers) + side / 2) / np.array([height, width]) * 2
    assert (np.diff(needed.max(axis=1).round(6)) >= 0).all()
    # Of those that need the same, the bag is flanked first, right and left in turn.
    column = centers[centers[:, 1].round() == centers[0, 1].round()]
    assert (np.diff(np.abs(column[:3, 0])) >= -1e-6).all()
    np.testing.assert_allclose(centers[1:10:2], centers[0:10:2] * [1, -1], atol=1e-6)


def test_a_sprite_is_true_to_the_bag_where_its_size_allows():
    plan = arrange(30, 150.0, (768, 1024))
    natural = (plan.least_mm + plan.cell_mm) / 2
    assert plan.scale(natural, 1.0) == pytest.approx(1.0)
    assert plan.scale(1.0, 4 * plan.cell_mm) == pytest.approx(0.25)
    assert plan.scale(plan.least_mm / 5, 1e-3) == pytest.approx(5.0)


def test_windows_of_any_size_get_a_plan():
    for size in [(1, 1), (10, 3000), (3000, 10), (64, 64)]:
        plan = arrange(5, 100.0, size)
        assert np.isfinite(plan.centers).all()
        assert plan.height_mm > 0


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ((-1, 1.0, (500, 500)), "count"),
        ((1, 0.0, (500, 500)), "bag_radius_mm"),
        ((1, float("nan"), (500, 500)), "bag_radius_mm"),
        ((1, 1.0, (0, 500)), "canvas_size"),
    ],
)
def test_bad_arguments_are_refused(arguments, name):
    with pytest.raises(ValueError, match=name):
        arrange(*arguments)
