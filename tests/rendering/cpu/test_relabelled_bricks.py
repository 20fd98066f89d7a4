"""Bricks after a repair are those of the new labels made from nothing."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unpack.geometry.boxes import differing_box
from napari_unpack.rendering.cpu import Bricks, relabelled


@pytest.mark.parametrize("seed", range(6))
def test_only_touched_bricks_are_made_anew_and_all_are_right(seed) -> None:
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(9, 40, 3))
    labels = np.kron(rng.integers(0, 5, (3, 4, 5)), np.ones((14, 10, 8), np.int64)).astype(
        np.uint16
    )
    labels = np.ascontiguousarray(labels[: shape[0], : shape[1], : shape[2]])
    volume = rng.integers(0, 4000, labels.shape).astype(np.uint16)
    after = labels.copy()
    low = rng.integers(0, np.array(labels.shape) - 3)
    box = tuple(slice(int(a), int(a) + int(rng.integers(1, 9))) for a in low)
    after[box] = rng.integers(0, 90, after[box].shape)
    found = differing_box(labels, after)
    assert found is not None
    bricks = relabelled(Bricks.of(labels, volume), after, found)
    wanted = Bricks.of(after, volume)
    for name in ("low", "high", "starts", "ids"):
        np.testing.assert_array_equal(getattr(bricks, name), getattr(wanted, name))


def test_the_differing_box_is_the_smallest() -> None:
    a = np.zeros((6, 7, 8), np.uint16)
    b = a.copy()
    assert differing_box(a, b) is None
    b[2, 3, 4] = b[4, 3, 1] = 1
    assert differing_box(a, b) == (slice(2, 5), slice(3, 4), slice(1, 5))
