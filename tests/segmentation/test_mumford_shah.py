"""The piecewise-smooth foreground: shading, its energy, its exactness where it can be checked."""

import itertools

import numpy as np
import pytest
from phantoms import ball, box

from napari_unpack.segmentation.foreground.methods import find_foreground
from napari_unpack.segmentation.foreground.mumford_shah import (
    Weights,
    descend,
    energy,
    halved,
    least_boundary,
    mumford_shah,
    relax,
)
from napari_unpack.segmentation.foreground.thresholds import Levels

MM = (1.0, 1.0, 1.0)
TINY = (2, 2, 3)


def edges(shape):
    index = np.arange(np.prod(shape)).reshape(shape)
    for axis in range(3):
        one, two = np.moveaxis(index, axis, 0)[:-1], np.moveaxis(index, axis, 0)[1:]
        for i, j in zip(one.ravel(), two.ravel(), strict=True):
            yield axis, int(i), int(j)


def by_hand(data, foreground, inside, outside, weights):
    """Return the energy from its formula, edge by edge."""
    p, r, f, g = (np.asarray(a, float).ravel() for a in (data, foreground, inside, outside))
    total = np.nansum(r * (f - p) ** 2 + (1 - r) * (g - p) ** 2)
    for axis, i, j in edges(data.shape):
        both = r[i] + r[j]
        ours, theirs = 0.001 + 0.999 * both / 2, 0.001 + 0.999 * (2 - both) / 2
        mu = weights.smoothness * weights.squeeze[axis]
        total += mu * (ours * (f[i] - f[j]) ** 2 + theirs * (g[i] - g[j]) ** 2)
        total += weights.boundary * weights.faces[axis] * abs(r[i] - r[j])
    return total


def best_field(data, side, weights):
    """Return the field of least energy by solving its equations."""
    p, r = data.ravel().astype(float), side.ravel().astype(float)
    system, right = np.diag(r + 1e-9), r * p
    for axis, i, j in edges(data.shape):
        w = weights.smoothness * weights.squeeze[axis] * (0.001 + 0.999 * (r[i] + r[j]) / 2)
        system[i, i] += w
        system[j, j] += w
        system[i, j] -= w
        system[j, i] -= w
    return np.linalg.solve(system, right).reshape(data.shape)


def test_the_energy_is_what_its_formula_says():
    rng = np.random.default_rng(0)
    data, inside, outside = rng.normal(size=(3, 3, 4, 5)).astype(np.float32)
    data[1, 1, 1] = np.nan
    foreground = rng.random((3, 4, 5)) < 0.5
    weights = Weights(3.0, 0.2, (1.0, 0.5, 2.0), (1.0, 0.7, 1.3))
    expected = by_hand(data, foreground, inside, outside, weights)
    assert energy(data, foreground, inside, outside, weights) == pytest.approx(expected, rel=1e-5)


def test_relaxing_solves_the_fields_equations():
    rng = np.random.default_rng(1)
    data = rng.normal(1, 0.3, (4, 4, 5)).astype(np.float32)
    side = rng.random(data.shape) < 0.6
    weights = Weights(2.0, 0.1, (1.0, 0.5, 2.0))
    field = np.zeros_like(data)
    everywhere = np.ones_like(side)
    relax(data, side, field, weights, everywhere, close=0, sweeps=4000)
    np.testing.assert_allclose(field[side], best_field(data, side, weights)[side], atol=0.01)


@pytest.mark.parametrize("seed", range(6))
def test_the_binary_step_is_a_minimum_cut(seed):
    rng = np.random.default_rng(seed)
    cost = rng.normal(0, 0.3, TINY).astype(np.float32)
    price, faces = 0.15, (1.0, 0.6, 1.4)

    def total(choice):
        r = np.ravel(choice).astype(float)
        cut = sum(price * faces[a] * abs(r[i] - r[j]) for a, i, j in edges(TINY))
        return float(cost.ravel() @ r + cut)

    least = min(total(c) for c in itertools.product((0, 1), repeat=cost.size))
    start = rng.random(TINY) < 0.5
    everywhere = np.ones(TINY, bool)
    found = least_boundary(cost, start, price, faces, everywhere, rounds=2000, close=1e-5)
    assert total(found) == pytest.approx(least, abs=1e-5)


def test_a_tiny_graph_ends_in_the_least_of_all_its_energies():
    data = np.array([[[0.0, 0.1, 0.9], [0.1, 0.3, 1.1]], [[0.0, 0.8, 1.0], [0.2, 0.1, 1.2]]])
    data = data.astype(np.float32)
    weights = Weights(1.0, 0.1)
    least, best = np.inf, None
    for choice in itertools.product((False, True), repeat=12):
        foreground = np.array(choice).reshape(TINY)
        fields = (best_field(data, side, weights) for side in (foreground, ~foreground))
        value = by_hand(data, foreground, *fields, weights)
        if value < least:
            least, best = value, foreground
    start = data > 0.5
    fields = [np.full(TINY, data[side].mean(), np.float32) for side in (start, ~start)]
    found = descend(data, start, *fields, weights, np.ones(TINY, bool), 10)
    # Names of the two sides may be exchanged.
    assert (found == best).all() or (found == ~best).all()


