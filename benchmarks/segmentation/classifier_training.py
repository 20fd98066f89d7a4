"""What the trainings of the classifiers share: rounds of learning, and the command."""

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
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.segmentation.pair_examples import examples_of
from benchmarks.segmentation.training_scans import FAMILIES, Scan
from napari_unpack.segmentation.learned.pair_classifier import PairClassifier
from napari_unpack.segmentation.learned.part_merging import PredictedParts
from napari_unpack.segmentation.learned.part_splitting import Pieces

Regions = TypeVar("Regions", PredictedParts, Pieces)
State = TypeVar("State")
Fit = Callable[[NDArray[np.float64], NDArray[np.bool_]], PairClassifier]


@dataclass(frozen=True)
class Scans:
    """Scans of a family to learn from.

    Parameters
    ----------
    family : str
        See `training_scans.FAMILIES`.
    count : int
    times : int
        How often each counts: small ones hold few pairs.
    """

    family: str
    count: int
    times: int = 1


METAL_AND_RAYS = (
    Scans("metal among cloth", 30),
    Scans("bags by rays", 30),
    Scans("solids by rays", 13),
    Scans("large solids by rays", 8),
    Scans("metal by rays", 10),
)
"""What the network has not seen, for the classifiers that decide after it."""


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


def fitted(
    measure: Callable[[Scan], State],
    scans: Sequence[Scans],
    fit: Callable[[list[State]], PairClassifier],
    shorten: int = 1,
    workers: int = 1,
    known: dict[str, list[State]] | None = None,
) -> PairClassifier:
    """Measure scans and fit a classifier to them.

    Parameters
    ----------
    measure : callable
        `measure(scan) -> state`; it goes to other processes.
    scans : sequence of Scans
    fit : callable
        `fit(states) -> classifier`.
    shorten : int
        Divides the numbers of scans.
    workers : int
        Processes.
    known : dict of str to list, optional
        What was measured already, by family; what is measured here is added.
    """
    states: list[State] = []
    known = {} if known is None else known
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as processes:
        for some in scans:
            if some.family not in known:
                first = FAMILIES[some.family].first
                seeds = range(first, first + -(-some.count // shorten))
                found = processes.map(partial(_measured, measure, some.family), seeds)
                known[some.family] = list(found)
            states += known[some.family] * some.times
    # Many threads on small matrices wait for one another, and add up in any order.
    with threadpool_limits(1):
        return fit(states)


def train(
    description: str,
    measure: Callable[[Scan], State],
    scans: Sequence[Scans],
    fit: Callable[[list[State]], PairClassifier],
    argv: list[str] | None = None,
) -> None:
    """Fit a classifier as the command line says, and save it.

    Parameters
    ----------
    description : str
        For the command's help.
    measure, scans, fit : callable, sequence of Scans, callable
        See `fitted`.
    argv : list of str, optional
        By default the command line.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("file", help="where to save the classifier")
    parser.add_argument("--shorten", type=int, default=1, help="divide the numbers of scans")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    options = parser.parse_args(argv)
    fitted(measure, scans, fit, options.shorten, options.workers).save(options.file)


def _measured(measure: Callable[[Scan], State], family: str, seed: int) -> State:
    return measure(FAMILIES[family].make(seed))
