"""Part splitting: at steps of density that a trained classifier takes for the end of an object.

The network misses what it saw seldom: coins and keys in cloth, a sleeve around a bottle, a plate
flat on a box go with what they touch. A step of density tells them apart, but so it does a boot
from its sole. So every object is split at its steps once more, and a classifier of pairs, which
also knows what was one object before, merges the pieces again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.common.density_regions import (
    DensityScale,
    density_regions,
    intersected_labels,
    log_density,
)
from napari_unpack.segmentation.common.joins import JoinLog
from napari_unpack.segmentation.common.merging import absorb_small
from napari_unpack.segmentation.common.pair_sums import PairSums
from napari_unpack.segmentation.common.region import MIN_OBJECT_VOXELS
from napari_unpack.segmentation.common.validation import Spacing, proportions
from napari_unpack.segmentation.learned.fragments import (
    cells_of,
    measure_affinities,
    measure_inner_affinities,
)
from napari_unpack.segmentation.learned.pair_classifier import (
    AREA,
    PairClassifier,
    agglomerate,
    measure_parts,
)
from napari_unpack.segmentation.learned.part_merging import FEATURES, PredictedParts
from napari_unpack.tasks import SILENT, Share

# Stored with the weights, as `FEATURES` are.
PIECE_FEATURES = (*FEATURES, "log_host", "rest_of_smaller", "log_pieces", "one_host")
# Of log density, at which objects are split; the classifier was trained with it.
SPLIT_STEP = 0.2
# Above this, objects stay whole: each piece costs some two milliseconds, for its hull.
MOST_PIECES = 2000
# Probability from which pieces of one object are merged: most that was one object is one. From
# 0.1 to 0.4 the variation of information on validation bags stays within 0.03 bits.
MERGE_WITHIN = 0.25
# Probability from which pieces of different objects are merged.
MERGE_ACROSS = 0.4
# Voxels from which a piece that is no metal becomes an object of its own; twice the least object
# of a bag of 1 mm voxels.
LEAST_PIECE = 1000
# Times the knee, above air. The knee is a quarter of the foreground's median, so metal is five
# times as dense as that.
METAL = 20.0


@dataclass
class Pieces(PredictedParts):
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
        """Add piece `two` to piece `one` and empty it; see `Parts.join`.

        Parameters
        ----------
        one, two : int
        """
        if self.sums[two, 0] > self.sums[one, 0]:
            for table in (self.host, self.whole, self.number):
                table[one] = table[two]
        super().join(one, two)

    def features(self, one: int, two: int, row: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the features of a pair, in the order of `PIECE_FEATURES`.

        Parameters
        ----------
        one, two : int
            Two that touch.
        row : (20,) ndarray of float64
            See `pair_features`.

        Returns
        -------
        (33,) ndarray of float64
            To `part_merging.FEATURES` come, of the smaller piece, how much larger its host is than
            both (log), the share of its surface that touches others than the larger, how many
            pieces the host has (log), and whether both have one host.
        """
        small = min((one, two), key=lambda k: (self.sums[k, 0], k))
        touched = self.contacts.total(small, AREA)
        both = self.sums[one, 0] + self.sums[two, 0]
        others = (touched - self.contacts.between(one, two)[AREA]) / self.surface(small)
        return np.array(
            [
                *super().features(one, two, row),
                np.log(self.whole[small] / both),
                others,
                np.log(self.number[small]),
                float(self.host[one] == self.host[two]),
            ]
        )


