import numpy as np
import pytest

from napari_unpack.simulation import Scanner
from napari_unpack.simulation.streaks import add_streaks

QUIET = {"noise": 0.0, "streaks": 0.0}


def test_the_point_spread_is_as_wide_as_it_says():
    # A plane one voxel thick spreads as exp(-x^2 / 2 s^2), s = FWHM / 2.3548: two voxels off
    # it measures exp(-2 / s^2) of its peak.
    density = np.zeros((21, 21, 21), np.float32)
    density[10] = 10000
    volume = Scanner(blur=2.0, **QUIET).scan(density, np.random.default_rng(0)).astype(float)
    sigma = 2.0 / 2.3548
    assert volume[12, 10, 10] / volume[10, 10, 10] == pytest.approx(np.exp(-2 / sigma**2), abs=0.01)
    assert volume[:, 10, 10].sum() == pytest.approx(10000, rel=0.001)


@pytest.mark.parametrize("blur", [0.0, 1.3, 2.0])
def test_the_noise_is_as_strong_as_it_says_whatever_the_blur(blur):
    density = np.full((32, 32, 32), 1000, np.float32)
    volume = Scanner(blur=blur, noise=20.0, streaks=0).scan(density, np.random.default_rng(0))
    inner = volume[4:-4, 4:-4, 4:-4].astype(float)
    assert inner.std() == pytest.approx(20.0, rel=0.08)
    assert inner.mean() == pytest.approx(1000, abs=2)


def test_the_noise_is_correlated_as_the_point_spread_makes_it():
    density = np.full((32, 32, 32), 1000, np.float32)
    volume = Scanner(blur=2.0, noise=20.0, streaks=0).scan(density, np.random.default_rng(0))
    v = volume[4:-4, 4:-4, 4:-4].astype(float) - 1000
    neighbours = (v[:, :, 1:] * v[:, :, :-1]).mean() / v.var()
    assert 0.5 < neighbours < 0.85


def test_a_scan_without_blur_and_noise_only_rounds_and_clips():
    density = np.array([[[-5.0, 0.4, 1000.6, 50000.0]]], np.float32)
    volume = Scanner(blur=0.0, **QUIET).scan(density, np.random.default_rng(0))
    assert volume.ravel().tolist() == [0, 0, 1001, 32000]


def test_two_rods_of_metal_cast_a_dark_band_between_them():
    density = np.full((1, 80, 80), 1000, np.float32)
    density[0, 36:44, 15:21] = density[0, 36:44, 59:65] = 32000
    add_streaks(density, 70.0, 0.0, np.random.default_rng(0))
    between, beside = density[0, 38:42, 36:44].mean(), density[0, 10:20, 36:44].mean()
    assert between < 985
    assert between < beside - 15
    assert (density[0, 37:43, 16:20] == 32000).all()


def test_without_metal_there_are_no_streaks():
    density = np.full((2, 20, 20), 3000, np.float32)
    add_streaks(density, 70.0, 0.5, np.random.default_rng(0))
    assert (density == 3000).all()


def test_streaks_stay_in_the_slices_of_the_metal():
    density = np.full((8, 41, 43), 1000, np.float32)
    density[2:4, 18:24, 18:24] = 32000
    add_streaks(density, 70.0, 0.0, np.random.default_rng(0))
    assert (density[[0, 1, 4, 5, 6, 7]] == 1000).all()
    assert np.ptp(density[2, :10]) > 1


@pytest.mark.parametrize("name", ["blur", "noise", "streaks", "starvation"])
@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_a_bad_setting_is_named(name, value):
    with pytest.raises(ValueError, match=name):
        Scanner(**{name: value})
