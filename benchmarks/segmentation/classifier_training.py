"""What the trainings of the classifiers share: rounds of learning, and the command."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from copy import deepcopy
from functools import partial
from multiprocessing import get_context
from typing import TypeVar

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.segmentation.pair_examples import ensemble, examples_of, fit_classifier
from benchmarks.segmentation.training_scans import FAMILIES, Scan
from napari_unpack.segmentation.learned.pair_classifier import PairClassifier
from napari_unpack.segmentation.learned.part_merging import PredictedParts
from napari_unpack.segmentation.learned.part_splitting import Pieces

Regions = TypeVar("Regions", PredictedParts, Pieces)
State = TypeVar("State")
Fit = Callable[[NDArray[np.float64], NDArray[np.bool_]], PairClassifier]


def ensembles(features: tuple[str, ...], restraint: float, members: int) -> Fit:
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
    counts: dict[str, int],
    fit: Callable[[list[State]], PairClassifier],
) -> None:
    """Train a classifier as the command line says, and save it.

    Parameters
    ----------
    description : str
        For the command's help.
    measure, counts, fit
        See `trained`.
    """
    options = arguments(description)
    trained(measure, counts, fit, options.workers).save(options.file)


def arguments(description: str) -> argparse.Namespace:
    """Read the command line of a training: `file` and `workers`."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("file", help="where to save the classifier")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    return parser.parse_args()


def trained(
    measure: Callable[[Scan], State],
    counts: dict[str, int],
    fit: Callable[[list[State]], PairClassifier],
    workers: int,
) -> PairClassifier:
    """Measure scans of some families, and return the classifier fitted to them.

    Parameters
    ----------
    measure : callable
        `measure(scan) -> state`.
    counts : dict of str to int
        How many scans of which family, see `FAMILIES`.
    fit : callable
        `fit(states) -> classifier`.
    workers : int
        Processes.
    """
    names = [(family, n) for family, count in counts.items() for n in range(count)]
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as processes:
        states = list(processes.map(partial(_measured, measure), names))
    # Many threads on small matrices wait for one another, and add up in any order.
    with threadpool_limits(1):
        return fit(states)


def _measured(measure: Callable[[Scan], State], name: tuple[str, int]) -> State:
    family, number = FAMILIES[name[0]], name[1]
    return measure(family.make(family.first + number))
