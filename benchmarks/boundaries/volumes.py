"""Volumes to learn from, without blur and noise, which training adds anew every time.

`python -m benchmarks.boundaries.volumes FOLDER FIRST LAST` writes simulated bags;
with `--solids`, packed solids; with `--coated`, those with a coat on some, named 1000 higher;
with `--clad`, with more coats and with things that lie flat on others, named 2000 higher.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.boundaries.solids import coat, lay_flat, packed_solids
from napari_unpack.atomic import written_atomically
from napari_unpack.simulation import Scanner, simulate_bag

SHAPES = (
    *[(160, 176, 256)] * 3,
    (128, 144, 176),
    (144, 144, 208),
    (112, 128, 160),
    (192, 192, 192),
)


def bag(seed: int) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
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


def solids(
    seed: int, coated: bool = False, clad: bool = False
) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Return packed solids, plain or with what covers them and lies on them, and their labels."""
    density, labels = packed_solids(seed)
    if coated:
        coat(seed, density, labels, 0.4)
    if clad:
        coat(seed, density, labels, 0.5, alike=0.35)
        lay_flat(seed, density, labels)
    return density, labels


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int)
    for kind in ("--solids", "--coated", "--clad"):
        parser.add_argument(kind, action="store_true")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    for seed in range(options.first, options.last):
        if options.solids or options.coated or options.clad:
            volume, labels = solids(seed, options.coated, options.clad)
            name = f"solids{seed + 1000 * options.coated + 2000 * options.clad}"
        else:
            volume, labels = bag(seed)
            name = f"bag{seed}"
        np.save(options.folder / f"{name}-labels.npy", labels)
        # Last and at once: a density that is there says that both are made.
        with written_atomically(options.folder / f"{name}-density.npy") as temporary:
            np.save(temporary, volume)


if __name__ == "__main__":
    main()
