"""The pieces that objects are made of, how they touch, and how sure it was what belongs together.

Kept from the steps of a method (`common.joins.Level`), but independent of them: the doubts that a
person reviews are worked out of this and of the labels as they are.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.common.density_regions import intersected_labels, log_density
from napari_unpack.segmentation.common.joins import Level, Steps, joint_of
from napari_unpack.segmentation.common.merging import root, roots
from napari_unpack.segmentation.common.region import MIN_OBJECT_VOXELS

# Thinner pieces, in voxels, are where a border was drawn anew after the step that made it.
THINNEST = 1.5
# Probability that two pieces are one object where no classifier was asked: rules joined them
# (cables, walls with what they hold), rules took them apart, or they hardly touch.
BY_RULE, TAKEN_APART, HARDLY_TOUCH = 0.8, 0.1, 0.03

Pairs = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Evidence:
    """Pieces, and the pairs of them that touch.

    Parameters
    ----------
    packed : bytes
        The pieces of every voxel, compressed; see `pieces`.
    shape : (int, int, int)
    sums : (M, 5) ndarray of float64
        By piece: voxels, log density, its square, probability of being an object's, and faces to
        what is none. Row 0 is empty.
    pairs : (N, 2) ndarray of int64
        Pieces that touch, the smaller first.
    contact : (N, 3) ndarray of float64
        Of each pair: faces of voxels, the mean log density on both sides, and its step, over them.
    chance : (N,) ndarray of float64
        Probability that both are one object, as the method had it.
    tree : (N,) ndarray of bool
        The pairs by which objects hold together: without one of them, its object is two.
    """

    packed: bytes
    shape: tuple[int, int, int]
    sums: Floats
    pairs: Pairs
    contact: Floats
    chance: Floats
    tree: NDArray[np.bool_]

    @staticmethod
    def of(
        pieces: NDArray[np.int32],
        sums: Floats,
        pairs: Pairs,
        contact: Floats,
        chance: Floats,
        tree: NDArray[np.bool_],
    ) -> Evidence:
        """Return the evidence of pieces that are not compressed yet.

        Parameters
        ----------
        pieces : (Z, Y, X) ndarray of int32
        sums, pairs, contact, chance, tree
            As in the class.
        """
        z, y, x = pieces.shape
        packed = zlib.compress(pieces.tobytes(), 1)
        return Evidence(packed, (z, y, x), sums, pairs, contact, chance, tree)

    @property
    def pieces(self) -> NDArray[np.int32]:
        """Return the piece of every voxel, (Z, Y, X), 0 for none; unpacked anew each time."""
        return np.frombuffer(zlib.decompress(self.packed), np.int32).reshape(self.shape)


def gather(labels: NDArray[np.int32], steps: Steps) -> Evidence | None:
    """Return the evidence behind labels; None where the method noted nothing.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Objects as they came out in the end.
    steps : Steps
        Taken on the way to them.
    """
    if not steps.levels or steps.seen is None:
        return None
    raw = labels
    for level in steps.levels:
        raw = intersected_labels(raw, level.names)
    count = int(raw.max(initial=0)) + 1
    flat = raw.reshape(-1)
    # Every piece lies in one part of each step.
    names = np.zeros((1 + len(steps.levels), count), np.int64)
    found = (labels, *(level.names for level in steps.levels))
    for row, array in zip(names, found, strict=True):
        row[flat] = array.reshape(-1)
    names[:, 0] = 0
    lifted = log_density(steps.seen.density, labels > 0, steps.seen.scale)
    sums, pairs, contact = _measured(raw, lifted, steps.seen.matter)
    # What no step has seen is the air that a wall holds: it goes with the wall.
    unseen = np.asarray(~names[1:].any(axis=0))
    final = _without_slivers(sums[:, 0], pairs, contact[:, 0], names[0], unseen)
    stays = np.unique(final)
    number = np.zeros(count, np.int64)
    number[stays] = np.arange(len(stays))
    final = number[final]
    total = np.zeros((len(stays), sums.shape[1]))
    np.add.at(total, final, sums)
    pairs, contact = _gathered(final[pairs], contact)
    names = names[:, stays]
    chance, order = _chances(pairs, names, steps.levels)
    tree = _tree(pairs, names[0], order, contact[:, 0])
    return Evidence.of(final.astype(np.int32)[raw], total, pairs, contact, chance, tree)


def _measured(
    pieces: NDArray[np.int32], lifted: NDArray[np.float32], matter: NDArray[np.uint8]
) -> tuple[Floats, Pairs, Floats]:
    """Return sums by piece, and the pairs that touch with how they do."""
    count, flat = int(pieces.max(initial=0)) + 1, pieces.reshape(-1)
    inside = flat > 0
    own, value = flat[inside], lifted.reshape(-1)[inside].astype(np.float64)
    sums = np.zeros((count, 5))
    said = matter.reshape(-1)[inside] / 255.0
    for k, weight in enumerate((None, value, value * value, said)):
        sums[:, k] = np.bincount(own, weight, count)
    keys, means, gaps = [], [], []
    for axis in range(3):
        here, heights = np.moveaxis(pieces, axis, 0), np.moveaxis(lifted, axis, 0)
        meet = here[:-1] != here[1:]
        one, two = here[:-1][meet].astype(np.int64), here[1:][meet].astype(np.int64)
        sums[:, 4] += np.bincount(np.maximum(one, two)[(one == 0) | (two == 0)], minlength=count)
        both = (one > 0) & (two > 0)
        keys.append((np.minimum(one, two) * count + np.maximum(one, two))[both])
        low, high = heights[:-1][meet][both], heights[1:][meet][both]
        means.append((low + high) / 2)
        gaps.append(np.abs(low - high))
    found, place = np.unique(np.concatenate(keys), return_inverse=True)
    columns = (None, np.concatenate(means), np.concatenate(gaps))
    contact = [np.bincount(place, weight, len(found)) for weight in columns]
    return sums, np.stack(np.divmod(found, count), axis=1), np.stack(contact, axis=1)


def _without_slivers(
    voxels: Floats, pairs: Pairs, area: Floats, label: Pairs, unseen: NDArray[np.bool_]
) -> Pairs:
    """Return the piece that each becomes part of, itself where it is no sliver."""
    inner = label[pairs[:, 0]] == label[pairs[:, 1]]
    pairs, area = pairs[inner], area[inner]
    count = len(voxels)
    surface = np.bincount(pairs[:, 0], area, count) + np.bincount(pairs[:, 1], area, count)
    most, rising = np.zeros(count, np.int64), pairs[np.argsort(area, kind="stable")]
    # The last one written touches most.
    most[rising.reshape(-1)] = rising[:, ::-1].reshape(-1)
    sliver = unseen | (voxels < MIN_OBJECT_VOXELS) | (voxels < THINNEST * surface)
    owner = np.arange(count)
    for name in np.lexsort((voxels, ~unseen)).tolist():
        if not (sliver[name] and most[name]):
            continue
        other = root(owner, int(most[name]))
        # Two slivers may choose each other; the larger then stays.
        if other != name:
            owner[name] = other
    return roots(owner)


def _gathered(pairs: Pairs, contact: Floats) -> tuple[Pairs, Floats]:
    """Add up what became one pair, the smaller first, and drop what became one piece."""
    pairs = np.sort(pairs, axis=1)
    apart = pairs[:, 0] != pairs[:, 1]
    found, place = np.unique(pairs[apart], axis=0, return_inverse=True)
    total = np.zeros((len(found), contact.shape[1]))
    np.add.at(total, place.reshape(-1), contact[apart])
    return found, total


def _chances(
    pairs: Pairs, names: NDArray[np.int64], levels: Sequence[Level]
) -> tuple[Floats, NDArray[np.int64]]:
    """Return the probability that each pair is one object, and when it became one.

    The second is (N, 2): the step and the number of the join, later than all for rules.
    """
    joined = names[0][pairs[:, 0]] == names[0][pairs[:, 1]]
    chance = np.where(joined, BY_RULE, HARDLY_TOUCH)
    order = np.full((len(pairs), 2), len(levels))
    for k, level in enumerate(levels):
        ends = names[k + 1][pairs]
        asked = (ends[:, 0] != ends[:, 1]) & (ends > 0).all(axis=1)
        joint = np.where(asked, joint_of(level.joined, ends), -1)
        said = np.array([c for _, _, c in level.joined] or [0.0])
        met = joint >= 0
        # Of the last step that told the two apart: it knew what the others did.
        order[met], chance[met] = (
            np.stack([np.full(met.sum(), k), joint[met]], axis=1),
            said[joint[met]],
        )
        order[asked & ~met] = len(levels)
        chance[met & ~joined] = TAKEN_APART
        root = _roots(level, int(names[k + 1].max(initial=0)))
        for n in np.flatnonzero(asked & ~met).tolist():
            one, two = sorted((int(root[ends[n, 0]]), int(root[ends[n, 1]])))
            unknown = BY_RULE if joined[n] else HARDLY_TOUCH
            chance[n] = level.apart.get((one, two), unknown)
    return chance, order


def _roots(level: Level, top: int) -> NDArray[np.int64]:
    owner = np.arange(max([top, *(max(one, two) for one, two, _ in level.joined)]) + 1)
    for one, two, _ in level.joined:
        owner[two] = one
    return roots(owner)


def _tree(pairs: Pairs, label: Any, order: NDArray[np.int64], area: Floats) -> NDArray[np.bool_]:
    """Return which pairs hold objects together: the first to join, those that touch most first."""
    owner, kept = np.arange(len(label)), np.zeros(len(pairs), np.bool_)
    inner = np.flatnonzero(label[pairs[:, 0]] == label[pairs[:, 1]])
    for k in inner[np.lexsort((-area[inner], order[inner, 1], order[inner, 0]))].tolist():
        one, two = (root(owner, n) for n in pairs[k].tolist())
        if one != two:
            owner[two], kept[k] = one, True
    return kept
