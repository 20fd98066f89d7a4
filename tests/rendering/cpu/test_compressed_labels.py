"""Labels of mixed bricks in few bits, unpacked here by hand."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unpack.rendering.cpu import Bricks


@pytest.mark.parametrize(("kinds", "words"), [(1, 0), (2, 8), (3, 16), (4, 16), (5, 32), (40, 128)])
def test_every_voxel_of_a_brick_comes_back_from_as_few_bits_as_it_needs(kinds, words) -> None:
    names = np.random.default_rng(kinds).permutation(60000)[:kinds]
    labels = names[np.random.default_rng(1).integers(0, kinds, (8, 8, 8))].astype(np.uint16)
    labels.ravel()[:kinds] = names
    packed = Bricks.of(labels).packed(labels)
    assert packed.words.size == words


def test_numbers_stand_for_the_ids_of_their_brick_at_the_volumes_edges_too() -> None:
    rng = np.random.default_rng(0)
    labels = rng.integers(0, 3, (13, 9, 21)).astype(np.uint16)
    labels[:8, :8, :8] = 7
    labels[8:, 8:, 16:] = rng.integers(0, 30, (5, 1, 5))
    bricks = Bricks.of(labels)
    packed = bricks.packed(labels)
    assert bricks.packed(labels) is packed
    whole = sum(int(w) << (64 * i) for i, w in enumerate(packed.words))
    rows, columns = 2, 3
    for z, y, x in np.ndindex(*labels.shape):
        brick = ((z // 8) * rows + y // 8) * columns + x // 8
        ids = bricks.ids[bricks.starts[brick] : bricks.starts[brick + 1]]
        if len(ids) == 1:
            assert ids[0] == labels[z, y, x]
            continue
        wide = 1 << int(packed.bits[brick])
        place = 64 * int(packed.first[brick]) + wide * (z % 8 * 64 + y % 8 * 8 + x % 8)
        assert ids[(whole >> place) & ((1 << wide) - 1)] == labels[z, y, x]


def test_bricks_of_two_objects_come_first_a_line_of_memory_each() -> None:
    labels = np.zeros((8, 8, 40), np.uint16)
    labels[3, 3, 8:16] = np.arange(8)
    labels[3, 3, 17] = labels[4, 4, 38] = 9
    packed = Bricks.of(labels).packed(labels)
    assert packed.pairs.tolist() == [2, 4]
    assert packed.number.tolist() == [-1, 2, 0, -1, 1]
    assert packed.first[packed.pairs].tolist() == [0, 8]
    assert packed.words.ctypes.data % 64 == 0
