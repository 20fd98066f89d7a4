"""What tells whose a voxel at a border is: densities, the network's word, and who is around it."""

from __future__ import annotations

import numpy as np
from numba import njit

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
