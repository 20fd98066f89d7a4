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
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from napari_unpack.segmentation.common.density_regions import DensityScale
from napari_unpack.segmentation.learned.border_refinement import find_inside
from napari_unpack.segmentation.learned.pair_classifier import PairClassifier
from napari_unpack.tasks import SILENT, Share

# Labels at most that are compared at a voxel: its own, those across its six faces, and others.
MOST_RIVALS = 7
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


@njit(cache=True, nogil=True)
def _bin_of(value, knee):  # type: ignore[no-untyped-def]
    """Return the bin of a density above air; see `DensityScale`."""
    return int(min(np.log1p(max(value, 0.0) / knee) / BIN_WIDTH, BINS - 1.0))


@njit(cache=True, nogil=True)
def find_rivals(labels, z, y, x, names):  # type: ignore[no-untyped-def]
    """Write the labels of a voxel and of the 26 around it, few as they are; return how many.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        0 is background, which has no claim.
    z, y, x : int
        The voxel, of a label.
    names : (MOST_RIVALS,) ndarray of int32
        Gets the labels, the voxel's own first.
    """
    size = labels.shape
    count = 1
    names[0] = labels[z, y, x]
    # Those across a face first: corners must not take their room.
    for corners in (False, True):
        for k in range(max(z - 1, 0), min(z + 2, size[0])):
            for j in range(max(y - 1, 0), min(y + 2, size[1])):
                for i in range(max(x - 1, 0), min(x + 2, size[2])):
                    name = labels[k, j, i]
                    away = abs(k - z) + abs(j - y) + abs(i - x)
                    if name == 0 or name == names[0] or (away > 1) != corners:
                        continue
                    n = 1
                    while n < count and names[n] != name:
                        n += 1
                    if n == count and count < MOST_RIVALS:
                        names[n] = name
                        count += 1
    return count


@njit(cache=True, nogil=True)
def describe(  # type: ignore[no-untyped-def]
    labels, inside, values, knee, following, noise, means, sizes, logs, z, y, x, names, rows
):
    """Write the features of every label at a voxel.

    Parameters
    ----------
    labels, inside : (Z, Y, X) ndarray of int32 and bool
        Objects, and which voxels are inside them; see `find_inside`.
    values, knee, following, noise, means, sizes, logs
        See `BorderEvidence`.
    z, y, x : int
        The voxel.
    names : (N,) ndarray of int32
        See `find_rivals`; at least two.
    rows : (MOST_RIVALS, F) ndarray of float32
        Gets N rows in the order of `BORDER_FEATURES`.
    """
    count = len(names)
    # By label: the 26 voxels around, nearer ones counting more; voxels within 2; within 3; local
    # mean density; faces shared; affinities across them.
    counts = np.zeros((count, 6))
    weights = np.full(count, 1e-9)
    air = np.zeros(2)
    around, many = 0.0, 0
    size = labels.shape
    for k in range(max(z - 3, 0), min(z + 4, size[0])):
        for j in range(max(y - 3, 0), min(y + 4, size[1])):
            for i in range(max(x - 3, 0), min(x + 4, size[2])):
                name = labels[k, j, i]
                reach = max(abs(k - z), abs(j - y), abs(i - x))
                if reach <= 1:
                    around += values[k, j, i]
                    many += 1
                if name == 0:
                    air[0] += reach <= 1
                    air[1] += 1
                    continue
                if reach == 0:
                    continue
                for n in range(count):
                    if names[n] == name:
                        if reach == 1:
                            counts[n, 0] += 1 / np.sqrt(abs(k - z) + abs(j - y) + abs(i - x))
                        counts[n, 1] += reach <= 2
                        counts[n, 2] += 1
                        weight = 1.0 if inside[k, j, i] else 0.02
                        counts[n, 3] += weight * values[k, j, i]
                        weights[n] += weight
    _add_faces(labels, following, z, y, x, names, counts)
    here = values[z, y, x]
    lifted = _bin_of(here, knee)
    for n in range(count):
        # Nothing of it inside near here: half a vote for what it is as a whole.
        if weights[n] < 0.5:
            counts[n, 3] += 0.5 * means[names[n]]
            weights[n] += 0.5
        counts[n, 3] /= weights[n]
    for n in range(count):
        rival = -1
        for m in range(count):
            if m != n and (rival < 0 or counts[m, 1] > counts[rival, 1]):
                rival = m
        mine, other = counts[n], counts[rival]
        step = mine[3] - other[3]
        spread = noise + TEXTURE * max(min(mine[3], other[3]), 0.0) + 1e-6
        nearer = abs(here - other[3]) - abs(here - mine[3])
        likelier = logs[names[n], lifted] - logs[names[rival], lifted]
        row = rows[n]
        row[0] = n == 0
        row[1], row[2] = mine[5], other[5]
        row[3], row[4] = mine[4], other[4]
        row[5], row[6] = mine[0], other[0]
        row[7], row[8] = mine[1] / 124, other[1] / 124
        row[9], row[10] = mine[2] / 342, other[2] / 342
        row[11], row[12] = air[0] / 26, air[1] / 342
        row[13] = np.tanh(nearer / (4 * spread))
        row[14] = nearer / max(abs(step), 2 * spread)
        row[15] = np.tanh(step / (8 * spread))
        row[16] = np.tanh((around / many - here) / (4 * spread))
        row[17] = min(max(likelier, -6.0), 6.0)
        row[18] = min(max(here / max(mine[3], 1e-6), 0.0), 3.0)
        row[19] = np.log(sizes[names[n]] / sizes[names[rival]])


