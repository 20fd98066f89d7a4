import numpy as np
import pytest
from phantoms import packed, scanned, two_balls
from real_scans import real_scan
from scipy.ndimage import gaussian_filter

from napari_unpack.segmentation import score, segment
from napari_unpack.segmentation.common.region import default_smallest_object
from napari_unpack.segmentation.foreground.denoising import (
    grow_to_half_height,
    is_noisy,
    without_noise_and_haze,
)

MM = (1.0, 1.0, 1.0)


def nuclei(seed, noise_deviation, shape=(48, 80, 80), count=22):
    """Return true labels and a picture: ellipsoids stained unequally, in haze, by few photons."""
    rng = np.random.default_rng(seed)
    labels = np.zeros(shape, np.int32)
    light = np.zeros(shape)
    grid = np.indices(shape, dtype=np.float32)
    while labels.max() < count:
        center, radii = rng.uniform(0, shape), rng.uniform(6, 10, 3)
        squared = sum(((g - c) / r) ** 2 for g, c, r in zip(grid, center, radii, strict=True))
        inside = squared <= 1
        if labels[inside].any():
            continue
        labels[inside] = labels.max() + 1
        light[inside] = rng.uniform(0.7, 1.5)
    light = gaussian_filter(light, 1.0) + 0.3 * np.linspace(0.3, 1.3, shape[2])
    photons = rng.poisson(light / noise_deviation**2) * noise_deviation**2
    return labels, np.clip(60 * photons, 0, 255).astype(np.uint8)


def test_scans_are_not_grainy_and_nuclei_of_few_photons_are():
    labels, densities = packed(3, (64, 64, 64), 6, 12)
    assert not is_noisy(scanned(labels, densities))
    assert not is_noisy(scanned(two_balls(), {1: 1000, 2: 1000}))
    assert not is_noisy(nuclei(0, 0.1)[1])
    assert is_noisy(nuclei(0, 0.5)[1])


def test_a_volume_of_white_noise_is_grainy_in_any_unit_and_an_even_one_is_not():
    noise = np.random.default_rng(0).exponential(1, (24, 24, 24))
    for factor in (1e-6, 1.0, 1e6):
        assert is_noisy((factor * noise).astype(np.float32))
    assert not is_noisy(np.ones((8, 8, 8)))
    assert not is_noisy(np.full((8, 8, 8), np.nan))
    assert not is_noisy(np.arange(8.0).reshape(2, 2, 2))


def test_the_correlation_of_neighbours_tells_noise_from_signal():
    # Between neighbours it is s / (n + s); here n rises from s / 4 to 4 s.
    smooth = gaussian_filter(np.random.default_rng(1).normal(size=(48, 48, 48)), 4)
    smooth = 20 + 3 * smooth / smooth.std()
    noise = np.random.default_rng(2).normal(size=smooth.shape)
    assert not is_noisy(smooth + 1.5 * noise)
    assert is_noisy(smooth + 6 * noise)


def test_haze_goes_and_what_is_small_stays():
    shape = (40, 60, 60)
    haze = 1000 + np.broadcast_to(np.arange(60.0), shape)
    ball = sum((g - c) ** 2 for g, c in zip(np.indices(shape), (20, 30, 30), strict=True)) <= 36
    clear = without_noise_and_haze(haze + 50.0 * ball, MM)
    assert clear[20, 30, 30] > 30
    # At its ends a slope cannot be told from a thing.
    inner = (slice(None), slice(None), slice(15, 45))
    assert clear[inner][~ball[inner]].max() < 20
    # A constant more is haze.
    np.testing.assert_allclose(
        without_noise_and_haze(haze + 50.0 * ball + 1000, MM), clear, atol=0.1
    )


def test_voxels_that_are_not_cubes_are_smoothed_over_the_same_millimetres():
    points = np.zeros((9, 41, 41), np.float32)
    points[4, 20, 20] = 1000
    clear = without_noise_and_haze(points, (4.0, 1.0, 1.0))
    assert clear[4, 20, 22] > 20 * clear[5, 20, 20]


def test_borders_go_to_half_height():
    shape = (30, 30, 60)
    grid = np.indices(shape)
    balls = np.zeros(shape, np.int32)
    for name, x in enumerate((15, 43), 1):
        balls[np.hypot(np.hypot(grid[0] - 15, grid[1] - 15), grid[2] - x) <= 9] = name
    light = gaussian_filter(np.array([0.0, 100.0, 300.0])[balls], 1.5) + 40
    # One level for both is too high for the one or too low for the other.
    for level in (60, 110):
        wrong = np.where(light > level, 1 + (grid[2] > 29), 0).astype(np.int32)
        found = grow_to_half_height(wrong, light, MM)
        before, after = (_overlaps(balls, each) for each in (wrong, found))
        assert min(after) > 0.65
        assert sum(after) > sum(before) + 0.1


def _overlaps(truth, found):
    return [
        ((truth == k) & (found == k)).sum() / ((truth == k) | (found == k)).sum() for k in (1, 2)
    ]


@pytest.mark.parametrize("noise_deviation", [0.4, 0.8])
def test_nuclei_are_found_in_noise_as_they_are_found_without(noise_deviation):
    labels, picture = nuclei(1, noise_deviation)
    found = score(labels, segment(picture).labels)
    assert found["f1"] > 0.9
    assert found["f1_75"] > 0.8


def test_noise_alone_is_nothing_or_little():
    noise = np.random.default_rng(0).exponential(40, (48, 64, 64)).astype(np.float32)
    try:
        found = segment(noise)
    except ValueError:
        return
    assert (found.labels > 0).mean() < 0.5


def test_without_millimetres_the_smallest_object_is_counted_in_voxels():
    _, picture = nuclei(1, 0.5)
    one = segment(picture, MM).labels
    other = segment(picture, (1e-4, 1e-4, 1e-4)).labels
    np.testing.assert_array_equal(one, other)


def test_the_nuclei_of_a_real_plant():
    scan = real_scan("cells")
    spacing = tuple(float(s) for s in scan["spacing"])
    found = score(scan["labels"], segment(scan["volume"], spacing).labels)
    # A watershed in the same foreground has 0.49 at best.
    assert found["f1"] > 0.78


@pytest.mark.parametrize(
    ("shape", "spacing", "wanted"),
    [
        ((160, 176, 256), (1.0, 1.0, 1.0), 500.0),
        # A small volume of mm: never more than of a bag, however large its voxels are.
        ((48, 48, 48), (2.0, 1.0, 1.0), 500.0),
        ((48, 48, 48), (0.5, 0.5, 0.5), 500 / 8),
        ((60, 256, 256), (0.3e-3, 0.26e-3, 0.26e-3), 500 * 0.3e-3 * 0.26e-3**2),
    ],
)
def test_what_is_too_small_for_an_object(
    shape: tuple[int, int, int], spacing: tuple[float, float, float], wanted: float
) -> None:
    assert default_smallest_object(shape, spacing) == pytest.approx(wanted)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("contrast", [0, 1, 3])
def test_what_hardly_stands_above_its_noise_is_noisy(seed: int, contrast: int) -> None:
    rng = np.random.default_rng(seed)
    noise, shapes = rng.normal(size=(48,) * 3), gaussian_filter(rng.normal(size=(48,) * 3), 4)
    things = shapes > np.quantile(shapes, 0.9)
    assert is_noisy(1000 * (noise + contrast * things) + 5000)
