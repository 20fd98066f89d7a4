"""The volumes that the network learns from: sharp ones that it scans anew, and scans by rays.

`python -m benchmarks.boundaries.volumes FOLDER` writes those that are missing, each kind's in
turn; with `--part 0 2` and `--part 1 2` two processes write half of them each.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import zoom

from benchmarks.boundaries.metal_among_cloth import metal_among_cloth
from benchmarks.boundaries.solids import alike_solids, coat, lay_flat, packed_solids
from napari_unpack.atomic import written_atomically
from napari_unpack.simulation import ProjectionScanner, Scanner, simulate_bag

Volumes = tuple[NDArray[np.uint16], NDArray[np.uint16]]
"""Density and true IDs, (Z, Y, X) each."""

AIR = 60.0
"""No matter is as light."""

FIRST_SEED = 20000
"""No table and no classifier of pairs has volumes of so high a seed."""

SHAPES = (
    *[(160, 176, 256)] * 3,
    (128, 144, 176),
    (144, 144, 208),
    (112, 128, 160),
    (192, 192, 192),
)

SHAPES_BY_RAYS = ((96, 160, 160), (112, 128, 160), (128, 144, 176), (96, 144, 144))
"""Smaller than a bag: rays take several times as long."""

MAGNIFIED = 1.6
"""Voxels to one as drawn: objects of up to 140 voxels."""


@dataclass(frozen=True)
class Kind:
    """Volumes of one kind.

    Parameters
    ----------
    make : callable
        `make(seed) -> density, labels`.
    count : int
        How many there are to learn from.
    share : float
        Of the patches, in hundredths.
    scanned : bool
        The volume is a scan; else training blurs it, adds noise, and gives its objects other
        densities.
    """

    make: Callable[[int], Volumes]
    count: int
    share: float
    scanned: bool = False


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


def coated_solids(seed: int) -> Volumes:
    """Return packed solids, some with a coat on."""
    density, labels = packed_solids(seed)
    coat(seed, density, labels, 0.4)
    return density, labels


def clad_solids(seed: int) -> Volumes:
    """Return packed solids with what covers them and lies flat on them, often as dense as they."""
    density, labels = packed_solids(seed)
    coat(seed, density, labels, 0.5, alike=0.35)
    lay_flat(seed, density, labels)
    return density, labels


def hollow(density: NDArray[np.float32], labels: NDArray[np.int32]) -> None:
    """Take the labels from the air inside objects, which filling gives back; in place.

    The voids of cloth are smaller than 3 x 3 x 3 voxels and stay.
    """
    air = _with_neighbours(_with_neighbours(density < AIR, np.logical_and), np.logical_or)
    labels[air] = 0


def _with_neighbours(mask: NDArray[np.bool_], rule: np.ufunc) -> NDArray[np.bool_]:
    """Return what a rule makes of every voxel and its 26 neighbours."""
    for axis in range(3):
        made = mask.copy()
        before, after = np.moveaxis(made, axis, 0)[1:], np.moveaxis(made, axis, 0)[:-1]
        rule(before, np.moveaxis(mask, axis, 0)[:-1], out=before)
        rule(after, np.moveaxis(mask, axis, 0)[1:], out=after)
        mask = made
    return mask


def by_rays(seed: int, density: NDArray[np.uint16], labels: NDArray[np.uint16]) -> Volumes:
    """Scan by rays, of a random dose and slice profile; air inside objects is no object's.

    Parameters
    ----------
    seed : int
        Of everything random.
    density, labels : (Z, Y, X) ndarray of uint16
        A sharp volume, and its objects.
    """
    rng = np.random.default_rng(seed + 77)
    names = labels.astype(np.int32)
    hollow(density.astype(np.float32), names)
    photons = float(np.exp(rng.uniform(np.log(1.5e4), np.log(2e5))))
    scanner = ProjectionScanner(photons=photons, thickness=float(rng.uniform(0.8, 1.8)))
    return scanner.scan(density, rng, (1.0, 1.0, 1.0)), names.astype(np.uint16)


def bag_by_rays(seed: int) -> Volumes:
    """Return a scan by rays of a bag of random size and fullness."""
    rng = np.random.default_rng(seed)
    shape = SHAPES_BY_RAYS[rng.integers(len(SHAPES_BY_RAYS))]
    count = int(np.clip(22 * np.exp(rng.normal(0, 0.3)), 8, 45))
    sharp = Scanner(blur=0, noise=0, streaks=0)
    made = simulate_bag(seed, shape, count, (1.0, 1.0, 1.0), scanner=sharp)
    return by_rays(seed, made.volume, made.labels)


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


def solids_by_rays(seed: int) -> Volumes:
    """Return a scan by rays of packed solids, half of them clad."""
    return by_rays(seed, *(clad_solids if seed % 2 else packed_solids)(seed))


def large_solids_by_rays(seed: int) -> Volumes:
    """Return a scan by rays of packed solids of up to 140 voxels."""
    return by_rays(seed, *magnified(*packed_solids(seed)))


def metal_by_rays(seed: int) -> Volumes:
    """Return a scan by rays of metal among cloth."""
    return by_rays(seed, *metal_among_cloth(seed))


KINDS = {
    "bags": Kind(bag, 170, 34),
    "solids": Kind(packed_solids, 86, 9),
    "coated-solids": Kind(coated_solids, 36, 5),
    "clad-solids": Kind(clad_solids, 58, 8),
    "alike-solids": Kind(alike_solids, 30, 3),
    "metal-among-cloth": Kind(metal_among_cloth, 36, 7),
    "bags-by-rays": Kind(bag_by_rays, 66, 18, scanned=True),
    "solids-by-rays": Kind(solids_by_rays, 36, 6, scanned=True),
    "large-solids-by-rays": Kind(large_solids_by_rays, 26, 6, scanned=True),
    "metal-by-rays": Kind(metal_by_rays, 26, 4, scanned=True),
}


def files(folder: Path, kind: str, seed: int) -> tuple[Path, Path]:
    """Return where the density and the labels of a volume are kept."""
    return folder / f"{kind}-{seed}-density.npy", folder / f"{kind}-{seed}-labels.npy"


def seeds(kind: Kind, shorten: int = 1) -> range:
    """Return the seeds of a kind's volumes, or of a share of them."""
    return range(FIRST_SEED, FIRST_SEED - -kind.count // shorten)


def _in_turn(shorten: int) -> Iterator[tuple[str, int]]:
    """Yield every volume, each kind's evenly spread: training may begin before all are there."""
    places = [
        ((k + 0.5) / len(wanted), name, seed)
        for name, kind in KINDS.items()
        for wanted in (seeds(kind, shorten),)
        for k, seed in enumerate(wanted)
    ]
    for _, name, seed in sorted(places):
        yield name, seed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--shorten", type=int, default=1, help="divides how many there are")
    parser.add_argument("--part", type=int, nargs=2, default=(0, 1), help="which part of how many")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    one, parts = options.part
    for name, seed in list(_in_turn(options.shorten))[one::parts]:
        density_file, labels_file = files(options.folder, name, seed)
        if density_file.exists():
            continue
        density, labels = KINDS[name].make(seed)
        np.save(labels_file, labels)
        # Last and at once: a density that is there says that both are made.
        with written_atomically(density_file) as temporary:
            np.save(temporary, density)


if __name__ == "__main__":
    main()
