import numpy as np
import pytest
from phantoms import ball, box, scanned
from scipy.ndimage import gaussian_filter

from napari_unpack.geometry.axes import voxel_size
from napari_unpack.segmentation.common.validation import checked_volume
from napari_unpack.segmentation.foreground.denoising import is_noisy
from napari_unpack.segmentation.foreground.methods import checked_foreground, find_foreground
from napari_unpack.segmentation.foreground.scanner_table import find_supports
from napari_unpack.segmentation.foreground.thresholds import above_levels, find_levels, peel
from napari_unpack.simulation import simulate_bag

SHAPE = (32, 40, 48)


def bag():
    labels = np.zeros(SHAPE, np.int32)
    labels[ball(SHAPE, (16, 14, 14), 9)] = 1
    labels[box(SHAPE, (8, 8, 28), (24, 30, 42))] = 2
    return labels, scanned(labels, {1: 400, 2: 2500})


@pytest.mark.parametrize(
    ("convert", "name"),
    [
        (lambda v: v, "uint16"),
        (lambda v: (v / 12).astype(np.uint8), "uint8"),
        (lambda v: v.astype(np.int16) - 1000, "Hounsfield"),
        (lambda v: v.astype(np.float32) * 1e-4, "attenuation"),
        (lambda v: v.astype(np.float64) * 1e5 - 7e7, "large floats"),
    ],
)
def test_cloth_and_metal_are_both_foreground_at_any_scale(convert, name):
    labels, volume = bag()
    scaled = convert(volume)
    levels = find_levels(scaled)
    found = peel(above_levels(scaled, levels), scaled, levels.air)
    for k in (1, 2):
        assert (found & (labels == k)).sum() > 0.93 * (labels == k).sum(), name
    assert (found & (labels == 0)).sum() < 0.08 * (labels > 0).sum()


def test_nan_is_background():
    labels, volume = bag()
    broken = volume.astype(np.float32)
    broken[labels == 2] = np.nan
    found = above_levels(broken, find_levels(broken))
    assert not found[labels == 2].any()
    assert found[labels == 1].mean() > 0.9


def test_weak_matter_counts_only_where_it_is_connected_to_strong():
    from napari_unpack.segmentation.foreground.thresholds import Levels

    volume = np.array([[[0, 5, 9, 5, 0, 5, 5, 0]]])
    found = above_levels(volume, Levels(0, 1, 5, 9))
    np.testing.assert_array_equal(found[0, 0], [0, 1, 1, 1, 0, 0, 0, 0])


def test_peeling_takes_the_blurred_fringe_of_metal_and_leaves_thin_cloth():
    row = np.zeros((3, 3, 12))
    row[:, :, 1:9] = [100, 400, 1000, 1000, 1000, 400, 100, 0]
    row[:, :, 10] = 120
    kept = peel(row > 50, row, 0.0)[1, 1]
    np.testing.assert_array_equal(np.flatnonzero(kept), [3, 4, 5, 10])


def test_a_table_under_the_bag_is_found_and_the_bag_is_not():
    foreground = np.zeros((100, 120, 160), bool)
    across = np.arange(160)
    table = (80 + (across - 80) ** 2 / 400).astype(int)
    for x in range(5, 155):
        foreground[:, table[x] : table[x] + 4, x] = True
    bag_mask = box(foreground.shape, (20, 30, 40), (80, 81, 120)) & ~foreground
    found = find_supports(foreground | bag_mask, (2.0, 2.0, 2.0))
    assert found[foreground].mean() > 0.95
    assert found[bag_mask].mean() < 0.08


def test_one_object_that_fills_the_volume_is_not_a_table():
    assert not find_supports(np.ones((80, 100, 100), bool), (2.0, 2.0, 2.0)).any()


@pytest.mark.parametrize(
    ("volume", "words"),
    [
        (np.zeros((4, 4)), "3 axes"),
        (np.zeros((0, 4, 4)), "empty"),
        (np.full((4, 4, 4), 7), "constant"),
        (np.full((4, 4, 4), -0.0), r"constant \(0 everywhere"),
        (np.full((4, 4, 4), np.nan), "no finite value"),
        (np.zeros((1, 1, 1)), "constant"),
    ],
)
def test_an_unusable_volume_is_refused_with_a_sentence(volume, words):
    with pytest.raises(ValueError, match=words):
        checked_volume(volume)


def test_a_volume_of_words_is_a_type_error():
    with pytest.raises(TypeError, match="real numbers"):
        checked_volume(np.full((2, 2, 2), "a"))


@pytest.mark.parametrize("spacing", [(0, 1, 1), (1, -1, 1), (1, 1), (np.nan, 1, 1), 1.0])
def test_a_spacing_that_is_not_three_positive_numbers_is_refused(spacing):
    with pytest.raises(ValueError, match="spacing must be three positive"):
        voxel_size(spacing)


@pytest.mark.parametrize(
    ("way", "kind", "words"),
    [
        ("watershed", ValueError, "one of 'hysteresis', 'otsu'"),
        (np.nan, ValueError, "or a density, got nan"),
        (None, TypeError, "or a density, got None"),
        (True, TypeError, "or a density, got True"),
    ],
)
def test_an_unknown_way_to_find_the_foreground_is_refused(way, kind, words):
    with pytest.raises(kind, match=words):
        checked_foreground(way)


def test_a_number_and_otsu_are_one_level_and_hysteresis_follows_connections():
    volume = np.zeros((12, 12, 40))
    volume[3:9, 3:9, 3:9] = 1000
    volume[5:7, 5:7, 9:20] = 700
    volume[5:7, 5:7, 30:36] = 700
    volume += np.random.default_rng(0).normal(0, 5, volume.shape)
    foreground, levels = find_foreground(volume, (1.0, 1.0, 1.0), 800.0)
    assert levels.low == levels.high == 800
    np.testing.assert_array_equal(foreground, volume >= 800)
    for way in ("otsu", "hysteresis"):
        foreground, _ = find_foreground(volume, (1.0, 1.0, 1.0), way)
        assert foreground[5:7, 5:7, 10:19].all(), way
        assert foreground[5:7, 5:7, 31:35].all(), way


@pytest.mark.parametrize("air", [0.0, 100.0])
@pytest.mark.parametrize("correlated", [0.0, 1.0])
@pytest.mark.parametrize("side", [4, 8])
def test_noise_about_one_small_thing_is_air(air: float, correlated: float, side: int) -> None:
    rng = np.random.default_rng(4)
    noise = gaussian_filter(rng.normal(size=(64,) * 3), correlated)
    thing = box((64,) * 3, (10, 20, 30), (10 + side, 20 + side, 30 + side))
    blurred = gaussian_filter(np.where(thing, 1200.0, 0.0), 0.6)
    volume = np.maximum(air + blurred + 15 * noise / noise.std(), 0).astype(np.float32)
    found = above_levels(volume, find_levels(volume))
    assert found[thing].all()
    # Its own blurred fringe is a voxel wide.
    assert found.sum() <= (side + 2) ** 3
    assert not is_noisy(volume)


def test_a_bag_full_of_light_and_dense_things_is_not_parted_into_these():
    # Otsu's two thresholds were both above most of its matter, and hardly any air was pure enough
    # to measure its spread.
    made = simulate_bag(seed=9944, shape=(64, 64, 88))
    foreground, _ = find_foreground(made.volume, made.spacing, "hysteresis")
    plain = (made.labels > 0) & (made.volume > 300)
    assert foreground[plain].mean() > 0.9
    assert foreground[made.labels == 0].mean() < 0.2