@njit(cache=True, nogil=True)
def _add_faces(labels, following, z, y, x, names, counts):  # type: ignore[no-untyped-def]
    """Add to columns 4 and 5 the faces shared with every label, and the affinities across them."""
    size = labels.shape
    for side in range(6):
        axis, ahead = side // 2, side % 2
        k, j, i = z, y, x
        if axis == 0:
            k += 2 * ahead - 1
        elif axis == 1:
            j += 2 * ahead - 1
        else:
            i += 2 * ahead - 1
        if not (0 <= k < size[0] and 0 <= j < size[1] and 0 <= i < size[2]):
            continue
        affinity = following[axis, z, y, x] if ahead else following[axis, k, j, i]
        for n in range(len(names)):
            if names[n] == labels[k, j, i]:
                counts[n, 4] += 1
                counts[n, 5] += affinity / 255.0


# Voxels that a border moves at most.
ROUNDS = 6
# Lead, before the logistic, that the label of a voxel has: in doubt nothing moves.
HOLD = 1.0
# Of every bin of density in every object: one voxel of an odd density must not decide.
LEAST_SHARE = 0.005

FACES = BORDER_FEATURES.index("faces")
# Voxels to every side whose labels `describe` reads: it looks three far, and whether a voxel
# there is inside depends on the next.
REACH = 4


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
        counts = _histograms(labels, values, find_inside(labels), scale.knee, len(sizes))
        # Noise spreads densities over neighbouring bins anyway; small objects fill few.
        counts = gaussian_filter1d(counts, 1.0, axis=1)
        shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1e-9)
        logs = np.log(shares + LEAST_SHARE)
        return BorderEvidence(values, scale.knee, following, noise, means, sizes, logs)

    def facts(self) -> tuple[object, ...]:
        """Return what the compiled loops take, in their order."""
        return (
            self.values,
            self.knee,
            self.following,
            self.noise,
            self.means,
            self.sizes,
            self.logs,
        )


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
    layers = [np.ascontiguousarray(w, np.float32) for w in trained.weights]
    offsets = [np.ascontiguousarray(o, np.float32) for o in trained.offsets]
    # In float32, as the weights are: one type, so that the loops are compiled once.
    center = trained.center.astype(np.float32)
    scale = trained.scale.astype(np.float32)
    given = (*evidence.facts(), center, scale, *layers, *offsets)
    # Only what is near a change can change in the next round.
    due = np.ones(labels.shape, np.bool_)
    for n in range(rounds):
        # Each round looks at less than half of what the one before looked at.
        round_share = share.part(1 - 0.5**n, 1 - 0.5 ** (n + 1))
        inside, moved = find_inside(labels), labels.copy()
        move = partial(_move, moved, labels, inside, due, *given)
        changed = np.concatenate(round_share.over_slabs(labels.shape, move))
        if not len(changed):
            break
        labels = moved
        due = _around(changed, labels.shape)
    return labels


