"""The families of scans that the classifiers learn from: objects and scanners unlike each other.

No family holds bags that others have made, which are for looking and choosing alone. No seed is
one that a table measures. The network that ships has seen no scan by rays and no metal among cloth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import zoom

from benchmarks.boundaries.examples import hollow, scan
from benchmarks.boundaries.metal_among_cloth import metal_among_cloth
from benchmarks.boundaries.solids import alike_solids, coat, packed_solids
from benchmarks.boundaries.volumes import solids
from napari_unpack.segmentation.learned.method import Oversegmentation, oversegment
from napari_unpack.simulation import Bag, ProjectionScanner, Scanner, simulate_bag

Volumes = tuple[NDArray[np.uint16], NDArray[np.uint16]]
ONE_MM = (1.0, 1.0, 1.0)

SHAPES_BY_RAYS = ((96, 160, 160), (112, 128, 160), (128, 144, 176), (96, 144, 144))
"""Smaller than a bag: rays take several times as long."""

SMALL_BAGS = (((64, 72, 96), 10), ((48, 56, 80), 9), ((96, 112, 144), 15), ((80, 80, 112), 12))
"""Voxels, and how many objects are asked for."""

MAGNIFIED = 1.6
"""Voxels to one as drawn: objects of up to 140 voxels."""


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
        Of the seeds; the network learned from solids of those below 260.
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


def _by_rays(seed: int, density: NDArray[np.uint16], labels: NDArray[np.uint16]) -> Scan:
    """Scan by rays, of a random dose and slice profile; air inside objects is no object's."""
    rng = np.random.default_rng(seed + 77)
    names = labels.astype(np.int32)
    hollow(density.astype(np.float32), names)
    photons = float(np.exp(rng.uniform(np.log(1.5e4), np.log(2e5))))
    scanner = ProjectionScanner(photons=photons, thickness=float(rng.uniform(0.8, 1.8)))
    return Scan(scanner.scan(density, rng, ONE_MM), names.astype(np.uint16), ONE_MM)


def _coated(seed: int) -> Volumes:
    density, labels = packed_solids(seed)
    coat(seed, density, labels)
    return density, labels


def _bag_by_rays(seed: int) -> Scan:
    rng = np.random.default_rng(seed)
    shape = SHAPES_BY_RAYS[rng.integers(len(SHAPES_BY_RAYS))]
    count = int(np.clip(22 * np.exp(rng.normal(0, 0.3)), 8, 45))
    made = simulate_bag(seed, shape, count, ONE_MM, scanner=Scanner(blur=0, noise=0, streaks=0))
    return _by_rays(seed, made.volume, made.labels)


def magnified(density: NDArray[np.uint16], labels: NDArray[np.uint16]) -> Volumes:
    """Return a volume and its labels with `MAGNIFIED` times as many voxels along each axis.

    Parameters
    ----------
    density, labels : (Z, Y, X) ndarray of uint16
    """
    finer = zoom(density.astype(np.float32), MAGNIFIED, order=1)
    sizes = zip(finer.shape, labels.shape, strict=True)
    nearest = [np.minimum((np.arange(n) / (n / m)).astype(int), m - 1) for n, m in sizes]
    return np.clip(finer, 0, 65535).astype(np.uint16), labels[np.ix_(*nearest)]


FAMILIES = {
    "bags": Family(_bag),
    "small bags": Family(_small_bag, 7000),
    "solids": Family(lambda seed: _scanned(seed, *packed_solids(seed))),
    "coated solids": Family(lambda seed: _scanned(seed, *_coated(seed))),
    "clad solids": Family(lambda seed: _scanned(seed, *solids(seed, clad=True))),
    "alike solids": Family(lambda seed: _scanned(seed, *alike_solids(seed)), 0),
    "metal among cloth": Family(lambda seed: _scanned(seed, *metal_among_cloth(seed)), 5500),
    "bags by rays": Family(_bag_by_rays, 5100),
    "solids by rays": Family(lambda s: _by_rays(s, *solids(s, clad=bool(s % 2))), 5200),
    "large solids by rays": Family(lambda s: _by_rays(s, *magnified(*packed_solids(s))), 5300),
    "metal by rays": Family(lambda seed: _by_rays(seed, *metal_among_cloth(seed)), 5400),
}