def test_the_energy_never_rises():
    rng = np.random.default_rng(2)
    data = rng.normal(0, 0.4, (16, 18, 20)).astype(np.float32)
    data[4:12, 4:12, 4:14] += 1
    data[0, 0, 0] = np.nan
    foreground = rng.random(data.shape) < 0.5
    inside, outside = np.ones_like(data), np.zeros_like(data)
    weights, everywhere = Weights(9.0, 0.1), np.ones(data.shape, bool)
    before = energy(data, foreground, inside, outside, weights)
    for _ in range(8):
        foreground = descend(data, foreground, inside, outside, weights, everywhere, 1)
        after = energy(data, foreground, inside, outside, weights)
        assert after <= before * (1 + 1e-6)
        before = after
    assert (foreground[5:11, 5:11, 5:13]).mean() > 0.95


def shaded(seed=0):
    """Return matter in a light that rises along x by more than matter itself stands out."""
    shape = (40, 48, 120)
    truth = np.zeros(shape, bool)
    for x in (14, 44, 74, 104):
        truth |= ball(shape, (20, 16, x), 9)
        truth |= box(shape, (12, 30, x - 6), (28, 42, x + 6))
    light = np.linspace(0, 600, shape[2])
    noise = np.random.default_rng(seed).normal(0, 30, shape)
    return truth, truth * 400 + light + noise + 100


def overlap(one, other):
    return (one & other).sum() / (one | other).sum()


def test_in_rising_light_no_fixed_level_tells_matter_and_this_does():
    truth, volume = shaded()
    best = max(overlap(volume >= level, truth) for level in range(100, 1500, 20))
    assert best < 0.75
    found, _ = find_foreground(volume, MM, "mumford-shah")
    assert overlap(found, truth) > 0.9
    for way in ("hysteresis", "otsu"):
        assert overlap(find_foreground(volume, MM, way)[0], truth) < 0.7


def test_thin_sheets_that_coarse_grids_do_not_show_are_matter():
    volume = np.random.default_rng(0).normal(0, 10, (64, 72, 80))
    volume[8:56, 8:64, 8:40] += 1000
    volume[8:56, 20, 44:76] += 700
    found, _ = find_foreground(volume, MM, "mumford-shah")
    assert found[10:54, 20, 46:74].mean() > 0.98
    assert found[10:54, 22:60, 46:74].mean() < 0.01


def test_what_was_not_measured_is_no_matter_and_does_no_harm():
    truth, volume = shaded()
    broken = volume.copy()
    broken[:, :, 60:64] = np.nan
    broken[5, 5, 5] = np.inf
    found, _ = find_foreground(broken, MM, "mumford-shah")
    kept = np.isfinite(broken)
    assert not found[~kept].any()
    assert overlap(found & kept, truth & kept) > 0.88


def test_voxels_that_are_not_cubes_and_axes_of_one_voxel():
    truth, volume = shaded()
    thick = volume.reshape(10, 4, *volume.shape[1:]).mean(axis=1)
    found, _ = find_foreground(thick, (4.0, 1.0, 1.0), "mumford-shah")
    filled = truth.reshape(10, 4, *truth.shape[1:]).mean(axis=1) > 0.5
    assert overlap(found, filled) > 0.75
    flat, _ = find_foreground(volume[20:21], MM, "mumford-shah")
    assert flat.shape == (1, 48, 120)


def test_halving_averages_pairs_along_the_finer_axes():
    data = np.arange(4 * 6 * 5, dtype=np.float32).reshape(4, 6, 5)
    data[0, 0, 1] = np.nan
    small, size = halved(data, (3.0, 1.0, 1.0))
    assert size == (3.0, 2.0, 2.0)
    assert small.shape == (4, 3, 3)
    assert small[1, 1, 1] == data[1, 2:4, 2:4].mean()
    assert small[1, 1, 2] == data[1, 2:4, 4].mean()
    assert np.isfinite(small).all()


def test_cloth_is_matter_and_so_is_steel_but_for_cloth_within_the_fields_reach_of_steel():
    volume = np.random.default_rng(0).normal(0, 8, (40, 40, 60))
    volume[8:32, 8:32, 8:30] += 250
    volume[8:32, 8:32, 30:50] += 8000
    mask = mumford_shah(volume, Levels(0, 8, 70, 110), MM)
    assert mask[9:31, 9:31, 9:20].mean() > 0.99
    assert mask[9:31, 9:31, 31:49].all()
    assert mask[9:31, 9:31, 20:30].mean() > 0.8
