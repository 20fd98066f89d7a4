"""Sums over pairs of labels that add up when labels merge: sparse, for any number of labels."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray


class PairSums:
    """Several sums for each of few pairs among many labels, the same from both sides.

    Parameters
    ----------
    count : int
        Of labels, 0 included.
    pairs : (P, 2) ndarray of int
        Two different labels each, none twice.
    sums : (P, K) ndarray of float64
        Theirs.
    """

    def __init__(self, count: int, pairs: NDArray[np.integer], sums: NDArray[np.float64]) -> None:
        self._none = np.zeros(sums.shape[1])
        self._rows: list[dict[int, NDArray[np.float64]]] = [{} for _ in range(count)]
        for (one, two), row in zip(pairs.tolist(), sums, strict=True):
            self._rows[one][two] = self._rows[two][one] = row

    def of(self, one: int) -> Mapping[int, NDArray[np.float64]]:
        """Return the sums of a label with each of those it has any with, (K,) by label."""
        return self._rows[one]

    def between(self, one: int, two: int) -> NDArray[np.float64]:
        """Return the sums of two labels, (K,); zeros where they have none.

        Parameters
        ----------
        one, two : int
        """
        return self._rows[one].get(two, self._none)

    def total(self, one: int, column: int) -> float:
        """Return one of the sums of a label, added up over all others.

        Parameters
        ----------
        one : int
        column : int
        """
        return float(sum(row[column] for row in self._rows[one].values()))

    def pairs(self, column: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return all pairs, (P, 2), rising, and one of their sums, (P,).

        Parameters
        ----------
        column : int
        """
        found = sorted((one, two) for one, row in enumerate(self._rows) for two in row if one < two)
        sums = [float(self._rows[one][two][column]) for one, two in found]
        return np.array(found, np.int64).reshape(-1, 2), np.array(sums)

    def join(self, one: int, two: int) -> None:
        """Add what label `two` has to label `one`; what both had in common is inside now.

        Parameters
        ----------
        one, two : int
        """
        mine, gone = self._rows[one], self._rows[two]
        for other, row in gone.items():
            theirs = self._rows[other]
            del theirs[two]
            if other != one:
                mine[other] = theirs[one] = mine[other] + row if other in mine else row
        self._rows[two] = {}
