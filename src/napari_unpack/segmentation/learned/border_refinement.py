"""Label assignment: from cells back to voxels, and borders moved to density steps.

Every voxel at a border votes among its own label and those across its six faces: by the network's
affinities alone (`assign_labels`), then also by densities on both sides (`sharpen_borders`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from napari_unpack.kernels import njit
from napari_unpack.segmentation.common.array_source import face_steps, framed
from napari_unpack.segmentation.common.density_regions import label_means
from napari_unpack.segmentation.common.morphology import dilate
from napari_unpack.tasks import SILENT, Share, Slab

# Of a voxel and its six neighbours.
MOST_LABELS = 7
# Row of a tally after those of a voxel's labels.
AIR = MOST_LABELS
# Columns of a tally: voxels within 1, those nearer counting more; plainly; within 2; within
# `REACH`; weighted sum of their densities; their weights.
NEAR, BESIDE, FARTHER, FARTHEST, DENSITY, WEIGHT = range(6)
# By how many votes another label must lead to take a voxel: in doubt nothing moves.
LEAD = 0.2
# Voxels around a border in which the mean densities of both sides are taken.
REACH = 3
# Standard deviation of one object's density, as a share of it, beside noise.
TEXTURE = 0.2
# Votes of the density at most, where every neighbouring voxel has 1 at most.
DENSITY_VOTES = 8.0
# In the last rounds every neighbour votes for its label too, one across a face with this weight,
# one across an edge or a corner with less, as it is further away: borders do not fray.
SMOOTHING = 0.5
# Of voxels that are blurred with the other side, in means; something thin has no others.
WEIGHT_AT_BORDER = 0.02

# Voxels that a border moves at most, one a round.
ROUNDS = 3
# Voxels decided about at once, each with up to 1.4 kB of measures.
AT_ONCE = 2**14

Moves = tuple[NDArray[np.int64], NDArray[np.int32]]


@dataclass(frozen=True, eq=False)
class Borders:
    """Where objects end.

    Parameters
    ----------
    inside : (Z, Y, X) ndarray of bool
        Voxels that share all faces with others of their object.
    touching : (Z, Y, X) ndarray of bool
        Voxels that share a face with another object.
    """

    inside: NDArray[np.bool_]
    touching: NDArray[np.bool_]

    @staticmethod
    def of(labels: NDArray[np.int32]) -> Borders:
        """Find the borders of (Z, Y, X) objects; 0 is background."""
        found = Borders(np.zeros(labels.shape, np.bool_), np.zeros(labels.shape, np.bool_))
        SILENT.over_slabs(labels.shape, partial(_mark_borders, labels, found))
        return found


def _mark_borders(labels: NDArray[np.int32], found: Borders, slab: Slab) -> None:
    # With a frame that is no label: no voxel has to be asked whether it lies at the volume's end.
    box = slice(*slab), slice(0, labels.shape[1]), slice(0, labels.shape[2])
    near = framed(labels, box, 1, np.int32, beyond=-1)
    _look_around(near.reshape(-1), face_steps(near.shape), found.inside[box], found.touching[box])


@njit(cache=True, nogil=True)
def _look_around(labels, steps, inside, touching):  # type: ignore[no-untyped-def]
    """Write which voxels of framed, flat labels are inside their object or touch another."""
    depth, height, width = inside.shape
    for z in range(depth):
        for y in range(height):
            place = (z + 1) * steps[1] + (y + 1) * steps[3] + 1
            for x in range(width):
                here = labels[place + x]
                if here == 0:
                    continue
                alone, met = True, False
                for k in range(6):
                    other = labels[place + x + steps[k]]
                    alone &= other == here or other < 0
                    met |= other != here and other > 0
                inside[z, y, x] = alone
                touching[z, y, x] = met


def places_in(mask: NDArray[np.bool_], slab: Slab) -> NDArray[np.int64]:
    """Return where a mask of a slab is set, in the volume.

    Parameters
    ----------
    mask : (D, Y, X) ndarray of bool
        Of the slab's D slices.
    slab : tuple of int
        See `Share.over_slabs`.

    Returns
    -------
    (N, 3) ndarray of int64
        Voxels, z y x.
    """
    # Flat, as numpy is several times slower along three axes.
    places = np.unravel_index(np.flatnonzero(mask), mask.shape)
    return np.stack([places[0] + slab[0], *places[1:]], axis=1).astype(np.int64, copy=False)


def moves_in(
    movable: NDArray[np.bool_], decide: Callable[[NDArray[np.int64]], Moves], slab: Slab
) -> Moves:
    """Return what moves in a slab.

    Parameters
    ----------
    movable : (Z, Y, X) ndarray of bool
        What is asked about.
    decide : callable
        Given voxels, (N, 3), it says which of them move and where to.
    slab : tuple of int
        See `Share.over_slabs`.
    """
    places = places_in(movable[slice(*slab)], slab)
    moves = [decide(places[n : n + AT_ONCE]) for n in range(0, max(len(places), 1), AT_ONCE)]
    return np.concatenate([m[0] for m in moves]), np.concatenate([m[1] for m in moves])


def apply_moves(labels: NDArray[np.int32], moves: Iterable[Moves]) -> NDArray[np.bool_]:
    """Write what moves to labels; return where a next round may move more.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Changed in place.
    moves : iterable of Moves
        Which voxels, (N, 3), go to which label, (N,).

    Returns
    -------
    (Z, Y, X) ndarray of bool
        All that is within `REACH` + 1 of what moved: a voxel looks so far, and whether one there is
        inside its object depends on the next.
    """
    side = REACH + 1
    near = np.zeros([-(-n // side) for n in labels.shape], np.bool_)
    for places, names in moves:
        labels[*places.T] = names
        near[*(places.T // side)] = True
    # In blocks as long as that, whose neighbours hold all of it.
    near = dilate(near, connectivity=3)
    z, y, x = labels.shape
    return near.repeat(side, axis=0)[:z].repeat(side, axis=1)[:, :y].repeat(side, axis=2)[..., :x]


@njit(cache=True, nogil=True)
def count_votes(labels, following, bar, places, names, counts, votes, faces):  # type: ignore[no-untyped-def]
    """Add up the affinities of some voxels with the labels across their faces.

    Parameters
    ----------
    labels, following
        See `assign_labels`.
    bar : float
        Taken off every affinity, which is 1 at most.
    places : (N, 3) ndarray of int64
        The voxels.
    names : (N, MOST_LABELS) ndarray of int32
        Labels at every voxel, its own first; gets those that are missing.
    counts : (N,) ndarray of int64
        How many these are; gets how many they become.
    votes : (N, MOST_LABELS) ndarray of float64
        Gets the affinities added.
    faces : (N, AIR + 1) ndarray of int64
        Gets the faces counted, those to air in column `AIR`.
    """
    size = labels.shape
    for p in range(len(places)):
        z, y, x = places[p, 0], places[p, 1], places[p, 2]
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
            name = labels[k, j, i]
            if name == 0:
                faces[p, AIR] += 1
                continue
            n = 0
            while n < counts[p] and names[p, n] != name:
                n += 1
            if n == counts[p]:
                names[p, n] = name
                counts[p] += 1
            affinity = following[axis, z, y, x] if ahead else following[axis, k, j, i]
            votes[p, n] += affinity / 255.0 - bar
            faces[p, n] += 1


@njit(cache=True, nogil=True)
def _tally(  # type: ignore[no-untyped-def]
    labels, inside, values, places, low, high, names, counts, near, itself, found, around
):
    """Do what `tally` says; the windows are from `low` to `high`."""
    for p in range(len(places)):
        z, y, x = places[p, 0], places[p, 1], places[p, 2]
        many, beside = counts[p], 0.0
        for k in range(low[p, 0], high[p, 0]):
            for j in range(low[p, 1], high[p, 1]):
                apart = max(abs(k - z), abs(j - y))
                for i in range(low[p, 2], high[p, 2]):
                    reach = max(apart, abs(i - x))
                    if reach <= 1:
                        beside += values[k, j, i]
                    name = labels[k, j, i]
                    if name == 0:
                        found[p, AIR, BESIDE] += reach <= 1
                        found[p, AIR, FARTHEST] += 1
                        continue
                    n = 0
                    while n < many and names[p, n] != name:
                        n += 1
                    if n == many or (reach == 0 and not itself):
                        continue
                    weight = 1.0 if inside[k, j, i] else WEIGHT_AT_BORDER
                    found[p, n, DENSITY] += weight * values[k, j, i]
                    found[p, n, WEIGHT] += weight
                    found[p, n, FARTHEST] += 1
                    if reach <= 2:
                        found[p, n, FARTHER] += 1
                        if reach <= 1:
                            found[p, n, NEAR] += near[abs(k - z) + abs(j - y) + abs(i - x)]
        around[p] = beside


def tally(
    labels: NDArray[np.int32],
    inside: NDArray[np.bool_],
    values: NDArray[np.float32],
    places: NDArray[np.int64],
    names: NDArray[np.int32],
    counts: NDArray[np.int64],
    even: float,
    itself: bool,
    found: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Add up what lies within `REACH` of some voxels, by label.

    Parameters
    ----------
    labels, inside : (Z, Y, X) ndarray of int32 and bool
        Objects, and which voxels are inside them; see `Borders`.
    values : (Z, Y, X) ndarray of float32
        Density above air.
    places, names, counts
        See `count_votes`.
    even : float
        What a voxel across a face counts in column `NEAR`; one across an edge or a corner counts
        less, as it is further away.
    itself : bool
        Whether the voxel in the middle counts.
    found : (N, AIR + 1, WEIGHT + 1) ndarray of float64
        Gets the sums added, those of air in columns `BESIDE` and `FARTHEST`, which no label has
        or all have.

    Returns
    -------
    (N,) ndarray of float64
        Sum of the densities at and right beside every voxel.
    """
    low = np.maximum(places - REACH, 0)
    high = np.minimum(places + (REACH + 1), labels.shape)
    near = np.append(0.0, even / np.sqrt(np.arange(1, 4)))
    around = np.zeros(len(places))
    _tally(labels, inside, values, places, low, high, names, counts, near, itself, found, around)
    return around


