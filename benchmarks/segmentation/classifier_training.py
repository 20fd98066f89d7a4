"""What the trainings of the classifiers share: scans and truth, rounds of learning, the command."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from typing import TypeVar

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.boundaries.examples import scan
from benchmarks.boundaries.solids import coat, packed_solids
from benchmarks.boundaries.volumes import solids
from benchmarks.segmentation.pair_examples import ensemble, examples_of, fit_classifier
from napari_unpack.segmentation.learned.method import Oversegmentation, oversegment
from napari_unpack.segmentation.learned.pair_classifier import PairClassifier
from napari_unpack.segmentation.learned.part_merging import PredictedParts
from napari_unpack.segmentation.learned.part_splitting import Pieces
from napari_unpack.simulation import simulate_bag

# The network learned from solids of the first 260 seeds.
FIRST, SOLIDS = 300, 40
Regions = TypeVar("Regions", PredictedParts, Pieces)
State = TypeVar("State")
Fit = Callable[[NDArray[np.float64], NDArray[np.bool_]], PairClassifier]


@dataclass(frozen=True)
class Scan:
    """A scan and what is in it: density and true IDs (Z, Y, X), voxel size in mm z y x."""

    volume: NDArray[np.uint16]
    truth: NDArray[np.uint16]
    spacing: tuple[float, float, float]

    def seen(self) -> Oversegmentation:
        """Return what the network makes of it."""
        return oversegment(self.volume, self.spacing, lambda fraction, text: None)


def scanned_bag(seed: int) -> Scan:
    """Return a simulated bag."""
    bag = simulate_bag(seed=seed)
    a, b, c = (float(mm) for mm in bag.spacing)
    return Scan(bag.volume, bag.labels, (a, b, c))


def scanned_solids(seed: int, dress: str = "") -> Scan:
    """Return packed solids, scanned as those the network learned from.

    Parameters
    ----------
    seed : int
        Of everything random.
    dress : {"", "coated", "clad"}
        "coated": about a quarter have a coat. "clad": about half have one, and on two fifths lies
        something flat.
    """
    density, labels = solids(seed, clad=True) if dress == "clad" else packed_solids(seed)
    if dress == "coated":
        coat(seed, density, labels)
    scanned = scan(np.random.default_rng(seed), density.astype(np.float32))
    return Scan(np.clip(scanned, 0, 32000).astype(np.uint16), labels, (1.0, 1.0, 1.0))


def ensembles(features: tuple[str, ...], restraint: float, members: int = 9) -> Fit:
    """Return how a committee is fitted to pairs; see `affinity.fit_classifier`.

    Notes
    -----
    One classifier alone says anything of pairs unlike those it has learned from, as real scans have
    them; the mean of several is quieter.
    """

    def fit(pairs: NDArray[np.float64], one: NDArray[np.bool_]) -> PairClassifier:
        each = delayed(fit_classifier)
        classifiers = Parallel(n_jobs=2)(
            each(pairs, one, seed, features, restraint) for seed in range(members)
        )
        return ensemble(classifiers)

    return fit


def learn(
    states: list[tuple[Regions, NDArray[np.float64]]], rounds: int, fit: Fit
) -> PairClassifier:
    """Learn from the joins that the truth makes, then from those that the classifier itself makes.

    Parameters
    ----------
    states : list of (PredictedParts or Pieces, ndarray)
        Regions as found, and what they share with the true objects (`training.overlaps`).
    rounds : int
        How often the classifier joins for itself, and learns from that too.
    fit : callable
        Makes a classifier of (N, F) features of pairs and whether each is one object.
    """
    rows, same = [], []
    classifier = None
    for _ in range(rounds + 1):
        for measured, shared in states:
            fresh = deepcopy(measured)
            pairs, one = examples_of(fresh, shared, classifier, fresh.features)
            if len(pairs):
                rows.append(pairs)
                same.append(one)
        examples = np.concatenate(rows), np.concatenate(same)
        classifier = fit(*examples)
        print(f"{len(examples[0])} pairs, {examples[1].mean():.0%} one object", flush=True)
    assert classifier is not None
    return classifier


def train(
    description: str,
    measure: Callable[[Scan], State],
    bags: int,
    dresses: Sequence[str],
    fit: Callable[[list[State]], PairClassifier],
    argv: list[str] | None = None,
) -> None:
    """Measure bags and solids, fit a classifier to them, and save it.

    Parameters
    ----------
    description : str
        For the command's help.
    measure : callable
        `measure(scan) -> state`.
    bags : int
        How many.
    dresses : sequence of str
        Of the solids, every seed once in each; see `scanned_solids`.
    fit : callable
        `fit(states) -> classifier`.
    argv : list of str, optional
        By default the command line.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("file", help="where to save the classifier")
    parser.add_argument("--bags", type=int, default=bags)
    parser.add_argument("--solids", type=int, default=SOLIDS, help="in every dress")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    options = parser.parse_args(argv)
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as processes:
        seeds = range(FIRST, FIRST + options.bags)
        states = list(processes.map(partial(_of_bag, measure), seeds))
        for dress in dresses:
            seeds = range(FIRST, FIRST + options.solids)
            states += processes.map(partial(_of_solids, measure, dress), seeds)
    # Many threads on small matrices wait for one another, and add up in any order.
    with threadpool_limits(1):
        fit(states).save(options.file)


def _of_bag(measure: Callable[[Scan], State], seed: int) -> State:
    return measure(scanned_bag(seed))


def _of_solids(measure: Callable[[Scan], State], dress: str, seed: int) -> State:
    return measure(scanned_solids(seed, dress))
