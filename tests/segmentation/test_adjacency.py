import tracemalloc

import numpy as np
import pytest

from napari_unpack.segmentation.common.adjacency import find_neighbours
from napari_unpack.segmentation.common.merging import absorb_fringes, absorb_small, root, roots

MM = (1.0, 1.0, 1.0)


@pytest.mark.parametrize("spacing", [MM, (3.0, 1.0, 0.5)])
def test_contacts_are_those_that_counting_every_face_gives(spacing):
    labels = np.random.default_rng(0).integers(0, 9, (5, 6, 7)).astype(np.int32)
    faces = np.prod(spacing) / np.array(spacing)
    padded = np.pad(labels, 1)
    area = np.zeros((9, 9))
    for place in np.ndindex(*padded.shape):
        for axis in range(3):
            following = tuple(np.add(place, np.eye(3, dtype=int)[axis]))
            if following[axis] < padded.shape[axis]:
                one, two = padded[place], padded[following]
                if one != two:
                    area[one, two] += faces[axis]
                    area[two, one] += faces[axis]
    found = find_neighbours(labels, spacing)
    np.testing.assert_allclose(found.surface[1:], area[1:].sum(axis=1))
    np.testing.assert_array_equal(found.voxels[1:], np.bincount(labels.reshape(-1))[1:])
    for name in range(1, 9):
        touched = slice(*found.start[name : name + 2])
        row = area[name].copy()
        row[0] = 0
        np.testing.assert_array_equal(found.other[touched], np.flatnonzero(row))
        np.testing.assert_allclose(found.area[touched], row[row > 0])
        assert found.most_touched()[name] == row.argmax()


def test_a_label_alone_touches_nobody():
    labels = np.zeros((3, 3, 3), np.int32)
    labels[1, 1, 1] = 4
    found = find_neighbours(labels, MM)
    assert not found.other.size
    assert found.surface[4] == 6
    assert not found.most_touched().any()
    assert not find_neighbours(np.zeros((2, 2, 2), np.int32), MM).other.size


def test_a_hundred_thousand_specks_take_no_more_memory_than_voxels_do():
    # A table of every speck against every other would be of 97 GB.
    specks = np.zeros((96, 96, 96), np.int32)
    specks[::2, ::2, ::2] = np.arange(1, 48**3 + 1).reshape(48, 48, 48)
    tracemalloc.start()
    assert not absorb_small(specks, MM, 2.0).any()
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 500 * 48**3


def test_a_lace_of_voxels_joins_what_it_lies_on_and_a_sheet_does_not():
    labels = np.zeros((12, 20, 20), np.int32)
    labels[2:8] = 1
    lace = np.indices((20, 20)).sum(axis=0) % 2 == 0
    labels[8][lace] = 2
    labels[1] = 3
    density = np.array([0, 1000, 600, 600])[labels]
    found = absorb_fringes(labels, density, (1.0, 1.0, 1.0))
    assert (found[8][lace] == 1).all()
    assert (found[1] == 3).all()
    denser = np.array([0, 1000, 1600, 600])[labels]
    np.testing.assert_array_equal(absorb_fringes(labels, denser, (1.0, 1.0, 1.0)), labels)


def test_who_owns_a_part_in_the_end_is_found_along_the_chain():
    # 4 is of 3, that of 1, that of 0; 2 and 5 are their own.
    owner = np.array([0, 0, 2, 1, 3, 5])
    assert roots(owner).tolist() == [0, 0, 2, 0, 0, 5]
    assert [root(owner, k) for k in range(6)] == [0, 0, 2, 0, 0, 5]
