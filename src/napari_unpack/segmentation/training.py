"""Training examples: true objects of labelled volumes, and regions that are not one object."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence, Sized
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import is_integer, voxel_size
from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.geometry.masks import unmasked
from napari_unpack.geometry.relabeling import MOST_OBJECTS, compact_labels
from napari_unpack.segmentation.common.adjacency import find_neighbours
from napari_unpack.segmentation.common.density_regions import air_offset
from napari_unpack.segmentation.common.region import Region
from napari_unpack.segmentation.common.validation import (
    Spacing,
    checked_form,
    checked_labels,
)
from napari_unpack.segmentation.confidence.examples import FEWEST, SMALLEST, usable_examples
from napari_unpack.segmentation.confidence.features import features
from napari_unpack.segmentation.confidence.oracle import Oracle, fit_features
from napari_unpack.tasks import SILENT, Progress, Share, relayed

# Share of the surface of the lesser over which two objects touch where their union is an example.
TOUCHING = 0.02


def true_objects(
    density: NDArray[np.generic],
    labels: NDArray[np.integer],
    spacing: Spacing,
    smallest: int = SMALLEST,
) -> Iterator[Region]:
    """Yield every labelled object of at least so many voxels.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
    labels : (Z, Y, X) ndarray of int
        True objects.
    spacing : (float, float, float) of mm, z y x
    smallest : int
        Voxels.
    """
    boxes, air = label_boxes(labels), air_offset(density, labels)
    for name in boxes.ids[boxes.counts >= smallest].tolist():
        box = boxes.slices(name)
        yield Region.of(labels[box] == name, density, box, spacing, air)


def merged_pairs(
    density: NDArray[np.generic],
    labels: NDArray[np.integer],
    spacing: Spacing,
    share: Share = SILENT,
) -> Iterator[Region]:
    """Yield the union of every two objects that touch over a share of the smaller's surface.

    Parameters
    ----------
    density, labels, spacing
        As for `true_objects`.
    share : Share
    """
    boxes = label_boxes(labels)
    names = boxes.ids
    compact = np.searchsorted(names, labels).astype(np.int32) + 1
    compact[labels == 0] = 0
    if len(names) < 2:
        return
    near = find_neighbours(compact, spacing)
    pairs, area = near.pairs()
    touching = area > TOUCHING * near.surface[pairs].min(axis=1)
    air = air_offset(density, labels)
    for pair in share.over(pairs[touching].tolist()):
        # Of the volume, all but the box around both would be looked through in vain.
        box = boxes.around(int(names[k - 1]) for k in pair)
        part = compact[box]
        both = (part == pair[0]) | (part == pair[1])
        yield Region.of(both, density, box, spacing, air)


class Labelled(Protocol):
    """A volume whose objects are known: a simulated bag, a scan with labels."""

    @property
    def volume(self) -> NDArray[np.generic]:
        """(Z, Y, X) density."""

    @property
    def labels(self) -> NDArray[np.integer] | None:
        """(Z, Y, X) true objects, 0 background; a volume without them is refused."""

    @property
    def spacing(self) -> tuple[float, float, float]:
        """Voxel size z y x, mm."""


def train(bags: Iterable[Labelled], seed: int = 0, progress: Progress | None = None) -> Oracle:
    """Learn a confidence from labelled volumes.

    Parameters
    ----------
    bags : iterable of Labelled
        Used one after another, so that they need not all be in memory. All their objects are
        examples; unions of two that touch, and halves, are counterexamples.
    seed : int
        Of the planes that cut objects in two, and of the mixtures.
    progress : callable, optional
        Called with (fraction in [0, 1], text) twice a second or more often; the fraction stays 0
        where the number of volumes is not known. Raising in it cancels.

    Raises
    ------
    TypeError, ValueError
        If a volume cannot be used, see `oracle_examples`, there are fewer than eight objects, or
        the seed is no whole number of 0 or more.
    """
    if hasattr(bags, "labels") or not np.iterable(bags):
        raise TypeError(
            f"bags must be volumes with labels, one after another, got {type(bags).__name__}: "
            "give [bag] for a single one"
        )
    if not is_integer(seed) or seed < 0:
        raise ValueError(f"seed must be a whole number of 0 or more, got {seed!r}")
    return relayed(lambda report: _trained(bags, seed, Share(report)), progress)


def _trained(bags: Iterable[Labelled], seed: int, share: Share) -> Oracle:
    good: list[NDArray[np.float64]] = []
    bad: list[NDArray[np.float64]] = []
    total = len(bags) if isinstance(bags, Sized) else 0
    for k, bag in enumerate(bags):
        at, ended = (0.9 * n / total if total else 0.0 for n in (k, k + 1))
        part = share.part(at, ended, f"Learning from volume {k + 1}: {len(good)} objects so far")
        for rows, more in zip((good, bad), oracle_examples(bag, seed + k, part), strict=True):
            rows.extend(more)
    if len(good) < FEWEST:
        raise ValueError(
            f"an oracle needs at least {FEWEST} objects of {SMALLEST} voxels or more to learn "
            f"from, got {len(good)}"
        )
    fitting = share.part(0.9, 1.0, f"Learning from {len(good)} objects")
    wrong = np.array(bad) if len(bad) >= FEWEST else None
    oracle = fit_features(np.array(good), wrong, seed, fitting)
    fitting(1.0)
    return oracle


@dataclass(frozen=True, eq=False)
class _Examples:
    volume: NDArray[np.generic]
    labels: NDArray[np.integer]
    spacing: tuple[float, float, float]


def train_on_examples(
    volume: NDArray[np.generic],
    labels: NDArray[np.integer],
    spacing: Sequence[float],
    examples: Iterable[int],
    progress: Progress | None = None,
) -> Oracle:
    """Learn a confidence from the objects of one volume that a person marked as examples.

    Parameters
    ----------
    volume : (Z, Y, X) ndarray
    labels : (Z, Y, X) ndarray of int
        Objects, right and wrong ones.
    spacing : (3,) sequence of float, mm z y x
    examples : iterable of int
        Labels of those that are exactly one object each; at least eight of 64 voxels or more.
    progress
        As for `train`.

    Raises
    ------
    ValueError
        If there are fewer than eight.
    """
    wanted = np.array(sorted(examples), np.int64)
    kept = np.where(np.isin(labels, wanted), labels, 0)
    boxes = label_boxes(kept)
    usable = usable_examples(wanted, boxes.ids, boxes.counts)
    if usable < FEWEST:
        raise ValueError(
            f"an oracle needs at least {FEWEST} examples of {SMALLEST} voxels or more to be "
            f"trained on; of {len(wanted)} marked, {usable} are that large"
        )
    bag = _Examples(np.asarray(volume), kept, voxel_size(spacing))
    return train([bag], progress=progress)


def oracle_examples(
    bag: Labelled, seed: int = 0, share: Share = SILENT
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    """Return the feature rows of the true objects of a volume, and of false ones.

    Parameters
    ----------
    bag : Labelled
        Objects of fewer than 64 voxels are left out.
    seed : int
        Of the planes that cut objects in two.
    share : Share

    Raises
    ------
    TypeError
        If it is no such volume, or its labels are not integers.
    ValueError
        If the volume has no labels of its shape, one is negative, or the spacing is not usable.
    """
    if not all(hasattr(bag, name) for name in ("volume", "labels", "spacing")):
        raise TypeError(
            "a volume to learn from must have volume, labels and spacing, as load_volume and "
            f"simulate_bag give it, got {type(bag).__name__}"
        )
    volume, given = unmasked(bag.volume, np.nan), bag.labels
    labels = None if given is None else unmasked(given, 0)
    if labels is None or labels.shape != volume.shape or not labels.any():
        raise ValueError("a volume to learn from needs labels of its own shape; segment it first")
    checked_form(volume.shape, volume.dtype)
    labels, size = checked_labels(labels, "labels"), voxel_size(bag.spacing)
    if labels.max() > MOST_OBJECTS:
        # Tables have a row for each ID up to the largest.
        labels = compact_labels(labels)[0]
    boxes = label_boxes(labels)
    if len(specks := boxes.ids[boxes.counts < SMALLEST]):
        # A brush leaves them: an object with a speck of its own is no two that were merged.
        labels = np.where(np.isin(labels, specks), 0, labels)
    objects = list(true_objects(volume, labels, size))
    share(0.1)
    good = [features(region) for region in share.part(0.1, 0.4).over(objects)]
    # Made one by one: thousands of pairs take long to make, and much memory.
    bad = [features(pair) for pair in merged_pairs(volume, labels, size, share.part(0.4, 0.8))]
    parted = share.part(0.8, 1.0).over(objects)
    bad += [features(half) for half in halves(parted, np.random.default_rng(seed))]
    return good, bad


def halves(objects: Iterable[Region], generator: np.random.Generator) -> Iterator[Region]:
    """Yield one half of every object, cut through its centre by a random plane.

    Parameters
    ----------
    objects : iterable of Region
    generator : numpy.random.Generator
    """
    for region in objects:
        points = np.stack(np.nonzero(region.mask), axis=1)
        side = (points - points.mean(axis=0)) @ generator.normal(size=3) > 0
        if 0 < side.sum() < len(side):
            mask = np.zeros_like(region.mask)
            mask[tuple(points[side].T)] = True
            yield region.part(mask)
