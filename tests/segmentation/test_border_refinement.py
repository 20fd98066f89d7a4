import numpy as np
import pytest
from phantoms import ball, box, scanned

from napari_unpack.segmentation.learned.border_refinement import sharpen_borders

SHAPE = (20, 20, 40)
TWO = {1: 500.0, 2: 1500.0}


def side_by_side(border):
    labels = np.zeros(SHAPE, np.int32)
    labels[box(SHAPE, (4, 4, 4), (16, 16, border))] = 1
    labels[box(SHAPE, (4, 4, border), (16, 16, 36))] = 2
    return labels


def unsure(shape=SHAPE):
    return np.full((3, *shape), 128, np.uint8)


@pytest.mark.parametrize("border", [18, 22])
def test_a_border_moves_to_where_the_density_steps(border):
    found = side_by_side(border)
    given = found.copy()
    density = scanned(side_by_side(20), TWO)
    moved = sharpen_borders(found, density, 0.0, unsure(), 25.0)
    # An edge against air is too light to tell.
    inner = (slice(5, 15), slice(5, 15))
    np.testing.assert_array_equal(moved[inner], side_by_side(20)[inner])
    np.testing.assert_array_equal(found, given)


def test_half_way_is_of_the_density_not_of_its_logarithm():
    truth = side_by_side(20)
    density = scanned(truth, {1: 300.0, 2: 30000.0}, blur=1.0)
    moved = sharpen_borders(side_by_side(18), density, 0.0, unsure(), 25.0)
    inner = (slice(6, 14), slice(6, 14))
    np.testing.assert_array_equal(moved[inner], truth[inner])


def test_two_of_one_density_keep_their_border_where_the_network_says_nothing():
    found = side_by_side(18)
    density = scanned(found, {1: 800.0, 2: 800.0})
    np.testing.assert_array_equal(sharpen_borders(found, density, 0.0, unsure(), 25.0), found)


@pytest.mark.parametrize(("belongs", "goes"), [(0, True), (255, False)])
def test_the_network_decides_on_a_bump_between_two_of_one_density(belongs, goes):
    truth = side_by_side(20)
    density = scanned(truth, {1: 800.0, 2: 800.0})
    found = truth.copy()
    # Three voxels wide: a spike of one would be evened.
    found[9:12, 9:12, 18:20] = 2
    following = np.full((3, *SHAPE), 255 - belongs, np.uint8)
    following[2, 9:12, 9:12, 17] = 255 - belongs
    following[2, 9:12, 9:12, 18:20] = belongs
    following[0, 9:11, 9:12, 18:20] = following[1, 9:12, 9:11, 18:20] = belongs
    moved = sharpen_borders(found, density, 0.0, following, 25.0)
    assert (moved[10, 10, 19] == 1) == goes


def test_metal_loses_its_blur_to_the_background_and_nothing_else_does():
    shape = (24, 24, 48)
    metal, wax = ball(shape, (12, 12, 12), 6), ball(shape, (12, 12, 36), 6)
    truth = np.where(metal, 1, np.where(wax, 2, 0)).astype(np.int32)
    density = scanned(truth, {1: 20000.0, 2: 900.0}, blur=0.8)
    found = truth.copy()
    found[ball(shape, (12, 12, 12), 8)] = 1
    found[ball(shape, (12, 12, 36), 8)] = 2
    bare = sharpen_borders(found, density, 0.0, unsure(shape), 25.0, dense=4000.0)
    np.testing.assert_array_equal(bare == 2, found == 2)
    assert ((bare == 1) != metal).sum() < 0.1 * metal.sum()
    np.testing.assert_array_equal(sharpen_borders(found, density, 0.0, unsure(shape), 25.0), found)


def test_a_frayed_border_between_two_of_one_density_becomes_even_and_a_corner_stays():
    truth = side_by_side(20)
    frayed = truth.copy()
    doubtful = np.random.default_rng(0).random(SHAPE) < 0.35
    frayed[:, :, 19:21] = (
        np.where(doubtful, 3 - truth, truth)[:, :, 19:21] * (truth > 0)[:, :, 19:21]
    )
    density = scanned(truth, {1: 800.0, 2: 800.0})
    even = sharpen_borders(frayed, density, 0.0, unsure(), 25.0)
    assert (even != truth).sum() < 0.2 * (frayed != truth).sum()
    sunk = np.where(truth > 0, 1, 0).astype(np.int32)
    sunk[box(SHAPE, (8, 8, 10), (16, 16, 24))] = 2
    kept = sharpen_borders(sunk, density, 0.0, unsure(), 25.0)
    assert (kept != sunk).sum() < 0.05 * (sunk == 2).sum()
