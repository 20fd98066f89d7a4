"""What a carton's wall has and a scanner's table has not."""

import numpy as np

from napari_unpack.segmentation.foreground.scanner_table import find_supports


def _wall(ends: int) -> np.ndarray:
    # A wall 4 mm thick and 240 mm wide, under a heap 100 mm deep; `ends` slices stay free.
    matter = np.zeros((100, 80, 140), np.bool_)
    matter[ends : 100 - ends, 60:62, 10:130] = True
    matter[20:80, 20:58, 40:100] = True
    return matter


def test_a_wall_that_ends_inside_the_scan_is_no_support() -> None:
    assert not find_supports(_wall(ends=6), (2.0, 2.0, 2.0)).any()


def test_the_same_wall_run_through_the_whole_scan_is_one() -> None:
    found = find_supports(_wall(ends=0), (2.0, 2.0, 2.0))
    assert found[:, 60:62, 20:120].all()
    assert not found[20:80, 20:55, 40:100].any()
