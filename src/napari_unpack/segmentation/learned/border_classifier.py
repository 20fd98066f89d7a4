"""Borders between touching objects, drawn voxel by voxel by a small trained classifier.

A thin plate on a box is a few voxels thick, all of them at a border, blurred into the box on one
side and into air on the other. No one measure tells which object such a voxel belongs to: not its
density, not the affinities across its faces, not the labels around it. A classifier trained on
simulated bags weighs them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from napari_unpack.kernels import njit
from napari_unpack.segmentation.common.density_regions import DensityScale
from napari_unpack.segmentation.learned.border_refinement import (
    AIR,
    BESIDE,
    DENSITY,
    FARTHER,
    FARTHEST,
    MOST_LABELS,
    NEAR,
    WEIGHT,
    Borders,
    Moves,
    apply_moves,
    count_votes,
    moves_in,
    tally,
)
from napari_unpack.segmentation.learned.pair_classifier import PairClassifier
from napari_unpack.tasks import SILENT, Share

# Labels at most that are compared at a voxel: its own, those across its six faces, and others.
MOST_RIVALS = MOST_LABELS
# Stored with the weights and compared with them: the names must stay as they were trained.
# Of a label at a voxel, beside its rival there, the other label with most voxels around: whether
# it holds the voxel; the affinities across the faces it shares with both, and how many they are;
# how many of the 26 voxels around (nearer ones count more) and what shares of the 124 and 342
# around are either's, and air's; by how much nearer the voxel's density is to the label's local
# mean than to the rival's, over the noise and over their step; that step over the noise; how far
# the voxel lies below the mean of its neighbourhood, over the noise; by how much likelier its
# density is in the whole label than in the whole rival; density over the local mean; by how much
# larger the label is.
BORDER_FEATURES = (
    "holds",
    "said",
    "rival_said",
    "faces",
    "rival_faces",
    "near",
    "rival_near",
    "farther",
    "rival_farther",
    "farthest",
    "rival_farthest",
    "air_near",
    "air_farthest",
    "nearer",
    "nearer_of_step",
    "step",
    "below_around",
    "likelier",
    "of_mean",
    "log_larger",
)

# Standard deviation of one object's density, as a share of it, beside noise; as in training.
TEXTURE = 0.05
# Of log density: the last bin begins at 9.5, above any metal.
BINS, BIN_WIDTH = 160, 0.06


def _bin_of(values: NDArray[np.float64], knee: float) -> NDArray[np.int64]:
    """Return the bins of densities above air; see `DensityScale`."""
    bins: NDArray[np.int64] = np.minimum(
        np.log1p(np.maximum(values, 0.0) / knee) / BIN_WIDTH, BINS - 1.0
    ).astype(np.int64)
    return bins


def find_rivals(
    labels: NDArray[np.int32], places: NDArray[np.int64]
) -> tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.int64]]:
    """Return the labels of voxels and of the 26 around each, few as they are.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        0 is background, which has no claim.
    places : (N, 3) ndarray of int64
        The voxels, of labels.

    Returns
    -------
    names : (N, MOST_RIVALS) ndarray of int32
        The labels: the voxel's own, those across its faces, others.
    counts, across : (N,) ndarray of int64
        How many these are, and how many without the others.
    """
    names = np.zeros((len(places), MOST_RIVALS), np.int32)
    names[:, 0] = labels[*places.T]
    counts, across = np.ones(len(places), np.int64), np.ones(len(places), np.int64)
    low, high = np.maximum(places - 1, 0), np.minimum(places + 2, labels.shape)
    _find_rivals(labels, places, low, high, names, counts, across)
    return names, counts, across


@njit(cache=True, nogil=True)
def _find_rivals(labels, places, low, high, names, counts, across):  # type: ignore[no-untyped-def]
    for p in range(len(places)):
        z, y, x = places[p, 0], places[p, 1], places[p, 2]
        # Those across a face first: corners must not take their room.
        for corners in range(2):
            across[p] = counts[p]
            for k in range(low[p, 0], high[p, 0]):
                for j in range(low[p, 1], high[p, 1]):
                    for i in range(low[p, 2], high[p, 2]):
                        name = labels[k, j, i]
                        if name == 0 or name == names[p, 0]:
                            continue
                        if (abs(k - z) + abs(j - y) + abs(i - x) > 1) != (corners > 0):
                            continue
                        n = 1
                        while n < counts[p] and names[p, n] != name:
                            n += 1
                        if n == counts[p] and n < MOST_RIVALS:
                            names[p, n] = name
                            counts[p] += 1


def describe(
    labels: NDArray[np.int32],
    inside: NDArray[np.bool_],
    evidence: BorderEvidence,
    places: NDArray[np.int64],
    names: NDArray[np.int32],
    counts: NDArray[np.int64],
) -> NDArray[np.float32]:
    """Return the features of every label at some voxels.

    Parameters
    ----------
    labels, inside : (Z, Y, X) ndarray of int32 and bool
        Objects, and which voxels are inside them; see `Borders`.
    evidence : BorderEvidence
    places : (N, 3) ndarray of int64
        The voxels.
    names, counts
        See `find_rivals`; at least two labels each.

    Returns
    -------
    (R, F) ndarray of float32
        For every voxel as many rows as labels; columns as `BORDER_FEATURES`.
    """
    votes = np.zeros((len(places), MOST_RIVALS))
    faces = np.zeros((len(places), AIR + 1), np.int64)
    count_votes(labels, evidence.following, 0.0, places, names, counts.copy(), votes, faces)
    found = np.zeros((len(places), AIR + 1, WEIGHT + 1))
    found[..., WEIGHT] = 1e-9
    around = tally(labels, inside, evidence.values, places, names, counts, 1.0, False, found)
    around /= (np.minimum(places + 2, labels.shape) - np.maximum(places - 1, 0)).prod(axis=1)

    present = np.arange(MOST_RIVALS) < counts[:, None]
    # The rival of each: the other one with most voxels around.
    many = np.where(present, found[:, :MOST_RIVALS, FARTHER], -1.0)
    every = np.arange(len(places))
    first = many.argmax(axis=1)
    many[every, first] = -1.0
    leads = np.arange(MOST_RIVALS) == first[:, None]
    rivals = np.where(leads, many.argmax(axis=1)[:, None], first[:, None])[present]
    at, own = np.nonzero(present)
    name, other = names[at, own], names[at, rivals]

    # Nothing of it inside near here: half a vote for what it is as a whole.
    weights = found[:, :MOST_RIVALS, WEIGHT]
    half = np.where(weights < 0.5, 0.5, 0.0)
    means = found[:, :MOST_RIVALS, DENSITY] + half * evidence.means[names]
    means /= weights + half
    mine, others = means[at, own], means[at, rivals]
    here = evidence.values[*places.T].astype(np.float64)
    lifted = _bin_of(here, evidence.knee)[at]
    here, around, air = here[at], around[at], found[at, AIR]
    step = mine - others
    spread = evidence.noise + TEXTURE * np.maximum(np.minimum(mine, others), 0.0) + 1e-6
    nearer = np.abs(here - others) - np.abs(here - mine)
    likelier = evidence.logs[name, lifted] - evidence.logs[other, lifted]
    rows = np.empty((len(at), len(BORDER_FEATURES)), np.float32)
    rows[:, 0] = own == 0
    rows[:, 1], rows[:, 2] = votes[at, own], votes[at, rivals]
    rows[:, 3], rows[:, 4] = faces[at, own], faces[at, rivals]
    for n, (column, whole) in enumerate(((NEAR, 1), (FARTHER, 124), (FARTHEST, 342))):
        rows[:, 5 + 2 * n] = found[at, own, column] / whole
        rows[:, 6 + 2 * n] = found[at, rivals, column] / whole
    rows[:, 11], rows[:, 12] = air[:, BESIDE] / 26, air[:, FARTHEST] / 342
    rows[:, 13] = np.tanh(nearer / (4 * spread))
    rows[:, 14] = nearer / np.maximum(np.abs(step), 2 * spread)
    rows[:, 15] = np.tanh(step / (8 * spread))
    rows[:, 16] = np.tanh((around - here) / (4 * spread))
    rows[:, 17] = np.clip(likelier, -6.0, 6.0)
    rows[:, 18] = np.clip(here / np.maximum(mine, 1e-6), 0.0, 3.0)
    rows[:, 19] = np.log(evidence.sizes[name] / evidence.sizes[other])
    return rows


# Voxels that a border moves at most.
ROUNDS = 6
# Lead, before the logistic, that the label of a voxel has: in doubt nothing moves.
HOLD = 1.0
# Of every bin of density in every object: one voxel of an odd density must not decide.
LEAST_SHARE = 0.005


@dataclass(frozen=True, eq=False)
class BorderEvidence:
    """What borders are drawn by, besides the labels.

    Parameters
    ----------
    values : (Z, Y, X) ndarray of float32
        Density above air.
    knee : float
        See `DensityScale`.
    following : (3, Z, Y, X) ndarray of uint8
        Affinity with the next voxel; see `boundary_network.Prediction`.
    noise : float
        Standard deviation of the density's noise.
    means, sizes : (M,) ndarray of float64
        Of every label: density above air, voxels.
    logs : (M, BINS) ndarray of float64
        Of every label: logarithm of the share that each log density has of it.
    """

    values: NDArray[np.float32]
    knee: float
    following: NDArray[np.uint8]
    noise: float
    means: NDArray[np.float64]
    sizes: NDArray[np.float64]
    logs: NDArray[np.float64]

    @staticmethod
    def of(
        labels: NDArray[np.int32],
        density: NDArray[np.generic],
        scale: DensityScale,
        following: NDArray[np.uint8],
        noise: float,
    ) -> BorderEvidence:
        """Measure every label as it is now.

        Parameters
        ----------
        labels : (Z, Y, X) ndarray of int32
            Objects; 0 is background.
        density : (Z, Y, X) ndarray
            NaN and infinities count as air.
        scale : DensityScale
            How densities are compared.
        following, noise
            See `BorderEvidence`.
        """
        air = float(np.float32(scale.air))
        values = density.astype(np.float32)
        # What is not measured is air, as for all of the package.
        np.nan_to_num(values, copy=False, nan=air, posinf=air, neginf=air)
        values -= np.float32(air)
        sizes = np.maximum(np.bincount(labels.reshape(-1)), 1).astype(np.float64)
        means = np.bincount(labels.reshape(-1), values.reshape(-1), len(sizes)) / sizes
        counts = _histograms(labels, values, scale.knee, len(sizes))
        # Noise spreads densities over neighbouring bins anyway; small objects fill few.
        counts = gaussian_filter1d(counts, 1.0, axis=1)
        shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1e-9)
        logs = np.log(shares + LEAST_SHARE)
        return BorderEvidence(values, scale.knee, following, noise, means, sizes, logs)


def draw_borders(
    labels: NDArray[np.int32],
    evidence: BorderEvidence,
    classifier: PairClassifier | None = None,
    rounds: int = ROUNDS,
    share: Share = SILENT,
) -> NDArray[np.int32]:
    """Give every voxel at a border to the label around it that it most likely belongs to.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Objects, 0 background. Not changed.
    evidence : BorderEvidence
        Of these labels.
    classifier : PairClassifier, optional
        Over `BORDER_FEATURES`, of three layers; by default the one that ships
        with the package.
    rounds : int
        Voxels that a border moves at most.
    share : Share

    Notes
    -----
    Borders are to lie roughly right already, see `sharpen_borders`. Only a label that shares a face
    with a voxel may take it. All is counted in voxels, whatever their size. Rounds after the first
    look again only at what has changed and is near it. About 350 reads and 2000 multiplications a
    voxel of border.
    """
    trained = classifier or default_border_classifier()
    labels = labels.copy()
    # Only what is near a change can change in the next round.
    due = np.ones(labels.shape, np.bool_)
    for n in range(rounds):
        # Each round looks at less than half of what the one before looked at.
        round_share = share.part(1 - 0.5**n, 1 - 0.5 ** (n + 1))
        borders = Borders.of(labels)
        due &= borders.touching
        decide = partial(_moves, labels, borders.inside, evidence, trained)
        move = partial(moves_in, due, decide)
        due = apply_moves(labels, round_share.over_slabs(labels.shape, move))
        if not due.any():
            break
    return labels


@cache
def default_border_classifier() -> PairClassifier:
    """Return the classifier of borders that ships with the package."""
    return PairClassifier.load(
        Path(__file__).parents[1] / "weights" / "border_classifier.npz", BORDER_FEATURES
    )


def _histograms(
    labels: NDArray[np.int32], values: NDArray[np.float32], knee: float, count: int
) -> NDArray[np.float64]:
    """Count log densities, label by label; voxels at a border, which are blurred, hardly count."""
    counts, inside = np.zeros((count, BINS)), Borders.of(labels).inside
    # By slabs, as it takes 40 bytes a voxel.
    for a, b in SILENT.slabs(labels.shape):
        objects = labels[a:b] > 0
        weights = np.where(inside[a:b][objects], 1.0, 0.05)
        bins = _bin_of(values[a:b][objects].astype(np.float64), knee)
        np.add.at(counts, (labels[a:b][objects], bins), weights)
    return counts


def _moves(
    labels: NDArray[np.int32],
    inside: NDArray[np.bool_],
    evidence: BorderEvidence,
    trained: PairClassifier,
    places: NDArray[np.int64],
) -> Moves:
    """Return which of some voxels move, and the labels they go to."""
    # Across an edge alone a voxel would come apart from its object.
    names, counts, across = find_rivals(labels, places)
    rows = describe(labels, inside, evidence, places, names, counts)
    # In float32, as the weights are: one type, so that the loops are compiled once.
    center, scale = trained.center.astype(np.float32), trained.scale.astype(np.float32)
    # As in training: a feature far off what was learned must not decide alone.
    rows = np.clip((rows - center) / scale, -6.0, 6.0)
    layers = [np.ascontiguousarray(w, np.float32) for w in trained.weights]
    offsets = [np.ascontiguousarray(o, np.float32) for o in trained.offsets]
    best = np.zeros(len(places), np.int64)
    first = np.cumsum(counts) - counts
    given = (*layers, *offsets, np.zeros_like(offsets[0]), np.zeros_like(offsets[1]))
    _choose(rows.astype(np.float64), first, across, *given, best)  # type: ignore[call-arg]
    moved = best > 0
    return places[moved], names[moved, best[moved]]


@njit(cache=True, nogil=True)
def _choose(rows, first, across, w0, w1, w2, o0, o1, o2, one, two, best):  # type: ignore[no-untyped-def]
    """Write which label of every voxel has the highest `PairClassifier.probability`.

    Loops beat BLAS here, and the logistic changes no order.
    """
    for p in range(len(first)):
        most = -np.inf
        for n in range(across[p]):
            for h in range(len(one)):
                one[h] = o0[h]
            for k in range(rows.shape[1]):
                value = rows[first[p] + n, k]
                for h in range(len(one)):
                    one[h] += value * w0[k, h]
            for h in range(len(two)):
                two[h] = o1[h]
            for k in range(len(one)):
                lit = np.tanh(one[k])
                for h in range(len(two)):
                    two[h] += lit * w1[k, h]
            logit = o2[0]
            for k in range(len(two)):
                logit += np.tanh(two[k]) * w2[k, 0]
            led = logit + (HOLD if n == 0 else 0.0)
            if led > most:
                best[p], most = n, led
