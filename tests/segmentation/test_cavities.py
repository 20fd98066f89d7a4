"""Air inside objects, gaps in their walls, and what hangs in them."""

import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.postprocessing.cavities import fill_cavities, join_suspended

EVEN = (1.0, 1.0, 1.0)


def hollow_box(grid: int = 30, low: int = 5, high: int = 25) -> NDArray[np.int32]:
    """Return a box with walls of two voxels, in air."""
    labels = np.zeros((grid,) * 3, np.int32)
    labels[(slice(low, high),) * 3] = 1
    labels[(slice(low + 2, high - 2),) * 3] = 0
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
    filled = fill_cavities(labels, EVEN, labels > 0)
    assert (filled[8:23, 7:23, 7:23] == 1).all()
    assert not filled[:5].any()
    labels[5:7, 10:20, 11:18] = 0
    assert not fill_cavities(labels, EVEN, labels > 0)[7:23, 7:23, 7:23].any()


def test_a_wall_that_is_seen_and_no_objects_encloses_air_and_goes_to_its_box():
    labels = hollow_box()
    seen = labels > 0
    labels[5:7, 5:25, 5:25] = 0
    assert not fill_cavities(labels, EVEN)[7:23, 7:23, 7:23].any()
    assert (fill_cavities(labels, EVEN, seen)[5:25, 5:25, 5:25] == 1).all()
    # Without a wall nothing is given; nor is the air of a bag, whose skin is no object.
    assert np.array_equal(fill_cavities(labels, EVEN, labels > 0), labels)
    bag = np.zeros_like(seen)
    bag[2:28, 2:28, 2:28] = True
    bag[4:26, 4:26, 4:26] = False
    boxed = np.where(seen, 1, 0).astype(np.int32)
    assert not fill_cavities(boxed, EVEN, bag)[2:5].any()


def test_the_air_between_things_in_a_box_is_not_the_boxs():
    labels = hollow_box(44, 3, 41)
    # Three things close on air, of which none makes up half of the walls.
    labels[20:34, 14:28, 14:28] = 2
    labels[20:34, 14:28, 14:18] = 3
    labels[20:34, 14:18, 14:28] = 4
    labels[24:30, 18:24, 18:24] = 0
    labels[20:24, 14:28, 14:28] = 3
    labels[30:34, 14:28, 14:28] = 4
    seen = labels > 0
    labels[3:5] = 0
    filled = fill_cavities(labels, EVEN, seen)
    assert (filled[6:19, 6:38, 6:38] == 1).all()
    assert not filled[24:30, 18:24, 18:24].any()


def test_a_rough_wall_is_no_leaky_one():
    rng = np.random.default_rng(0)
    labels = np.zeros((40, 40, 40), np.int32)
    labels[5:35, 5:35, 5:35] = 1
    labels[9:31, 9:31, 9:31] = 0
    # Pits on the inner side, and one narrow gap.
    labels[7:9, 9:31, 9:31] = rng.random((2, 22, 22)) < 0.5
    labels[5:9, 15:25, 20:22] = 0
    filled = fill_cavities(labels, EVEN, labels > 0)
    assert (filled[9:31, 9:31, 9:31] == 1).all()
    # All but what lies under the gap.
    assert not (filled[7:9, 9:31, 9:14] == 0).any()


def test_a_narrow_gap_between_two_boxes_is_no_cavity():
    labels = np.zeros((30, 30, 30), np.int32)
    labels[5:25, 5:25, 5:13] = 1
    labels[5:25, 5:25, 17:25] = 2
    assert np.array_equal(fill_cavities(labels, EVEN, labels > 0), labels)


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


def test_a_chamber_that_another_has_taken_in_is_filled_once():
    # Two chambers of one box, with a passage of one voxel between them; the box lacks a side.
    labels = hollow_box(44, 2, 42) | hollow_box(44, 12, 32)
    labels[20, 20, 30:32] = 0
    wall = labels > 0
    labels[2:42, 2:42, 40:42] = 0
    filled = fill_cavities(labels, EVEN, wall)
    assert (filled[2:42, 2:42, 2:42] == 1).all()
