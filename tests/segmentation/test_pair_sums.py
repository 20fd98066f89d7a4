"""Sparse sums of pairs against a dense table."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unpack.segmentation.common.pair_sums import PairSums


@pytest.mark.parametrize("seed", range(3))
def test_sums_and_joins_are_those_of_a_symmetric_table(seed: int) -> None:
    rng = np.random.default_rng(seed)
    table = np.triu(rng.integers(1, 9, (12, 12)) * (rng.random((12, 12)) < 0.4), 1)[..., None]
    table = np.concatenate([table, 10 * table], axis=2).astype(np.float64)
    pairs = np.argwhere(table[..., 0])
    sums = PairSums(12, pairs, table[tuple(pairs.T)])
    table += table.swapaxes(0, 1)
    left = list(range(12))
    while True:
        for one in range(12):
            np.testing.assert_array_equal([sums.between(one, two) for two in range(12)], table[one])
            assert sums.total(one, 1) == table[one, :, 1].sum()
            assert set(sums.of(one)) == set(np.flatnonzero(table[one, :, 0]))
        found, tens = sums.pairs(1)
        np.testing.assert_array_equal(found, np.argwhere(np.triu(table[..., 1])))
        np.testing.assert_array_equal(tens, table[tuple(found.T)][:, 1])
        if len(left) < 3:
            break
        one, two = (int(n) for n in rng.choice(left, 2, replace=False))
        left.remove(two)
        sums.join(one, two)
        table[one] += table[two]
        table[:, one] += table[:, two]
        table[two] = table[:, two] = table[one, one] = 0