def split_and_measure(
    labels: NDArray[np.int32],
    density: NDArray[np.generic],
    spacing: Spacing,
    scale: DensityScale,
    far: NDArray[np.uint8],
    share: Share = SILENT,
) -> tuple[NDArray[np.int32], Pieces]:
    """Split objects at their density steps; return and measure the pieces 1, 2, ...

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Objects 1, 2, ...
    density : (Z, Y, X) ndarray
    spacing : (float, float, float) of mm, z y x
        Its proportions count.
    scale : DensityScale
        How densities are compared, but for its step.
    far : (3 * K, z, y, x) ndarray of uint8
        See `boundary_network.Prediction`.
    share : Share
    """
    mask = labels > 0
    fine, first = replace(scale, step=SPLIT_STEP), share.part(0.0, 0.6)
    pieces = density_regions(density, mask, fine, MIN_OBJECT_VOXELS, labels, first)
    if pieces.max(initial=0) > MOST_PIECES:
        pieces = intersected_labels(labels, np.zeros_like(labels))
    lifted = log_density(density, mask, scale)
    plain = measure_parts(pieces, lifted, proportions(spacing), share.part(0.65, 0.9))
    count = len(plain.sums)
    host = np.zeros(count, np.int64)
    host[pieces.reshape(-1)] = labels.reshape(-1)
    top = int(host.max(initial=0)) + 1
    cells = cells_of(np.pad(pieces, [(0, n % 2) for n in pieces.shape]))
    affinities = measure_affinities(cells, far, share.part(0.9, 1.0))
    across = np.concatenate([affinities.sums, affinities.counts], axis=1)
    # The smallest piece may be the main one of no cell.
    within, inner = (
        np.pad(s, ((0, count - len(s)), (0, 0))) for s in measure_inner_affinities(cells, far)
    )
    return pieces, Pieces(
        **vars(plain),
        between=PairSums(count, affinities.pairs, across),
        within=within,
        inner=inner,
        host=host,
        whole=np.asarray(np.bincount(host, plain.sums[:, 0], top)[host], np.float64),
        number=np.bincount(host, minlength=top).astype(np.float64)[host],
    )


def merge_pieces(
    pieces: NDArray[np.int32],
    measured: Pieces,
    classifier: PairClassifier | None = None,
    log: JoinLog | None = None,
    share: Share = SILENT,
) -> NDArray[np.int32]:
    """Merge the pieces of objects that the classifier takes for one, the surest first.

    Parameters
    ----------
    pieces : (Z, Y, X) ndarray of int32
        Pieces 1, 2, ...
    measured : Pieces
        Of them; used up.
    classifier : PairClassifier, optional
        Over `PIECE_FEATURES`; by default the one that ships with the package.
    log : JoinLog, optional
        Where merges are noted.
    share : Share
    """
    trained = classifier or default_splitting_classifier()

    said: dict[tuple[int, int], float] = {}

    def probability(one: int, two: int, row: NDArray[np.float64]) -> float:
        chance = float(trained.probability(measured.features(one, two, row)[None])[0])
        said[one, two] = chance
        return (
            chance
            if measured.host[one] == measured.host[two]
            else chance - MERGE_ACROSS + MERGE_WITHIN
        )

    noted = JoinLog() if log is None else log
    own = agglomerate(measured, probability, MERGE_WITHIN, log=noted, share=share.part(0.0, 0.9))
    # What the classifier said, not what was compared.
    noted.joined[:] = [(one, two, said[one, two]) for one, two, _ in noted.joined]
    noted.apart.update({pair: said[pair] for pair in noted.apart})
    voxels = np.maximum(measured.sums[:, 0], 1)
    main = 2 * measured.sums[:, 0] >= measured.whole
    dense = measured.sums[:, 1] / voxels >= np.log1p(METAL)
    joined = own.astype(np.int32)[pieces]
    # The handles of scissors touch nothing but the blades, or not even these.
    alone = np.array([measured.contacts.total(k, AREA) == 0 for k in range(len(voxels))])
    kept = (main | dense | alone)[: int(joined.max(initial=0)) + 1]
    return absorb_small(joined, (1.0, 1.0, 1.0), LEAST_PIECE, kept)


@cache
def default_splitting_classifier() -> PairClassifier:
    """Return the classifier of pieces that ships with the package."""
    return PairClassifier.load(
        Path(__file__).parents[1] / "weights" / "part_splitting.npz", PIECE_FEATURES
    )
