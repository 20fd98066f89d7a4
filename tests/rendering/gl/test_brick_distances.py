"""Distances over empty bricks: never too far, and not worked out when they need not be."""

import numpy as np
import pytest

from napari_unpack.rendering.gl.uniforms import Leaps, brick_distances


def nearest(occupied, brick):
    """Chessboard distance to the nearest brick of the other kind, signed, by looking at all."""
    others = np.argwhere(occupied != occupied[brick])
    if not len(others):
        return -127 if occupied[brick] else 127
    distance = np.abs(others - np.array(brick)).max(axis=1).min()
    return -distance if occupied[brick] else distance


@pytest.mark.parametrize("seed", range(6))
def test_no_leap_passes_a_brick_of_the_other_kind(seed):
    rng = np.random.default_rng(seed)
    occupied = np.zeros((7, 9, 8), bool)
    low = rng.integers(0, 4, 3)
    box = tuple(slice(a, a + n) for a, n in zip(low, rng.integers(1, 6, 3), strict=True))
    occupied[box] = rng.random(occupied[box].shape) < (0.2, 0.8, 1.0)[seed % 3]
    found = brick_distances(occupied).astype(int) - 128
    rows = [np.flatnonzero(occupied.any(axis=a)) for a in ((1, 2), (0, 2), (0, 1))]
    for brick in np.ndindex(*occupied.shape):
        exact = nearest(occupied, brick)
        inside = all(r[0] <= i <= r[-1] for r, i in zip(rows, brick, strict=True) if len(r))
        if inside or occupied[brick]:
            assert found[brick] == exact
        else:
            assert 1 <= found[brick] <= exact


def test_nothing_and_everything_occupied():
    assert (brick_distances(np.zeros((2, 3, 4), bool)) == 255).all()
    assert (brick_distances(np.ones((2, 3, 4), bool)) == 1).all()


def test_hiding_an_object_sends_no_distances_and_showing_one_does(gl):
    leaps, bag = Leaps(), np.ones((6, 6, 6), bool)
    leaps.uniforms(bag)
    fewer = bag.copy()
    fewer[0, :3, :4] = False
    leaps.uniforms(fewer)
    assert leaps.uploads == 1
    leaps.uniforms(bag)
    assert leaps.uploads == 1
    # More than an eighth is empty now: leaping pays.
    fewer[:2] = False
    leaps.uniforms(fewer)
    assert leaps.uploads == 2
    leaps.uniforms(bag)
    assert leaps.uploads == 3
