"""What the trainings of the judges share: scans and truth, rounds of learning, the command."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from copy import deepcopy
from dataclasses import dataclass
from multiprocessing import get_context
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.boundaries.examples import scan
from benchmarks.boundaries.solids import coat, packed_solids
from napari_unpack.segmentation.affinity import Affinity
from napari_unpack.segmentation.joining import SeenParts
from napari_unpack.segmentation.learned import Seen, learned_parts
from napari_unpack.segmentation.parting import Pieces
from napari_unpack.segmentation.training import examples_of
from napari_unpack.simulation import simulate_bag

# The network learned from solids of the first 260 seeds.
FIRST, BAGS = 300, 16
Regions = TypeVar("Regions", SeenParts, Pieces)
Fit = Callable[[NDArray[np.float64], NDArray[np.bool_]], Affinity]


@dataclass(frozen=True)
class Scan:
    """A scan and what is in it: density and true IDs (Z, Y, X), voxel size in mm z y x."""

    volume: NDArray[np.uint16]
    truth: NDArray[np.uint16]
    spacing: tuple[float, float, float]

    def seen(self) -> Seen:
        """Return what the network makes of it."""
        return learned_parts(self.volume, self.spacing, lambda fraction, text: None)


def scanned_bag(seed: int) -> Scan:
    """Return a simulated bag."""
    bag = simulate_bag(seed=seed)
    a, b, c = (float(mm) for mm in bag.spacing)
    return Scan(bag.volume, bag.labels, (a, b, c))


def scanned_solids(seed: int, coated: bool = False) -> Scan:
    """Return packed solids, scanned as those the network learned from; some coated if so asked."""
    density, labels = packed_solids(seed)
    if coated:
        coat(seed, density, labels)
    scanned = scan(np.random.default_rng(seed), density.astype(np.float32))
    return Scan(np.clip(scanned, 0, 32000).astype(np.uint16), labels, (1.0, 1.0, 1.0))


def learn(states: list[tuple[Regions, NDArray[np.float64]]], rounds: int, fit: Fit) -> Affinity:
    """Learn from the joins that the truth makes, then from those that the judge itself makes.

    Parameters
    ----------
    states : list of (SeenParts or Pieces, ndarray)
        Regions as found, and what they share with the true objects (`training.overlaps`).
    rounds : int
        How often the judge joins for itself, and learns from that too.
    fit : callable
        Makes a judge of (N, F) features of pairs and whether each is one object.
    """
    rows, same = [], []
    judge = None
    for _ in range(rounds + 1):
        for measured, shared in states:
            fresh = deepcopy(measured)
            pairs, one = examples_of(fresh, shared, judge, fresh.features)
            if len(pairs):
                rows.append(pairs)
                same.append(one)
        examples = np.concatenate(rows), np.concatenate(same)
        judge = fit(*examples)
        print(f"{len(examples[0])} pairs, {examples[1].mean():.0%} one object", flush=True)
    assert judge is not None
    return judge


def train(
    description: str,
    solids: int,
    of_bag: Callable[[int], tuple[Regions, NDArray[np.float64]]],
    of_solids: Callable[[int], tuple[Regions, NDArray[np.float64]]],
    fit: Callable[[list[tuple[Regions, NDArray[np.float64]]]], Affinity],
    argv: list[str] | None = None,
) -> None:
    """Measure every bag and every set of solids by its seed, fit a judge to them, and save it."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("file", help="where to save the judge")
    parser.add_argument("--bags", type=int, default=BAGS)
    parser.add_argument("--solids", type=int, default=solids)
    parser.add_argument("--workers", type=int, default=1, help="processes")
    options = parser.parse_args(argv)
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as pool:
        states = list(pool.map(of_bag, range(FIRST, FIRST + options.bags)))
        states += pool.map(of_solids, range(FIRST, FIRST + options.solids))
    # Many threads on small matrices wait for one another, and add up in any order.
    with threadpool_limits(1):
        fit(states).save(options.file)
