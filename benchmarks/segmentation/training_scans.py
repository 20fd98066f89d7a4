"""The families of scans that the classifiers learn from: objects and scanners unlike each other.

No family holds bags that others have made, which are for looking and choosing alone. No seed is
one that a table measures.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.boundaries.examples import scan
from benchmarks.boundaries.metal_among_cloth import metal_among_cloth
from benchmarks.boundaries.solids import alike_solids, packed_solids
from benchmarks.boundaries.volumes import (
    Volumes,
    bag_by_rays,
    clad_solids,
    coated_solids,
    large_solids_by_rays,
    metal_by_rays,
    solids_by_rays,
)
from napari_unpack.segmentation.learned.method import Oversegmentation, oversegment
from napari_unpack.simulation import Bag, simulate_bag

ONE_MM = (1.0, 1.0, 1.0)

SMALL_BAGS = (((64, 72, 96), 10), ((48, 56, 80), 9), ((96, 112, 144), 15), ((80, 80, 112), 12))
"""Voxels, and how many objects are asked for."""


@dataclass(frozen=True)
class Scan:
    """A scan and what is in it: density and true IDs (Z, Y, X), voxel size in mm z y x."""

    volume: NDArray[np.uint16]
    truth: NDArray[np.uint16]
    spacing: tuple[float, float, float]

    def seen(self) -> Oversegmentation:
        """Return what the network makes of it."""
        return oversegment(self.volume, self.spacing, lambda fraction, text: None)


@dataclass(frozen=True)
class Family:
    """Scans of one kind.

    Parameters
    ----------
    make : callable
        `make(seed) -> scan`.
    first : int
        Of the seeds, below those that the network learned from.
    """

    make: Callable[[int], Scan]
    first: int = 300


def _bag(seed: int) -> Scan:
    return _as_scan(simulate_bag(seed=seed))


def _as_scan(bag: Bag) -> Scan:
    a, b, c = (float(mm) for mm in bag.spacing)
    return Scan(bag.volume, bag.labels, (a, b, c))


def _small_bag(seed: int) -> Scan:
    shape, count = SMALL_BAGS[seed % len(SMALL_BAGS)]
    return _as_scan(simulate_bag(seed=seed, shape=shape, count=count))


def _scanned(seed: int, density: NDArray[np.uint16], labels: NDArray[np.uint16]) -> Scan:
    """Scan as the network's examples are."""
    blurred = scan(np.random.default_rng(seed), density.astype(np.float32))
    return Scan(np.clip(blurred, 0, 32000).astype(np.uint16), labels, ONE_MM)


def _as_they_are(make: Callable[[int], Volumes]) -> Callable[[int], Scan]:
    return lambda seed: Scan(*make(seed), ONE_MM)


FAMILIES = {
    "bags": Family(_bag),
    "small bags": Family(_small_bag, 7000),
    "solids": Family(lambda seed: _scanned(seed, *packed_solids(seed))),
    "coated solids": Family(lambda seed: _scanned(seed, *coated_solids(seed))),
    "clad solids": Family(lambda seed: _scanned(seed, *clad_solids(seed))),
    "alike solids": Family(lambda seed: _scanned(seed, *alike_solids(seed)), 0),
    "metal among cloth": Family(lambda seed: _scanned(seed, *metal_among_cloth(seed)), 5500),
    "bags by rays": Family(_as_they_are(bag_by_rays), 5100),
    "solids by rays": Family(_as_they_are(solids_by_rays), 5200),
    "large solids by rays": Family(_as_they_are(large_solids_by_rays), 5300),
    "metal by rays": Family(_as_they_are(metal_by_rays), 5400),
}
