"""A hard case: what all else lies in."""

import numpy as np

from napari_unpack.segmentation.foreground.bag_shell import find_case


def test_a_hard_case_is_found_by_what_lies_between_its_walls():
    labels = np.zeros((40, 60, 50), np.int32)
    labels[2:38, 2:58, 2:48] = 1
    labels[4:36, 4:56, 4:46] = 0
    for name, start in enumerate((8, 20, 32, 44), 2):
        labels[10:20, start : start + 8, 10:30] = name
    assert np.flatnonzero(find_case(labels)).tolist() == [1]
    # Two plates of it, as where a scan has cut off its sides, hold as much.
    plates = labels.copy()
    plates[4:36][labels[4:36] == 1] = 0
    assert np.flatnonzero(find_case(plates)).tolist() == [1]
    # One plate holds nothing, and nothing is a case around two things.
    plates[36:] = 0
    plates[0, 0, 0] = plates[-1, -1, -1] = 1
    assert not find_case(plates).any()
    assert not find_case(np.where(labels > 3, 0, labels)).any()


def test_a_box_full_of_things_of_which_one_is_as_long_is_no_case():
    labels = np.zeros((40, 60, 50), np.int32)
    for name, start in enumerate((0, 15, 30, 45), 1):
        labels[:20, start : start + 15] = name
    # A pole across the whole bag.
    for k in range(40):
        labels[k, int(1.5 * k) : int(1.5 * k) + 2, int(1.25 * k) : int(1.25 * k) + 2] = 9
    assert not find_case(labels).any()