def assign_labels(
    cells: NDArray[np.int32],
    foreground: NDArray[np.bool_],
    following: NDArray[np.uint8],
    share: Share = SILENT,
) -> NDArray[np.int32]:
    """Label voxels as their cells are, and move the borders to where affinities are low.

    Parameters
    ----------
    cells : (z, y, x) ndarray of int32
        Labels of cells of 2 x 2 x 2 voxels.
    foreground : (Z, Y, X) ndarray of bool
        Voxels to label.
    following : (3, Z, Y, X) ndarray of uint8
        Affinity with the next voxel; see `boundary_network.Prediction`.
    share : Share
    """
    full = cells.repeat(2, axis=0).repeat(2, axis=1).repeat(2, axis=2)
    z, y, x = foreground.shape
    labels = np.where(foreground, full[:z, :y, :x], np.int32(0))
    for n in range(ROUNDS):
        vote = partial(moves_in, Borders.of(labels).touching, partial(_vote, labels, following))
        apply_moves(labels, share.part(n / ROUNDS, (n + 1) / ROUNDS).over_slabs(labels.shape, vote))
    return labels


def _vote(
    labels: NDArray[np.int32], following: NDArray[np.uint8], places: NDArray[np.int64]
) -> Moves:
    """Return the voxels that go to another label with a higher affinity across their faces."""
    names, counts, votes, _ = _votes(labels, following, 0.5, places)
    best = _leading(names, counts, votes)
    moved = best != names[:, 0]
    return places[moved], best[moved]


