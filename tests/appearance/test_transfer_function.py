from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from napari_unpack.appearance import PRESETS, TransferFunction

POINTS = [(0, 0.0), (328, 0.0), (533, 0.1), (4095, 0.1)]


def test_opacity_is_linear_between_points_and_constant_beyond_the_ends():
    function = TransferFunction(POINTS)
    assert function.domain == (0.0, 4095.0)
    # Half way up the ramp from 328 to 533 is 430.5, half of 0.1.
    np.testing.assert_allclose(
        function.opacity_at([-500, 328, 430.5, 533, 4095, 30000]),
        [0.0, 0.0, 0.05, 0.1, 0.1, 0.1],
        atol=1e-12,
    )


def test_the_table_has_straight_colour_and_opacity_at_even_steps_over_the_domain():
    function = TransferFunction([(0, 0.0), (100, 1.0)], [(0, (1, 0, 0)), (100, (0, 0, 1))])
    table = function.table(5)
    assert table.dtype == np.float32
    np.testing.assert_allclose(
        table,
        [
            [1, 0, 0, 0],
            [0.75, 0, 0.25, 0.25],
            [0.5, 0, 0.5, 0.5],
            [0.25, 0, 0.75, 0.75],
            [0, 0, 1, 1],
        ],
        atol=1e-6,
    )


def test_without_colours_everything_is_white():
    assert (TransferFunction(POINTS).table()[:, :3] == 1).all()


def test_equal_functions_compare_equal_and_none_can_be_changed():
    function = TransferFunction(POINTS)
    assert function == TransferFunction(list(POINTS))
    assert hash(function) == hash(TransferFunction(POINTS))
    with pytest.raises(AttributeError):
        function.points = ()


@pytest.mark.parametrize(
    ("points", "said"),
    [
        ([(0, 0.0)], "at least two"),
        ([(0, 0.0), (0, 1.0)], "strictly increasing"),
        ([(5, 0.0), (1, 1.0)], "strictly increasing"),
        ([(0, 0.0), (1, 1.5)], r"\[0, 1\]"),
        ([(0, 0.0), (1, float("nan"))], r"\[0, 1\]"),
        ([(0, 0.0), (float("inf"), 1.0)], "finite"),
        ([(0, 0.0, 3), (1, 0.5, 3)], "pairs"),
    ],
)
def test_bad_points_are_refused_with_a_sentence(points, said):
    with pytest.raises(ValueError, match=said):
        TransferFunction(points)


@pytest.mark.parametrize("colors", [[], [(0, (1, 1))], [(0, (1, 1, 2))], [(1, (1, 1, 1))] * 2])
def test_bad_colours_are_refused(colors):
    with pytest.raises(ValueError, match="colors"):
        TransferFunction(POINTS, colors)


def test_a_table_of_one_row_is_refused():
    with pytest.raises(ValueError, match="n must be at least 2"):
        TransferFunction(POINTS).table(1)


def test_presets_show_what_their_names_say():
    assert sorted(PRESETS) == ["air", "all", "dense", "metal", "plastic", "soft", "water"]
    air, foam, cloth, water, resin, stone, steel = 0, 80, 400, 1000, 1300, 2500, 8000
    opacity = {name: TransferFunction.preset(name).opacity_at for name in PRESETS}
    assert all(opacity[name](air) == 0 for name in PRESETS)
    assert opacity["all"](cloth) > 0
    assert opacity["soft"](water) > opacity["soft"](stone)
    assert opacity["dense"](water) < 0.05 < opacity["dense"](stone)
    assert opacity["metal"](stone) == 0 < opacity["metal"](steel)
    # What is nearly air is seen with "air" alone.
    assert opacity["air"](foam) > 0
    assert all(opacity[name](foam) == 0 for name in PRESETS if name != "air")
    assert opacity["water"](water) > 5 * max(opacity["water"](cloth), opacity["water"](stone))
    assert opacity["plastic"](resin) > 5 * max(opacity["plastic"](cloth), opacity["plastic"](stone))
    with pytest.raises(ValueError, match="all, soft, air, water, plastic, dense, metal"):
        TransferFunction.preset("bones")


def scan(air: float, matter: float, noise: float, dtype: type) -> np.ndarray:
    generator = np.random.default_rng(3)
    volume = np.full((40, 40, 40), air, dtype=np.float64)
    volume[10:30, 10:30, 10:30] = matter
    volume += generator.normal(0, noise, volume.shape)
    if np.issubdtype(dtype, np.integer):
        volume = np.clip(np.round(volume), 0, np.iinfo(dtype).max)
    return volume.astype(dtype)


