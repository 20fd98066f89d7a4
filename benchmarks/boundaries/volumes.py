"""Volumes to learn from.

Most are sharp: training adds blur and noise, anew every time. Some are scanned by rays, with the
streaks of metal.

`python -m benchmarks.boundaries.volumes FOLDER KIND FIRST LAST` writes those of some seeds.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import zoom

from benchmarks.boundaries.hollow import hollow
from benchmarks.boundaries.metal_among_cloth import metal_among_cloth
from benchmarks.boundaries.solids import coat, lay_flat, packed_solids
from napari_unpack.atomic import written_atomically
from napari_unpack.simulation import ProjectionScanner, Scanner, simulate_bag

Volumes = tuple[NDArray[np.uint16], NDArray[np.uint16]]

SHAPES = (
    *[(160, 176, 256)] * 3,
    (128, 144, 176),
    (144, 144, 208),
    (112, 128, 160),
    (192, 192, 192),
)

SHAPES_BY_RAYS = ((96, 160, 160), (112, 128, 160), (128, 144, 176), (96, 144, 144), (160, 176, 256))
"""Smaller: rays take several times as long."""

MAGNIFIED = 1.6
"""Voxels to one as drawn: objects of up to 140 voxels."""


@dataclass(frozen=True)
class Kind:
    """A kind of volumes to learn from.

    Parameters
    ----------
    make : callable
        `make(seed) -> (density, labels)`.
    seeds : range
        That the shipped network learned from.
    scanned : bool
        By rays: with blur, noise and streaks.
    plain : bool
        Of things of one or two materials, which may be given others.
    """

    make: Callable[[int], Volumes]
    seeds: range
    scanned: bool = False
    plain: bool = False


def bag(seed: int) -> Volumes:
    """Return a sharp bag of random size, spacing, fullness and streaks, and its labels."""
    rng = np.random.default_rng(seed)
    shape = SHAPES[rng.integers(len(SHAPES))]
    share = np.prod(shape) / np.prod(SHAPES[0])
    count = int(np.clip(30 * share**0.5 * np.exp(rng.normal(0, 0.3)), 8, 60))
    spacing = (1.0, 1.0, 1.0)
    if rng.random() >= 0.6:
        spacing = tuple(float(s) for s in np.round(np.exp(rng.uniform(-0.3, 0.3, 3)), 2))
    streaks = float(rng.choice([0, 30, 70, 70, 120]))
    table = bool(rng.random() < 0.3)
    scanner = Scanner(blur=0, noise=0, streaks=streaks)
    made = simulate_bag(seed, shape, count, spacing, scanner=scanner, table=table)
    return made.volume, made.labels


def solids(seed: int, coated: bool = False, clad: bool = False) -> Volumes:
    """Return packed solids, plain or with what covers them and lies on them, and their labels."""
    density, labels = packed_solids(seed)
    if coated:
        coat(seed, density, labels, 0.4)
    if clad:
        coat(seed, density, labels, 0.5, alike=0.35)
        lay_flat(seed, density, labels)
    return density, labels


def bag_by_rays(seed: int) -> Volumes:
    """Return a bag that is scanned by rays, and its labels."""
    rng = np.random.default_rng(seed)
    shape = SHAPES_BY_RAYS[rng.integers(len(SHAPES_BY_RAYS))]
    count = int(np.clip(22 * np.exp(rng.normal(0, 0.3)), 8, 45))
    made = simulate_bag(seed, shape, count, scanner=Scanner(blur=0, noise=0, streaks=0))
    return by_rays(seed, made.volume, made.labels)


def solids_by_rays(seed: int) -> Volumes:
    """Return packed solids that are scanned by rays, those of odd seeds clad, and their labels."""
    return by_rays(seed, *solids(seed, clad=bool(seed % 2)))


def large_solids_by_rays(seed: int) -> Volumes:
    """Return packed solids, magnified, that are scanned by rays, and their labels."""
    return by_rays(seed, *magnified(*packed_solids(seed)))


def metal_by_rays(seed: int) -> Volumes:
    """Return metal among cloth that is scanned by rays, and its labels."""
    return by_rays(seed, *metal_among_cloth(seed))


def by_rays(seed: int, density: NDArray[np.uint16], labels: NDArray[np.uint16]) -> Volumes:
    """Scan by rays, with a random dose and slice profile; the air inside objects is no object's.

    Parameters
    ----------
    seed : int
    density, labels : (Z, Y, X) ndarray of uint16
        Sharp.
    """
    rng = np.random.default_rng([seed, 77])
    names = labels.astype(np.int32)
    hollow(density.astype(np.float32), names)
    photons = float(np.exp(rng.uniform(np.log(1.5e4), np.log(2e5))))
    scanner = ProjectionScanner(photons=photons, thickness=float(rng.uniform(0.8, 1.8)))
    return scanner.scan(density, rng, (1.0, 1.0, 1.0)), names.astype(np.uint16)


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


KINDS = {
    "bag": Kind(bag, range(100, 234)),
    "solids": Kind(solids, range(260), plain=True),
    "clad": Kind(partial(solids, clad=True), range(30), plain=True),
    "metal": Kind(metal_among_cloth, range(5500, 5530)),
    "bag-by-rays": Kind(bag_by_rays, range(5100, 5160), scanned=True),
    "solids-by-rays": Kind(solids_by_rays, range(5200, 5226), scanned=True),
    "large-by-rays": Kind(large_solids_by_rays, range(5300, 5316), scanned=True),
    "metal-by-rays": Kind(metal_by_rays, range(5400, 5420), scanned=True),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    for seed in range(options.first, options.last):
        volume, labels = KINDS[options.kind].make(seed)
        name = f"{options.kind}{seed}"
        np.save(options.folder / f"{name}-labels.npy", labels)
        # Last and at once: a density that is there says that both are made.
        with written_atomically(options.folder / f"{name}-density.npy") as temporary:
            np.save(temporary, volume)


if __name__ == "__main__":
    main()
