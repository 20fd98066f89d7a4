"""Borders between touching objects, drawn voxel by voxel by a small trained judge.

A thin plate on a box is a few voxels thick, all of them at a border, blurred into the box on one
side and into air on the other. No one measure tells whose such a voxel is: not its density, not
what the network says of its faces, not who is around it. A judge trained on drawn bags weighs them.

What tells whose a voxel at a border is: densities, the network's word, and who is around it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from napari_unpack.segmentation.common.density_regions import MaterialScale
from napari_unpack.segmentation.learned.border_refinement import find_inside
from napari_unpack.segmentation.learned.pair_classifier import PairClassifier

FEW = 7
"""Labels at most that are weighed at a voxel: its own, those across its six faces, and others."""

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
"""Of a label at a voxel, beside its rival there, the other label with most voxels around:
whether it holds the voxel; what the network says of the faces it shares with both, and how many
they are; how many of the 26 voxels around (nearer ones count more) and what shares of the 124 and
342 around are either's, and air's; by how much nearer the voxel's density is to the label's local
mean than to the rival's, over the noise and over their step; that step over the noise; how far
the voxel lies below the mean of its neighbourhood, over the noise; by how much likelier its density
is in the whole label than in the whole rival; density over the local mean; by how much larger the
label is."""

GRAINY = 0.05
"""What matter varies by itself, a share of its density."""

BINS, WIDE = 160, 0.06
"""Bins of log density, and how wide they are."""


@njit(cache=True, nogil=True)
def bin_of(value, knee):  # type: ignore[no-untyped-def]
    """Return the bin of a density above air; see `materials.MaterialScale`."""
    return int(min(np.log1p(max(value, 0.0) / knee) / WIDE, BINS - 1.0))


@njit(cache=True, nogil=True)
def find_rivals(labels, z, y, x, names):  # type: ignore[no-untyped-def]
    """Write the labels of a voxel and of the 26 around it, few as they are; return how many.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        0 is background, which has no claim.
    z, y, x : int
        The voxel, of a label.
    names : (FEW,) ndarray of int32
        Gets the labels, the voxel's own first.

    Returns
    -------
    int
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
                    if n == count and count < FEW:
                        names[n] = name
                        count += 1
    return count


@njit(cache=True, nogil=True)
def describe(  # type: ignore[no-untyped-def]
    labels, inside, values, knee, following, noise, means, sizes, logs, z, y, x, names, rows
):
    """Write what tells about every label at a voxel.

    Parameters
    ----------
    labels, inside : (Z, Y, X) ndarray of int32 and bool
        Objects, and which voxels are inside them; see `sharpening.find_inside`.
    values, knee, following, noise, means, sizes, logs
        See `borders.Scene`.
    z, y, x : int
        The voxel.
    names : (N,) ndarray of int32
        See `find_rivals`; at least two.
    rows : (FEW, F) ndarray of float32
        Gets N rows in the order of `BORDER_FEATURES`.
    """
    count = len(names)
    # By label: nearer ones count more; within 2, within 3; local mean; faces, what is said of them.
    tallies = np.zeros((count, 6))
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
                            tallies[n, 0] += 1 / np.sqrt(abs(k - z) + abs(j - y) + abs(i - x))
                        tallies[n, 1] += reach <= 2
                        tallies[n, 2] += 1
                        # Something thin has no inside.
                        weight = 1.0 if inside[k, j, i] else 0.02
                        tallies[n, 3] += weight * values[k, j, i]
                        weights[n] += weight
    _ask_faces(labels, following, z, y, x, names, tallies)
    here = values[z, y, x]
    lifted = bin_of(here, knee)
    for n in range(count):
        if weights[n] < 0.5:
            tallies[n, 3] += 0.5 * means[names[n]]
            weights[n] += 0.5
        tallies[n, 3] /= weights[n]
    for n in range(count):
        rival = -1
        for m in range(count):
            if m != n and (rival < 0 or tallies[m, 1] > tallies[rival, 1]):
                rival = m
        mine, other = tallies[n], tallies[rival]
        step = mine[3] - other[3]
        spread = noise + GRAINY * max(min(mine[3], other[3]), 0.0) + 1e-6
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
def _ask_faces(labels, following, z, y, x, names, tallies):  # type: ignore[no-untyped-def]
    """Add to columns 4 and 5 the faces shared with every label, and the network's word on them."""
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
        said = following[axis, z, y, x] if ahead else following[axis, k, j, i]
        for n in range(len(names)):
            if names[n] == labels[k, j, i]:
                tallies[n, 4] += 1
                tallies[n, 5] += said / 255.0


ROUNDS = 6
"""Voxels that a border moves at most."""

HOLD = 1.0
"""By how much more, before the logistic, must speak for another label."""

RARE = 0.005
"""Share that every density has of every object at least."""

FACES = BORDER_FEATURES.index("faces")

REACH = 4
"""Voxels to every side whose labels `border_features.describe` goes by: it looks three far, and
whether one there is inside hangs on the next."""


