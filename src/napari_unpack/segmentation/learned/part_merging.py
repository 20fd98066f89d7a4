"""Part merging: by how two parts meet as well as by the network's affinity between them.

The network sees some thirty voxels far and knows no shapes: that two halves make one box, or that
a plate lies flat on another, shows in the parts as wholes. So affinity alone links what is safe,
and a small trained classifier of pairs decides the rest by both.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.relabeling import numbered
from napari_unpack.segmentation.common.density_regions import DensityScale, log_density
from napari_unpack.segmentation.common.joins import JoinLog
from napari_unpack.segmentation.common.merging import absorb_small
from napari_unpack.segmentation.common.pair_sums import PairSums
from napari_unpack.segmentation.common.region import MIN_OBJECT_VOXELS
from napari_unpack.segmentation.common.validation import Spacing, proportions
from napari_unpack.segmentation.learned.affinity_linkage import LinkageThreshold
from napari_unpack.segmentation.learned.fragments import REACH_WEIGHTS, FragmentAffinities
from napari_unpack.segmentation.learned.pair_classifier import (
    PAIR_FEATURES,
    PairClassifier,
    Parts,
    agglomerate,
    measure_parts,
)
from napari_unpack.tasks import SILENT, Share

# Names are stored with the weights and compared with them: they must stay as they were trained.
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

# How far above the usual threshold of linkage affinity alone merges two parts: there the
# classifier, which goes by shapes too, would err on shapes that it has never seen.
AFFINITY_ALONE = 0.1

# Of how well the classifier tells pairs apart, see `discrimination`: on bags and real scans 0.43 to
# 0.85, on packs of beads, cubes or gravel 0.18 at most. There linkage decides alone: the classifier
# learned from bags that small parts are mostly pieces, and a wrong merge makes the next likelier.
LEAST_DISCRIMINATION = 0.3


@dataclass
class PredictedParts(Parts):
    """Parts with the network's affinities between and within them.

    Parameters
    ----------
    between : PairSums
        Of every pair: sums of the probabilities that two cells belong together, by reach (K), and
        of how many pairs of cells (K).
    within, inner : (M, K) ndarray of float64
        The same within every part.
    """

    between: PairSums
    within: NDArray[np.float64]
    inner: NDArray[np.float64]

    def join(self, one: int, two: int) -> None:
        """Add part `two` to part `one` and empty it; see `Parts.join`.

        Parameters
        ----------
        one, two : int
        """
        super().join(one, two)
        both = np.split(self.between.between(one, two), 2)
        for across, inside in zip(both, (self.within, self.inner), strict=True):
            inside[one] += inside[two] + across
        self.between.join(one, two)

    def features(self, one: int, two: int, row: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the features of a pair, in the order of `FEATURES`.

        Parameters
        ----------
        one, two : int
            Two that touch.
        row : (20,) ndarray of float64
            See `pair_features`.

        Returns
        -------
        (29,) ndarray of float64
            "belonging" is the mean affinity over all pairs of cells, then by reach (the mean over
            all where there is none of it); cohesion the same within each of the two.
        """
        sums, counts = np.split(self.between.between(one, two), 2)
        mean = float(sums @ REACH_WEIGHTS) / max(float(counts @ REACH_WEIGHTS), 1.0)
        reaches = np.where(counts > 0, sums / np.maximum(counts, 1), mean)
        ends = [one, two]
        within, inner = (table[ends] @ REACH_WEIGHTS + 1 for table in (self.within, self.inner))
        cohesion = within / inner
        many = np.log1p(counts[[0, -1]])
        return np.array([*row, mean, *reaches, *many, cohesion.min(), cohesion.max()])