@pytest.mark.parametrize(
    ("air", "matter", "noise", "dtype"),
    [
        (20, 1050, 15, np.uint16),
        (12, 140, 5, np.uint8),
        (30000, 42000, 400, np.uint16),
        (-1000, 40, 20, np.float32),
        (0.001, 0.019, 0.0008, np.float64),
    ],
)
def test_the_default_lets_air_through_and_makes_matter_nearly_solid_whatever_the_range(
    air, matter, noise, dtype
):
    function = TransferFunction.default_for(scan(air, matter, noise, dtype))
    assert function.opacity_at(air + 3 * noise) <= 0.02
    assert 0.25 <= function.opacity_at(matter) <= 0.7


def test_a_little_metal_does_not_make_the_rest_transparent():
    volume = scan(20, 1050, 15, np.uint16)
    volume[12:14, 12:14, 12:14] = 30000
    assert TransferFunction.default_for(volume).opacity_at(1050) >= 0.25


def test_a_labelled_object_lighter_than_the_foreground_is_seen_and_nothing_else_changes():
    volume = scan(20, 1050, 15, np.uint16)
    volume[2:8, 2:8, 2:8] = 90
    labels = np.zeros(volume.shape, np.int64)
    labels[10:30, 10:30, 10:30] = 2**40
    plain = TransferFunction.default_for(volume)
    assert plain.opacity_at(90) < 0.02
    assert TransferFunction.default_for(volume, labels) == plain
    labels[2:8, 2:8, 2:8] = 7
    shown = TransferFunction.default_for(volume, labels)
    assert shown.opacity_at(90) == pytest.approx(0.1)
    assert shown.opacity_at(20 + 15) == 0.0
    assert shown.points[-3:] == plain.points[-3:]


def test_a_box_full_of_air_is_seen_by_its_wall():
    volume = scan(20, 1050, 15, np.uint16)
    labels = np.zeros(volume.shape, np.uint16)
    labels[10:30, 10:30, 10:30] = 1
    volume[11:29, 11:29, 11:29] = 20
    assert TransferFunction.default_for(volume, labels) == TransferFunction.default_for(volume)


def test_labels_of_another_shape_are_refused():
    with pytest.raises(ValueError, match=r"shape \(40, 40, 40\), got \(40, 40, 20\)"):
        TransferFunction.default_for(scan(20, 1050, 15, np.uint16), np.zeros((40, 40, 20), int))


def test_a_speck_between_the_voxels_looked_at_is_contrast_too():
    # 110^3 voxels are thinned to every second one along each axis: the speck is not among them.
    volume = np.zeros((110, 110, 110), np.uint8)
    volume[55, 55, 55] = 9
    function = TransferFunction.default_for(volume)
    assert function.opacity_at(0) == 0.0
    assert function.opacity_at(9) > 0.1


@pytest.mark.parametrize(
    ("offset", "most", "dtype"),
    [(2**60, 1916, np.uint64), (-(2**60), 1916, np.int64), (2**60, 2**62, np.int64)],
)
def test_a_small_range_far_from_zero_has_a_default(offset, most, dtype):
    volume = (scan(20, 1050, 15, np.uint16).astype(np.int64) + offset).astype(dtype)
    volume[12, 12, 12] = offset + most
    function = TransferFunction.default_for(volume)
    assert function.opacity_at(offset + 20) == 0.0
    assert function.opacity_at(offset + 1050) > 0.1


@pytest.mark.parametrize("volume", [np.full((3, 3, 3), 7), np.full((3, 3, 3), np.nan)])
def test_there_is_no_default_for_a_volume_without_contrast(volume):
    with pytest.raises(ValueError, match="volume must"):
        TransferFunction.default_for(volume)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(-1e4, 1e4), min_size=2, max_size=40),
    st.sampled_from([np.float32, np.float64]),
)
def test_a_default_is_found_for_any_two_different_densities(values, dtype):
    volume = np.array(values, dtype=dtype).reshape(1, 1, -1)
    if volume.max() - volume.min() < 1e-3:
        return
    low, high = TransferFunction.default_for(volume).domain
    assert low < high


@pytest.mark.filterwarnings("error")
def test_the_first_function_of_tiny_and_of_huge_densities_is_that_of_the_same_scan_of_others():
    scan = np.random.default_rng(0).normal(size=(8, 8, 8))
    wanted = TransferFunction.default_for(scan)
    for scale in (1e-290, 1e160, 1e300):
        found = TransferFunction.default_for(scan * scale)
        np.testing.assert_allclose(found.table(), wanted.table(), atol=1e-6)
        np.testing.assert_allclose(
            np.array(found.points)[:, 0] / scale, np.array(wanted.points)[:, 0]
        )
    # Across less than floats have slopes for, nothing can be told apart.
    with pytest.raises(ValueError, match="must not be constant"):
        TransferFunction.default_for(scan * 1e-310)
