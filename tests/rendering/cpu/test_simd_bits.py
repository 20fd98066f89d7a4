"""Eight samples of a brick of two objects, looked up together, against one by one."""

from __future__ import annotations

import numpy as np
from numba import njit

from napari_unpack.rendering.cpu.simd import eight_bits, ones_of


@njit
def look_up(words, place, k, step, origin, slope):
    return eight_bits(
        words, np.uint64(place), k, step, origin[0], origin[1], origin[2],
        slope[0], slope[1], slope[2],
    )  # fmt: skip


@njit
def count(bits):
    return ones_of(bits)


def test_every_sample_finds_the_bit_of_its_voxel() -> None:
    rng = np.random.default_rng(0)
    brick = rng.random((8, 8, 8)) < 0.5
    words = np.zeros(16, np.uint64)
    for z, y, x in np.argwhere(brick):
        words[8 + z] |= np.uint64(1) << np.uint64(8 * y + x)
    for _ in range(50):
        slope = rng.uniform(-0.4, 0.4, 3)
        # The brick's middle, and the fourth of eight samples there; the brick lies at (16, 8, 24).
        k, step = float(rng.integers(-30, 30)), rng.uniform(0.4, 0.9)
        origin = np.array([19.5, 11.5, 27.5]) - (k + 4.0) * step * slope
        at = [origin + (k + i + 0.5) * step * slope for i in range(8)]
        voxels = [np.floor(p + 0.5).astype(int) - (16, 8, 24) for p in at]
        expected = sum(int(brick[tuple(v)]) << i for i, v in enumerate(voxels))
        assert look_up(words, 8, k, step, origin, slope) == expected


def test_ones_are_counted() -> None:
    assert [count(np.uint64(n)) for n in (0, 1, 0b1011, 2**64 - 1)] == [0, 1, 3, 64]
