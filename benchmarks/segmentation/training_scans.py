"""The families of scans that the classifiers learn from: each with objects, or a scanner, unlike.

No family holds bags that others have made, which are for looking and choosing alone; no
seed is one that the network learned from, or that any table measures.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import zoom

from benchmarks.boundaries.examples import scan
from benchmarks.boundaries.metal_among_cloth import metal_among_cloth
from benchmarks.boundaries.solids import coat, packed_solids
from benchmarks.boundaries.volumes import solids
from napari_unpack.segmentation.learned.method import Oversegmentation, oversegment
from napari_unpack.simulation import Bag, ProjectionScanner, simulate_bag

ONE_MM = (1.0, 1.0, 1.0)
Volumes = tuple[NDArray[np.uint16], NDArray[np.uint16]]

MAGNIFIED = 1.6
"""Voxels to one as drawn: objects of up to 140 voxels, of which the network sees thirty."""


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


def _scan_of(bag: Bag) -> Scan:
    a, b, c = (float(mm) for mm in bag.spacing)
    return Scan(bag.volume, bag.labels, (a, b, c))


def _bag(seed: int) -> Scan:
    return _scan_of(simulate_bag(seed=seed))


def _bag_by_rays(seed: int) -> Scan:
    # Small: rays take several times as long.
    return _scan_of(simulate_bag(seed, (96, 160, 160), 22, fidelity="projection"))


def _coarse_bag(seed: int) -> Scan:
    """Return a bag of half as many voxels along each axis; all sides of a bag are even."""
    bag = simulate_bag(seed=seed)
    z, y, x = (n // 2 for n in bag.volume.shape)
    cells = bag.volume.astype(np.float32).reshape(z, 2, y, 2, x, 2)
    means = cells.mean(axis=(1, 3, 5)).astype(np.uint16)
    return Scan(means, bag.labels[1::2, 1::2, 1::2].copy(), (2.0, 2.0, 2.0))


def _fine_bag(seed: int) -> Scan:
    bag = simulate_bag(seed=seed, shape=(128, 144, 176), count=20)
    side = 1 / MAGNIFIED
    return Scan(*magnified(bag.volume, bag.labels), (side, side, side))


def _solids(seed: int, dress: str = "", large: bool = False, rays: bool = False) -> Scan:
    """Return packed solids.

    Parameters
    ----------
    seed : int
    dress : {"", "coated", "clad"}
        "coated": about a quarter have a coat. "clad": about half have one, and on two fifths lies
        something flat.
    large : bool
        Magnified.
    rays : bool
        Scanned by rays; else as those that the network learned from.
    """
    density, labels = solids(seed, clad=True) if dress == "clad" else packed_solids(seed)
    if dress == "coated":
        coat(seed, density, labels)
    if large:
        density, labels = magnified(density, labels)
    return _scanned(seed, density, labels, rays)


def _scanned(
    seed: int, density: NDArray[np.uint16], labels: NDArray[np.uint16], rays: bool
) -> Scan:
    rng = np.random.default_rng(seed)
    if rays:
        return Scan(ProjectionScanner().scan(density, rng, ONE_MM), labels, ONE_MM)
    scanned = scan(rng, density.astype(np.float32))
    return Scan(np.clip(scanned, 0, 32000).astype(np.uint16), labels, ONE_MM)


def _metal_among_cloth(seed: int) -> Scan:
    density, labels = metal_among_cloth(seed)
    return _scanned(seed, density, labels, rays=seed % 3 == 0)


def _odd_ones_clad(seed: int, large: bool, rays: bool) -> Scan:
    return _solids(seed, "clad" if seed % 2 else "", large, rays)


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
    "bags by rays": Family(_bag_by_rays),
    "solids": Family(_solids),
    "solids by rays": Family(partial(_odd_ones_clad, large=False, rays=True), 400),
    "coarse bags": Family(_coarse_bag, 330),
    "large solids": Family(partial(_odd_ones_clad, large=True, rays=False), 420),
    "large solids by rays": Family(partial(_odd_ones_clad, large=True, rays=True), 440),
    "fine bags": Family(_fine_bag, 340),
    "coated solids": Family(partial(_solids, dress="coated")),
    "clad solids": Family(partial(_solids, dress="clad")),
    "metal among cloth": Family(_metal_among_cloth, 500),
}

WIDE = {
    "bags by rays": 10,
    "solids by rays": 12,
    "coarse bags": 6,
    "large solids": 8,
    "large solids by rays": 8,
    "fine bags": 4,
}
"""How many scans of the families that widen what the classifiers know."""
