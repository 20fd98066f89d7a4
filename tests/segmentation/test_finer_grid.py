"""When a finer grid is worth its time: told by what one box of the volume shows."""

import numpy as np
import pytest
from phantoms import box

from napari_unpack.segmentation import finer_grid as module
from napari_unpack.segmentation.common.array_source import source_of
from napari_unpack.segmentation.finer_grid import finer_grid
from napari_unpack.tasks import SILENT

MM = (1.0, 1.0, 1.0)
HALF = (2, 2, 2)


def cubes(shape, side, apart):
    """Return labels of cubes in rows."""
    labels = np.zeros(shape, np.int32)
    starts = [range(0, n - side + 1, apart) for n in shape]
    for name, at in enumerate(np.stack(np.meshgrid(*starts), -1).reshape(-1, 3), 1):
        labels[box(shape, at, at + side)] = name
    return labels


def answer(truth, labels, most=10**9):
    """Return what is said of labels on a grid of half the resolution, and the boxes looked at."""
    boxes = []

    def find(part, spacing, _):
        boxes.append(part.shape)
        assert spacing == MM
        return part

    return finer_grid(source_of(truth), MM, labels, HALF, find, most, SILENT), boxes


def test_large_objects_on_the_grid_are_never_looked_at_closer():
    truth = cubes((64, 128, 128), 60, 64)
    assert answer(truth, np.repeat(truth, 2, axis=0)) == (None, [])


def test_a_lump_of_small_things_wants_the_full_resolution():
    truth = cubes((96, 96, 96), 11, 12)
    lump = np.ones((48, 48, 48), np.int32)
    assert answer(truth, lump) == (96**3, [(96, 96, 96)])


def test_a_lump_of_larger_things_wants_no_more_cells_than_show_them():
    # Of 17,576 voxels: cells of eight would do, and of a fifth of each axis do not.
    truth = cubes((108, 108, 108), 26, 27)
    lump = np.ones((27, 27, 27), np.int32)
    finer = finer_grid(source_of(truth), MM, lump, (4, 4, 4), lambda p, *_: p, 10**9, SILENT)
    assert finer is not None
    assert 108**3 / 12 < finer <= 108**3 / 8


def test_small_things_that_the_grid_shows_are_left_to_it():
    truth = cubes((96, 96, 96), 22, 24)
    assert answer(truth, truth[::2, ::2, ::2])[0] is None
    # One object of all matter is as large in the box.
    one = np.ones((96, 96, 96), np.int32)
    assert answer(one, one[::2, ::2, ::2])[0] is None


def test_no_more_cells_than_there_is_room_for():
    truth = cubes((96, 96, 96), 11, 12)
    lump = np.ones((48, 48, 48), np.int32)
    assert answer(truth, lump, most=300_000)[0] == 300_000
    assert answer(truth, lump, most=48**3)[0] is None


def test_the_box_with_the_most_matter_is_looked_at(monkeypatch):
    monkeypatch.setattr(module, "SIDE", 24)
    truth = np.zeros((60, 60, 120), np.int32)
    truth[20:44, 30:54, 70:94] = cubes((24, 24, 24), 7, 8)
    lump = (truth[::2, ::2, ::2] > 0).astype(np.int32)
    finer, boxes = answer(truth, lump)
    assert finer == truth.size
    assert boxes == [(24, 24, 24)]


@pytest.mark.parametrize("words", ["volume is constant", "nothing found"])
def test_a_box_in_which_nothing_stands_out_changes_nothing(words):
    def find(*_):
        raise ValueError(words)

    volume = np.ones((40, 40, 40), np.int32)
    assert (
        finer_grid(source_of(volume), MM, volume[::2, ::2, ::2], HALF, find, 10**9, SILENT) is None
    )