def _votes(
    labels: NDArray[np.int32], following: NDArray[np.uint8], bar: float, places: NDArray[np.int64]
) -> tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.float64], NDArray[np.bool_]]:
    """Return the names, counts and votes of `count_votes`, and which voxels have a face to air."""
    names = np.zeros((len(places), MOST_LABELS), np.int32)
    names[:, 0] = labels[*places.T]
    counts = np.ones(len(places), np.int64)
    votes = np.zeros((len(places), MOST_LABELS))
    faces = np.zeros((len(places), AIR + 1), np.int64)
    count_votes(labels, following, bar, places, names, counts, votes, faces)
    return names, counts, votes, faces[:, AIR] > 0


def _leading(
    names: NDArray[np.int32], counts: NDArray[np.int64], votes: NDArray[np.float64]
) -> NDArray[np.int32]:
    """Return which label of every voxel has most votes; one that comes later must lead."""
    best, most = names[:, 0].copy(), votes[:, 0].copy()
    for n in range(1, int(counts.max(initial=1))):
        leads = (counts > n) & (votes[:, n] > most + LEAD)
        best[leads], most[leads] = names[leads, n], votes[leads, n]
    return best


def sharpen_borders(
    labels: NDArray[np.int32],
    density: NDArray[np.generic],
    air: float,
    following: NDArray[np.uint8],
    noise: float,
    dense: float = np.inf,
    rounds: int = 3,
    smoothing: int = 2,
    share: Share = SILENT,
) -> NDArray[np.int32]:
    """Move borders between labels to half-way between the densities on both sides.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Objects, 0 background. Not changed.
    density : (Z, Y, X) ndarray
        Density; NaN counts as air.
    air : float
        Density of the background.
    following : (3, Z, Y, X) ndarray of uint8
        Affinity with the next voxel; see `boundary_network.Prediction`.
    noise : float
        Standard deviation of the density's noise.
    dense : float
        Above air; objects denser than this on average also lose to the background what has less
        than half of their density: it is the blur around them.
    rounds : int
        Voxels that a border moves at most.
    smoothing : int
        Rounds after these that smooth it.
    share : Share
    """
    # A voxel between two objects goes with the one that has most votes: by how near its density
    # (not its logarithm: a blurred border lies half-way) is to the mean of the object's voxels
    # around it, those inside it counting most; by the affinities across its faces; and by how many
    # faces it shares. Where both sides are of one density only the last two count. In the end its
    # 26 neighbours vote as well, but not before: they would hold back a flat border that has still
    # to move. About 343 reads a voxel of border and round.
    values = np.nan_to_num(density.astype(np.float32), nan=air) - np.float32(air)
    share()
    blurred = label_means(labels, values) > dense
    turns = (0.0,) * rounds + (SMOOTHING,) * smoothing
    labels = labels.copy()
    due = np.ones(labels.shape, np.bool_)
    for n, even in enumerate(turns):
        if n == rounds:
            # By other rules from here on.
            due[:] = True
        round_share = share.part(n / len(turns), (n + 1) / len(turns))
        borders = Borders.of(labels)
        movable = borders.touching & due
        if blurred.any():
            ends = np.flatnonzero((labels > 0) & ~borders.inside & due)
            movable.reshape(-1)[ends] |= blurred[labels.reshape(-1)[ends]]
        decide = partial(_move, labels, values, borders.inside, following, noise, blurred, even)
        move = partial(moves_in, movable, decide)
        due = apply_moves(labels, round_share.over_slabs(labels.shape, move))
    return labels