def measure_predicted_parts(
    parts: NDArray[np.int32],
    density: NDArray[np.generic],
    spacing: Spacing,
    scale: DensityScale,
    affinities: FragmentAffinities,
    owner: NDArray[np.int64],
    share: Share = SILENT,
) -> tuple[NDArray[np.int32], PredictedParts]:
    """Measure parts that were linked from fragments.

    Parameters
    ----------
    parts : (Z, Y, X) ndarray of int32
        Named by the fragment that stands for each, see `owner`; what the network missed has
        larger names.
    density : (Z, Y, X) ndarray
    spacing : (float, float, float) of mm, z y x
        Its proportions count: the network knows voxels only.
    scale : DensityScale
        How densities are compared.
    affinities : FragmentAffinities
        Between fragments.
    owner : (count,) ndarray of int64
        See `mean_affinity_linkage`.
    share : Share

    Returns
    -------
    parts : (Z, Y, X) ndarray of int32
        1, 2, ...; those of fewer than 100 voxels are part of a neighbour or of nothing.
    measured : PredictedParts
    """
    size = proportions(spacing)
    parts = absorb_small(parts, size, MIN_OBJECT_VOXELS)
    share(0.2)
    top = int(max(parts.max(initial=0) + 1, len(owner)))
    there = np.bincount(parts.reshape(-1), minlength=top) > 0
    there[0] = False
    compact = numbered(there)
    number, reaches = int(compact.max()) + 1, affinities.sums.shape[1]
    labels = compact[parts]
    share(0.3)
    lifted = log_density(density, labels > 0, scale)
    plain = measure_parts(labels, lifted, size, share.part(0.4, 0.9))
    one, two = np.sort(compact[owner[affinities.pairs]], axis=1).T
    both = np.concatenate([affinities.sums, affinities.counts], axis=1)
    same, differ = (one == two) & (one > 0), (one != two) & (one > 0)
    inside = np.zeros((number, 2 * reaches))
    np.add.at(inside, one[same], both[same])
    keys, where = np.unique(one[differ] * np.int64(number) + two[differ], return_inverse=True)
    across = np.zeros((len(keys), 2 * reaches))
    np.add.at(across, where, both[differ])
    between = PairSums(number, np.stack(np.divmod(keys, number), axis=1), across)
    within, inner = (half.copy() for half in np.hsplit(inside, 2))
    return labels, PredictedParts(**vars(plain), between=between, within=within, inner=inner)


def merge_parts(
    labels: NDArray[np.int32],
    measured: PredictedParts,
    classifier: PairClassifier | None = None,
    log: JoinLog | None = None,
    share: Share = SILENT,
) -> NDArray[np.int32]:
    """Merge parts that the classifier takes for one object, the surest first.

    Where it can hardly tell pairs of this volume apart, nothing is merged.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Parts 1, 2, ...
    measured : PredictedParts
        Of them; used up.
    classifier : PairClassifier, optional
        Over `FEATURES`; by default the one that ships with the package.
    log : JoinLog, optional
        Where merges are noted.
    share : Share
    """
    trained, usual = classifier or default_merging_classifier(), LinkageThreshold()

    def chance(one: int, two: int, row: NDArray[np.float64]) -> float:
        row = measured.features(one, two, row)
        # In cells of 8 voxels.
        cells = float(min(measured.sums[one, 0], measured.sums[two, 0])) / 8
        beyond = row[FEATURES.index("belonging")] - usual.at(cells) - AFFINITY_ALONE
        # Above 0.5 two are merged; the more affinity, the earlier.
        by_affinity = 0.5 + min(beyond, 0.5) if beyond > 0 else 0.0
        return max(float(trained.probability(row[None])[0]), by_affinity)

    owners = agglomerate(
        measured, chance, log=log, share=share, least_discrimination=LEAST_DISCRIMINATION
    )
    return owners.astype(np.int32)[labels]


@cache
def default_merging_classifier() -> PairClassifier:
    """Return the classifier of parts that ships with the package."""
    return PairClassifier.load(Path(__file__).parents[1] / "weights" / "part_merging.npz", FEATURES)
