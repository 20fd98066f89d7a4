"""Parting what was joined over a step of density, where a trained judge takes it for an end.

The network forgets what it sees seldom: coins and keys in cloth, a sleeve around a bottle, a plate
flat on a box go with what they touch. A step of density tells them apart, but so it does a boot
from its sole. So every object is taken apart at its steps once more, and a judge of pairs, which
also knows what was one object before, puts the pieces together again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.common.density_regions import (
    MaterialScale,
    crossed,
    log_density,
    material_parts,
)
from napari_unpack.segmentation.common.merging import absorb_small
from napari_unpack.segmentation.common.region import FEWEST
from napari_unpack.segmentation.common.validation import Spacing, proportions
from napari_unpack.segmentation.learned.boundary_network import REACHES
from napari_unpack.segmentation.learned.fragments import cells_of, tie, tie_within
from napari_unpack.segmentation.learned.pair_classifier import (
    PairClassifier,
    agglomerate,
    measure_parts,
)
from napari_unpack.segmentation.learned.part_merging import FEATURES, SeenParts

PIECE_FEATURES = (*FEATURES, "log_host", "rest_of_smaller", "log_pieces", "one_host")

STEP = 0.2
"""Of log density, from which an object is taken apart."""

MANY = 2000
"""Pieces at most, whose pairs are kept as a whole table; with more, objects stay as they are."""

LEAST = 0.25
"""Probability from which pieces are joined: what was one object before mostly is."""

ACROSS = 0.4
"""Probability from which pieces of different objects are joined."""

WORTHY = 1000
"""Voxels from which a piece that is not dense becomes an object of its own."""

DENSE = 20.0
"""Times the knee, above air: metal. Five times the median density of matter."""


@dataclass
class Pieces(SeenParts):
    """Pieces of objects.

    Parameters
    ----------
    host : (M,) ndarray of int64
        The object that each is a piece of; for joined ones, that of the larger.
    whole, number : (M,) ndarray of float64
        Voxels and pieces of that object.
    """

    host: NDArray[np.int64]
    whole: NDArray[np.float64]
    number: NDArray[np.float64]

    def join(self, one: int, two: int) -> None:
        """Add piece `two` to piece `one` and empty it."""
        if self.sums[two, 0] > self.sums[one, 0]:
            for table in (self.host, self.whole, self.number):
                table[one] = table[two]
        super().join(one, two)

    def features(self, one: int, two: int, row: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what tells about a pair, in the order of `PIECE_FEATURES`.

        Parameters
        ----------
        one, two : int
            Two that touch.
        row : (20,) ndarray of float64
            See `affinity.pair_features`.

        Returns
        -------
        (33,) ndarray of float64
            To `joining.FEATURES` come, of the smaller piece, how much larger its host is than
            both (log), the share of its surface that touches others than the larger, how many
            pieces the host has (log), and whether both have one host.
        """
        small = min((one, two), key=lambda k: (self.sums[k, 0], k))
        surface = self.area[small].sum() + self.sums[small, 4]
        both = self.sums[one, 0] + self.sums[two, 0]
        others = (self.area[small].sum() - self.area[one, two]) / surface
        return np.array(
            [
                *super().features(one, two, row),
                np.log(self.whole[small] / both),
                others,
                np.log(self.number[small]),
                float(self.host[one] == self.host[two]),
            ]
        )


def pieces_of(
    labels: NDArray[np.int32],
    density: NDArray[np.generic],
    spacing: Spacing,
    scale: MaterialScale,
    far: NDArray[np.uint8],
    weights: NDArray[np.float64],
) -> tuple[NDArray[np.int32], Pieces]:
    """Take objects apart at their steps of density, and measure the pieces.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Objects 1, 2, ...
    density : (Z, Y, X) ndarray
        Density.
    spacing : (float, float, float)
        Voxel size z y x, mm. Its proportions count.
    scale : MaterialScale
        How densities are compared, but for its step.
    far : (3 * K, z, y, x) ndarray of uint8
        See `boundaries.Prediction`.
    weights : (K,) ndarray of float64
        Of the reaches in a mean.

    Returns
    -------
    pieces : (Z, Y, X) ndarray of int32
        1, 2, ...
    measured : Pieces
    """
    mask = labels > 0
    pieces = material_parts(density, mask, replace(scale, step=STEP), FEWEST, labels)
    if pieces.max(initial=0) > MANY:
        pieces = crossed(labels, np.zeros_like(labels))
    plain = measure_parts(pieces, log_density(density, mask, scale), proportions(spacing))
    count = len(plain.sums)
    host = np.zeros(count, np.int64)
    host[pieces.reshape(-1)] = labels.reshape(-1)
    top = int(host.max(initial=0)) + 1
    cells = cells_of(np.pad(pieces, [(0, n % 2) for n in pieces.shape]))
    ties = tie(cells, far)
    between, pairs = (np.zeros((count, count, len(REACHES))) for _ in range(2))
    one, two = ties.pairs.T
    for sums, across in ((ties.sums, between), (ties.counts, pairs)):
        across[one, two] = across[two, one] = sums
    # The smallest piece may be the main one of no cell.
    within, inner = (np.pad(s, ((0, count - len(s)), (0, 0))) for s in tie_within(cells, far))
    return pieces, Pieces(
        **vars(plain),
        between=between,
        pairs=pairs,
        within=within,
        inner=inner,
        weights=weights,
        host=host,
        whole=np.asarray(np.bincount(host, plain.sums[:, 0], top)[host], np.float64),
        number=np.bincount(host, minlength=top).astype(np.float64)[host],
    )


def part_seen(
    pieces: NDArray[np.int32],
    measured: Pieces,
    scale: MaterialScale,
    judge: PairClassifier | None = None,
) -> NDArray[np.int32]:
    """Join the pieces of objects that the judge takes for one, the surest first.

    Parameters
    ----------
    pieces : (Z, Y, X) ndarray of int32
        Pieces 1, 2, ...
    measured : Pieces
        Of them; used up.
    scale : MaterialScale
        How densities were compared.
    judge : PairClassifier, optional
        Over `PIECE_FEATURES`; by default the one that ships with the package.

    Returns
    -------
    (Z, Y, X) ndarray of int32
    """
    trained = judge or default_piece_judge()

    def chance(one: int, two: int, row: NDArray[np.float64]) -> float:
        said = float(trained.probability(measured.features(one, two, row)[None])[0])
        return said if measured.host[one] == measured.host[two] else said - ACROSS + LEAST

    own = agglomerate(measured, chance, LEAST)
    voxels = np.maximum(measured.sums[:, 0], 1)
    main = 2 * measured.sums[:, 0] >= measured.whole
    dense = measured.sums[:, 1] / voxels >= np.log1p(DENSE)
    joined = own.astype(np.int32)[pieces]
    kept = (main | dense)[: int(joined.max(initial=0)) + 1]
    return absorb_small(joined, (1.0, 1.0, 1.0), WORTHY, kept)


@cache
def default_piece_judge() -> PairClassifier:
    """Return the judge of pieces that ships with the package."""
    return PairClassifier.load(
        Path(__file__).parents[1] / "weights" / "part_splitting.npz", PIECE_FEATURES
    )