@dataclass(frozen=True, eq=False)
class Scene:
    """What borders are judged by, besides the labels.

    Parameters
    ----------
    values : (Z, Y, X) ndarray of float32
        Density above air.
    knee : float
        See `materials.MaterialScale`.
    following : (3, Z, Y, X) ndarray of uint8
        That a voxel belongs with the next; see `boundaries.Prediction`.
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
        scale: MaterialScale,
        following: NDArray[np.uint8],
        noise: float,
    ) -> Scene:
        """Measure every label as it is now.

        Parameters
        ----------
        labels : (Z, Y, X) ndarray of int32
            Objects; 0 is background.
        density : (Z, Y, X) ndarray
            NaN and infinities count as air.
        scale : MaterialScale
            How densities are compared.
        following, noise
            See `Scene`.

        Returns
        -------
        Scene
        """
        air = float(np.float32(scale.air))
        values = density.astype(np.float32)
        # What is not measured is air, as for all of the package.
        np.nan_to_num(values, copy=False, nan=air, posinf=air, neginf=air)
        values -= np.float32(air)
        sizes = np.maximum(np.bincount(labels.reshape(-1)), 1).astype(np.float64)
        means = np.bincount(labels.reshape(-1), values.reshape(-1), len(sizes)) / sizes
        counts = _histograms(labels, values, find_inside(labels), scale.knee, len(sizes))
        counts = gaussian_filter1d(counts, 1.0, axis=1)
        shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1e-9)
        logs = np.log(shares + RARE)
        return Scene(values, scale.knee, following, noise, means, sizes, logs)

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
    scene: Scene,
    judge: PairClassifier | None = None,
    rounds: int = ROUNDS,
) -> NDArray[np.int32]:
    """Give voxels at borders to the one of the labels around them that they are most likely of.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Objects, 0 background. Not changed.
    scene : Scene
        What they are judged by.
    judge : PairClassifier, optional
        Over `border_features.BORDER_FEATURES`, of three layers; by default the one that ships
        with the package.
    rounds : int
        Voxels that a border moves at most.

    Returns
    -------
    (Z, Y, X) ndarray of int32
        No voxel becomes background, none of it an object's.

    Notes
    -----
    Borders are to lie roughly right already, see `sharpening`. Only a label that shares a face
    with a voxel may take it. All is counted in voxels, whatever their size. Rounds after the first
    look again only at what has changed and is near it. About 350 reads and 2000 multiplications a
    voxel of border.
    """
    trained = judge or default_border_judge()
    layers = [np.ascontiguousarray(w, np.float32) for w in trained.weights]
    offsets = [np.ascontiguousarray(o, np.float32) for o in trained.offsets]
    center = trained.center.astype(np.float32)
    scale = trained.scale.astype(np.float32)
    given = (*scene.facts(), center, scale, *layers, *offsets)
    due = np.ones(labels.shape, np.bool_)
    for _ in range(rounds):
        inside = find_inside(labels)
        moved, changed = _moved(labels, inside, due, *given)
        if not len(changed):
            break
        labels = moved
        due = _around(changed, labels.shape)
    return labels


@cache
def default_border_judge() -> PairClassifier:
    """Return the judge of borders that ships with the package."""
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
                    found[name, bin_of(values[z, y, x], knee)] += weight
    return found


@njit(cache=True, nogil=True)
def _moved(  # type: ignore[no-untyped-def]
    labels, inside, due, values, knee, following, noise, means, sizes, logs,
    center, scale, w0, w1, w2, o0, o1, o2,
):  # fmt: skip
    result = labels.copy()
    changed = [np.int64(0) for _ in range(0)]
    size = labels.shape
    names = np.zeros(FEW, np.int32)
    rows = np.zeros((FEW, len(center)), np.float32)
    one, two = np.zeros(len(o0), np.float32), np.zeros(len(o1), np.float32)
    for z in range(size[0]):
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
                    said = HOLD if n == 0 else 0.0
                    said += _answer(rows[n], center, scale, w0, w1, w2, o0, o1, o2, one, two)
                    if said > most:
                        best, most = n, said
                if best > 0:
                    result[z, y, x] = names[best]
                    changed.append((z * size[1] + y) * size[2] + x)
    return result, np.array(changed)


@njit(cache=True, nogil=True)
def _answer(row, center, scale, w0, w1, w2, o0, o1, o2, one, two):  # type: ignore[no-untyped-def]
    """Return what `PairClassifier.probability` says of a row, before the logistic."""
    one[:] = o0
    for k in range(len(row)):
        value = min(max((row[k] - center[k]) / scale[k], -6.0), 6.0)
        for n in range(len(one)):
            one[n] += value * w0[k, n]
    two[:] = o1
    for k in range(len(one)):
        value = np.tanh(one[k])
        for n in range(len(two)):
            two[n] += value * w1[k, n]
    said = o2[0]
    for k in range(len(two)):
        said += np.tanh(two[k]) * w2[k, 0]
    return said


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