@cache
def default_border_classifier() -> PairClassifier:
    """Return the classifier of borders that ships with the package."""
    return PairClassifier.load(
        Path(__file__).parents[1] / "weights" / "border_classifier.npz", BORDER_FEATURES
    )


@njit(cache=True, nogil=True)
def _histograms(labels, values, inside, knee, count):  # type: ignore[no-untyped-def]
    """Count log densities, label by label; voxels at a border, which are blurred, hardly count."""
    found = np.zeros((count, BINS))
    for z in range(labels.shape[0]):
        for y in range(labels.shape[1]):
            for x in range(labels.shape[2]):
                name = labels[z, y, x]
                if name > 0:
                    weight = 1.0 if inside[z, y, x] else 0.05
                    found[name, _bin_of(values[z, y, x], knee)] += weight
    return found


@njit(cache=True, nogil=True)
def _move(  # type: ignore[no-untyped-def]
    result, labels, inside, due, values, knee, following, noise, means, sizes, logs,
    center, scale, w0, w1, w2, o0, o1, o2, slab,
):  # fmt: skip
    """Write to a slab of a copy of the labels where their borders move; return where that is."""
    changed = [np.int64(0) for _ in range(0)]
    size = labels.shape
    names = np.zeros(MOST_RIVALS, np.int32)
    rows = np.zeros((MOST_RIVALS, len(center)), np.float32)
    one, two = np.zeros(len(o0), np.float32), np.zeros(len(o1), np.float32)
    for z in range(slab[0], slab[1]):
        for y in range(size[1]):
            for x in range(size[2]):
                if not due[z, y, x] or labels[z, y, x] == 0:
                    continue
                count = find_rivals(labels, z, y, x, names)
                if count == 1:
                    continue
                describe(
                    labels, inside, values, knee, following, noise, means, sizes, logs,
                    z, y, x, names[:count], rows,
                )  # fmt: skip
                best, most = 0, -np.inf
                for n in range(count):
                    # Across an edge alone it would come apart from its object.
                    if n > 0 and rows[n, FACES] == 0:
                        continue
                    logit = HOLD if n == 0 else 0.0
                    logit += _logit(rows[n], center, scale, w0, w1, w2, o0, o1, o2, one, two)
                    if logit > most:
                        best, most = n, logit
                if best > 0:
                    result[z, y, x] = names[best]
                    changed.append((z * size[1] + y) * size[2] + x)
    return np.array(changed)


@njit(cache=True, nogil=True)
def _logit(row, center, scale, w0, w1, w2, o0, o1, o2, one, two):  # type: ignore[no-untyped-def]
    """Return `PairClassifier.probability` of one row before the logistic: loops beat BLAS here."""
    for n in range(len(one)):
        one[n] = o0[n]
    for k in range(len(row)):
        # As in training: a feature far off what was learned must not decide alone.
        value = min(max((row[k] - center[k]) / scale[k], -6.0), 6.0)
        for n in range(len(one)):
            one[n] += value * w0[k, n]
    for n in range(len(two)):
        two[n] = o1[n]
    for k in range(len(one)):
        value = np.tanh(one[k])
        for n in range(len(two)):
            two[n] += value * w1[k, n]
    logit = o2[0]
    for k in range(len(two)):
        logit += np.tanh(two[k]) * w2[k, 0]
    return logit


@njit(cache=True, nogil=True)
def _around(places, size):  # type: ignore[no-untyped-def]
    """Return which voxels have a changed place within reach."""
    near = np.zeros(size, np.bool_)
    for place in places:
        z, rest = place // (size[1] * size[2]), place % (size[1] * size[2])
        y, x = rest // size[2], rest % size[2]
        near[
            max(z - REACH, 0) : z + REACH + 1,
            max(y - REACH, 0) : y + REACH + 1,
            max(x - REACH, 0) : x + REACH + 1,
        ] = True
    return near
