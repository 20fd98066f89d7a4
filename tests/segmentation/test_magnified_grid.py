"""Cells between the voxels: where they are made, and what comes back of them."""

import numpy as np
import pytest
from phantoms import ball, box

from napari_unpack.segmentation.common.density_regions import DensityScale
from napari_unpack.segmentation.common.joins import Level, Seen, Steps
from napari_unpack.segmentation.foreground.thresholds import NothingFoundError
from napari_unpack.segmentation.magnified_grid import (
    at_voxels,
    find_magnified,
    magnified,
    typical_depth,
)
from napari_unpack.tasks import Share


def found(volume, spacing=(1.0, 1.0, 1.0), most=10**6):
    """Return labels, steps, the grids that were looked at, and what was told of the progress."""
    looked, told, noted = [], [], Steps()

    def find(density, spacing, share, *, noted):
        looked.append((density.shape, tuple(round(s, 3) for s in spacing)))
        share(0.5)
        labels = np.rint(density).astype(np.int32)
        noted.levels.append(Level(labels + 10, [], {}))
        noted.seen = Seen(density, DensityScale(0.0, 1.0), labels.astype(np.uint8))
        return labels

    share = Share(lambda done, _: told.append(done))
    return find_magnified(volume, spacing, find, share, noted, most), noted, looked, told


def test_voxels_are_cells_and_what_is_between_lies_on_a_line():
    volume = np.random.default_rng(0).integers(0, 900, (5, 4, 1)).astype(np.uint16)
    cells = magnified(volume, (3, 2, 2))
    assert cells.shape == (13, 7, 1)
    np.testing.assert_array_equal(at_voxels(cells, (3, 2, 2)), volume)
    z = np.interp(np.arange(13) / 3, np.arange(5), volume[:, 2, 0])
    # A thousandth of a step aside.
    np.testing.assert_allclose(cells[:, 4, 0], z, atol=1.0)
    assert magnified(volume, (1, 1, 1)) is volume


def test_a_level_half_way_between_air_and_matter_is_passed_on_one_side():
    volume = np.array([0, 700, 0], np.uint16).reshape(1, 1, 3)
    rising, falling = magnified(volume, (1, 1, 2))[0, 0, 1::2]
    assert rising < 350 < falling


def test_large_things_in_cubes_are_looked_at_as_they_are():
    volume = np.zeros((24, 24, 24), np.float32)
    volume[box(volume.shape, (2, 2, 2), (20, 20, 20))] = 1
    labels, _, looked, told = found(volume)
    assert looked == [((24, 24, 24), (1.0, 1.0, 1.0))]
    np.testing.assert_array_equal(labels, volume)
    assert told == sorted(told)


def test_thick_slices_become_cubes_and_labels_and_steps_are_of_the_slices():
    volume = np.zeros((8, 24, 24), np.float32)
    volume[box(volume.shape, (1, 2, 2), (7, 20, 20))] = 1
    labels, noted, looked, _ = found(volume, (2.9, 1.0, 1.1))
    assert looked == [((22, 24, 24), (0.967, 1.0, 1.1))]
    np.testing.assert_array_equal(labels, volume)
    np.testing.assert_array_equal(noted.levels[0].names, volume + 10)
    np.testing.assert_array_equal(noted.seen.density, volume)
    assert noted.seen.matter.shape == volume.shape


def test_thin_things_are_looked_at_twice_where_there_is_room():
    volume = np.zeros((20, 20, 20), np.float32)
    volume[ball(volume.shape, (5, 5, 5), 4)] = 2
    volume[ball(volume.shape, (13, 13, 13), 5)] = 5
    labels, noted, looked, told = found(volume)
    assert looked == [((20, 20, 20), (1.0, 1.0, 1.0)), ((39, 39, 39), (0.5, 0.5, 0.5))]
    # The largest is the first, of no fewer voxels than it had.
    assert labels[13, 13, 13] == 1
    np.testing.assert_array_equal(labels[volume == 5], 1)
    # Steps of the second look alone.
    assert len(noted.levels) == 1
    assert told == sorted(told)
    # As many cells as there may be are for what would be lost.
    assert len(found(volume, most=2 * 39**3 - 1)[2]) == 2
    assert len(found(volume, most=39**3 - 1)[2]) == 1
    volume[ball(volume.shape, (5, 5, 5), 6)] = 2
    assert len(found(volume, most=2 * 39**3)[2]) == 2
    assert len(found(volume, most=2 * 39**3 - 1)[2]) == 1


def test_where_there_is_no_room_for_cubes_slices_are_divided_as_often_as_there_is():
    volume = np.zeros((10, 20, 20), np.float32)
    volume[ball(volume.shape, (5, 9, 9), 5)] = 1
    for most, planes in ((46 * 400, 46), (10_000, 19), (3000, 10)):
        assert found(volume, (5.0, 1.0, 1.0), most)[2][0][0] == (planes, 20, 20)


def test_things_that_no_voxel_shows_are_nothing():
    def between(density, spacing, share, *, noted):
        labels = np.ones(density.shape, np.int32)
        labels[::3] = 0
        return labels

    share, volume = Share(lambda *_: None), np.ones((4, 20, 20))
    with pytest.raises(NothingFoundError, match="thinner than a voxel"):
        find_magnified(volume, (3.0, 1.0, 1.0), between, share, Steps(), 5000)


def test_the_depth_of_the_median_object():
    labels = np.zeros((30, 40, 40), np.int32)
    for name, side in enumerate((5, 9, 17), 1):
        at = 12 * (name - 1)
        labels[box(labels.shape, (2, at, at), (2 + side, at + side, at + side))] = name
    assert typical_depth(labels) == pytest.approx(5)
    # What goes on beyond the volume is not thin.
    assert typical_depth(labels[8:9]) > 5


def test_a_single_plane_stays_one_and_specks_that_are_none_on_closer_sight_are_kept():
    volume = np.zeros((1, 20, 20), np.float32)
    volume[0, 3:9, 3:9] = 1
    labels, _, looked, _ = found(volume, (9.0, 1.0, 2.0))
    assert looked == [((1, 20, 39), (9.0, 1.0, 1.0)), ((1, 39, 77), (9.0, 0.5, 0.5))]
    np.testing.assert_array_equal(labels, volume)

    def first_alone(density, spacing, share, *, noted):
        if density.shape[1] > 20:
            raise NothingFoundError("nothing")
        return volume.astype(np.int32)

    share = Share(lambda *_: None)
    labels = find_magnified(volume, (1.0, 1.0, 1.0), first_alone, share, Steps())
    np.testing.assert_array_equal(labels, volume)
