"""Air inside objects, gaps in their walls, and what hangs in them."""

import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.postprocessing.cavities import fill_cavities, join_suspended

EVEN = (1.0, 1.0, 1.0)


def hollow_box() -> NDArray[np.int32]:
    """Return a box of 20 voxels with walls of two, in air."""
    labels = np.zeros((30, 30, 30), np.int32)
    labels[5:25, 5:25, 5:25] = 1
    labels[7:23, 7:23, 7:23] = 0
    return labels


def test_air_belongs_to_what_makes_up_nearly_half_of_its_walls_and_to_nobody_else():
    labels = np.zeros((20, 20, 20), np.int32)
    labels[2:18, 2:18, 2:18] = 1
    labels[6:14, 6:14, 6:14] = 0
    labels[2:18, 2:18, 14:18] = 2
    # One of six walls is the other's.
    assert (fill_cavities(labels, (1.0, 1.0, 1.0))[6:14, 6:14, 6:14] == 1).all()
    for name, walls in enumerate(
        [np.s_[:, :, 2:6], np.s_[:, 2:6, :], np.s_[:, 14:18, :], np.s_[2:6], np.s_[14:18]], 3
    ):
        labels[walls] = np.where(labels[walls] > 0, name, 0)
    assert not fill_cavities(labels, (1.0, 1.0, 1.0))[6:14, 6:14, 6:14].any()


def test_a_wall_with_narrow_gaps_keeps_its_air_and_one_with_a_window_does_not():
    labels = hollow_box()
    labels[5:7, 10:20, 14:16] = 0
    assert not fill_cavities(labels, EVEN)[7:23, 7:23, 7:23].any()
    filled = fill_cavities(labels, EVEN, leaky=True)
    assert (filled[8:23, 7:23, 7:23] == 1).all()
    assert not filled[:5].any()
    labels[5:7, 10:20, 11:18] = 0
    assert not fill_cavities(labels, EVEN, leaky=True)[7:23, 7:23, 7:23].any()


def test_a_narrow_gap_between_two_boxes_is_no_cavity():
    labels = np.zeros((30, 30, 30), np.int32)
    labels[5:25, 5:25, 5:13] = 1
    labels[5:25, 5:25, 17:25] = 2
    assert np.array_equal(fill_cavities(labels, EVEN, leaky=True), labels)


def test_what_hangs_in_a_box_is_part_of_it_and_what_lies_on_its_floor_is_not():
    labels = hollow_box()
    labels[12:18, 12:18, 12:18] = 2
    filled = fill_cavities(labels, EVEN)
    assert (join_suspended(labels, filled, EVEN)[5:25, 5:25, 5:25] == 1).all()
    # Lower by five voxels it lies on the floor: a sixth of its surface.
    labels = hollow_box()
    labels[17:23, 12:18, 12:18] = 2
    lying = join_suspended(labels, fill_cavities(labels, EVEN), EVEN)
    assert (lying == 2).sum() == 6**3


def test_what_lies_beside_a_box_does_not_hang_in_it():
    labels = hollow_box()
    labels[12:18, 12:18, 27:29] = 2
    filled = fill_cavities(labels, EVEN)
    assert np.array_equal(join_suspended(labels, filled, EVEN), filled)
