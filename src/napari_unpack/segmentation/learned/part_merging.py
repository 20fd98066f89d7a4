"""Joining large parts by how they meet as well as by what the network sees between them.

The network sees some thirty voxels far and knows no shapes: that two halves make one box, or that
a plate lies flat on another, shows in the parts as wholes. So its word alone joins what is safe,
and a small trained judge of pairs, as in `affinity`, has both to go by for the rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.common.density_regions import MaterialScale, log_density
from napari_unpack.segmentation.common.merging import absorb_small
from napari_unpack.segmentation.common.region import FEWEST
from napari_unpack.segmentation.common.validation import Spacing, proportions
from napari_unpack.segmentation.learned.affinity_linkage import Bar
from napari_unpack.segmentation.learned.fragments import Ties
from napari_unpack.segmentation.learned.pair_classifier import (
    PAIR_FEATURES,
    PairClassifier,
    Parts,
    agglomerate,
    measure_parts,
)

FEATURES = (
    *PAIR_FEATURES,
    "belonging",
    "belonging_next",
    "belonging_near",
    "belonging_far",
    "belonging_farther",
    "log_pairs_next",
    "log_pairs_farther",
    "lesser_cohesion",
    "larger_cohesion",
)


SURE = 0.1
"""So far above the usual bar of `linkage` the network joins two whatever the judge says."""


@dataclass
class SeenParts(Parts):
    """Parts with what the network says between and within them.

    Parameters
    ----------
    between, within : ndarray of float64
        (M, M, K) and (M, K): sums of the probabilities that two cells belong together, by reach.
    pairs, inner : ndarray of float64
        (M, M, K) and (M, K): of how many pairs of cells.
    weights : (K,) ndarray of float64
        Of the reaches in a mean over all.
    """

    between: NDArray[np.float64]
    pairs: NDArray[np.float64]
    within: NDArray[np.float64]
    inner: NDArray[np.float64]
    weights: NDArray[np.float64]

    def join(self, one: int, two: int) -> None:
        """Add part `two` to part `one` and empty it."""
        super().join(one, two)
        for across, inside in ((self.between, self.within), (self.pairs, self.inner)):
            inside[one] += inside[two] + across[one, two]
            across[one] += across[two]
            across[:, one] += across[:, two]
            across[two] = 0
            across[:, two] = 0
            across[one, one] = 0

    def features(self, one: int, two: int, row: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what tells about a pair, in the order of `FEATURES`.

        Parameters
        ----------
        one, two : int
            Two that touch.
        row : (20,) ndarray of float64
            See `affinity.pair_features`.

        Returns
        -------
        (29,) ndarray of float64
            Belonging is the mean probability over all pairs of cells, then by reach (the mean
            over all where there is none of it); cohesion the same within each of the two.
        """
        sums, counts = self.between[one, two], self.pairs[one, two]
        mean = float(sums @ self.weights) / max(float(counts @ self.weights), 1.0)
        reaches = np.where(counts > 0, sums / np.maximum(counts, 1), mean)
        ends = [one, two]
        cohesion = (self.within[ends] @ self.weights + 1) / (self.inner[ends] @ self.weights + 1)
        many = np.log1p(counts[[0, -1]])
        return np.array([*row, mean, *reaches, *many, cohesion.min(), cohesion.max()])


def seen_parts(
    parts: NDArray[np.int32],
    density: NDArray[np.generic],
    spacing: Spacing,
    scale: MaterialScale,
    ties: Ties,
    owner: NDArray[np.int64],
    weights: NDArray[np.float64],
) -> tuple[NDArray[np.int32], SeenParts]:
    """Measure parts that were made of fragments.

    Parameters
    ----------
    parts : (Z, Y, X) ndarray of int32
        Named by the fragment that stands for each, see `owner`; what the network has not seen may
        have larger names.
    density : (Z, Y, X) ndarray
        Density.
    spacing : (float, float, float)
        Voxel size z y x, mm. Its proportions count: the network knows voxels only.
    scale : MaterialScale
        How densities are compared.
    ties : Ties
        Between fragments.
    owner : (count,) ndarray of int64
        See `linkage.link`.
    weights : (K,) ndarray of float64
        Of the reaches.

    Returns
    -------
    parts : (Z, Y, X) ndarray of int32
        1, 2, ...; those of fewer than 100 voxels are part of a neighbour or of nothing.
    measured : SeenParts
    """
    size = proportions(spacing)
    parts = absorb_small(parts, size, FEWEST)
    top = int(max(parts.max(initial=0) + 1, len(owner)))
    there = np.bincount(parts.reshape(-1), minlength=top) > 0
    there[0] = True
    compact = np.where(there, np.cumsum(there) - 1, 0).astype(np.int32)
    labels = compact[parts]
    plain = measure_parts(labels, log_density(density, labels > 0, scale), size)
    number, reaches = int(there.sum()), ties.sums.shape[1]
    between, pairs = (np.zeros((number, number, reaches)) for _ in range(2))
    within, inner = (np.zeros((number, reaches)) for _ in range(2))
    one, two = compact[owner[ties.pairs]].T
    for sums, across, inside in ((ties.sums, between, within), (ties.counts, pairs, inner)):
        same = (one == two) & (one > 0)
        np.add.at(inside, one[same], sums[same])
        differ = (one != two) & (one > 0) & (two > 0)
        np.add.at(across, (one[differ], two[differ]), sums[differ])
        across += across.swapaxes(0, 1).copy()
    return labels, SeenParts(
        **vars(plain), between=between, pairs=pairs, within=within, inner=inner, weights=weights
    )


def join_seen(
    labels: NDArray[np.int32], measured: SeenParts, judge: PairClassifier | None = None
) -> NDArray[np.int32]:
    """Join parts that the judge takes for one object, the surest first.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Parts 1, 2, ...
    measured : SeenParts
        Of them; used up.
    judge : PairClassifier, optional
        Over `FEATURES`; by default the one that ships with the package.

    Returns
    -------
    (Z, Y, X) ndarray of int32
    """
    trained, usual = judge or default_judge(), Bar()

    def chance(one: int, two: int, row: NDArray[np.float64]) -> float:
        told = measured.features(one, two, row)
        cells = float(min(measured.sums[one, 0], measured.sums[two, 0])) / 8
        # Where the network is sure, shapes that the judge has never seen do not matter.
        beyond = told[FEATURES.index("belonging")] - usual.height(cells) - SURE
        believed = 0.5 + min(beyond, 0.5) if beyond > 0 else 0.0
        return max(float(trained.probability(told[None])[0]), believed)

    return agglomerate(measured, chance).astype(np.int32)[labels]


@cache
def default_judge() -> PairClassifier:
    """Return the judge that ships with the package."""
    return PairClassifier.load(Path(__file__).parents[1] / "weights" / "part_merging.npz", FEATURES)