def _move(
    labels: NDArray[np.int32],
    values: NDArray[np.float32],
    inside: NDArray[np.bool_],
    following: NDArray[np.uint8],
    noise: float,
    blurred: NDArray[np.bool_],
    even: float,
    places: NDArray[np.int64],
) -> Moves:
    """Return which of some voxels move, and the labels they go to."""
    names, counts, votes, bare = _votes(labels, following, 0.0, places)
    # Only dense things have a halo above the foreground's level.
    bare &= blurred[names[:, 0]]
    kept = bare | (counts > 1)
    places, names, counts, bare = places[kept], names[kept], counts[kept], bare[kept]
    found = np.zeros((len(places), AIR + 1, WEIGHT + 1))
    found[:, :MOST_LABELS, NEAR] = votes[kept]
    tally(labels, inside, values, places, names, counts, even, True, found)
    # Few voxels have more than two labels around.
    most = int(counts.max(initial=1))
    found, present = found[:, :most], np.arange(most) < counts[:, None]
    means = found[..., DENSITY] / np.where(present, found[..., WEIGHT], 1.0)
    low = np.where(present, means, np.inf).min(axis=1)
    high = np.where(present, means, -np.inf).max(axis=1)
    spread = noise + TEXTURE * np.maximum(low, 0.0) + 1e-6
    step = high - low
    # Half the square of the step over its spread: a log-likelihood, as votes add up.
    loud = np.minimum(DENSITY_VOTES, (step / spread) ** 2 / 2)
    here = values[*places.T].astype(np.float64)
    # Noise beyond both means says no more than the mean itself.
    value = np.clip(here, low, high)
    off = (value[:, None] - means) / np.maximum(step, 1e-6)[:, None]
    best = _leading(names, counts, found[..., NEAR] - loud[:, None] * off**2)
    best[bare & (here < means[:, 0] / 2)] = 0
    moved = best != names[:, 0]
    return places[moved], best[moved]
