"""Score each family of volumes by classifiers of parts and pieces that never saw it.

`python -m benchmarks.segmentation.left_out --folder FOLDER` trains both classifiers without the
scans that are like a family, segments fresh volumes of it, and prints what they reach beside the
classifiers that ship. The network and the classifier of borders are those that ship: the one takes
hours, the other decides about no object. Classifiers are kept in the folder, so that the command
goes on where it was stopped. It needs the dependency group `train`.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from unittest import mock

import numpy as np
import pandas as pd

from benchmarks.segmentation import part_merging_training, part_splitting_training
from benchmarks.segmentation.bags import cases
from benchmarks.segmentation.classifier_training import Scans, fitted
from benchmarks.segmentation.goals import FAMILIES
from benchmarks.segmentation.report import markdown
from benchmarks.segmentation.training_scans import Scan
from napari_unpack.segmentation import score, segment
from napari_unpack.segmentation.learned import part_merging, part_splitting
from napari_unpack.segmentation.learned.pair_classifier import PairClassifier

BY_RAYS = ("bags by rays", "solids by rays", "large solids by rays", "metal by rays")
OF_SOLIDS = ("solids", "coated solids", "clad solids", "alike solids")

ALIKE: dict[str, tuple[str, ...]] = {
    "first": ("bags", "small bags", "bags by rays"),
    "second": (*OF_SOLIDS, "solids by rays", "large solids by rays"),
    "projection": BY_RAYS,
}
"""What of `training_scans.FAMILIES` is like a family of volumes: of its objects or its scanner."""

FIRST = 9501
"""Seed of the first volume. No other table measures these."""


@dataclass(frozen=True, eq=False)
class Pair:
    """The two classifiers that decide what is one object; None is the one that ships.

    Parameters
    ----------
    parts, pieces : PairClassifier, optional
    """

    parts: PairClassifier | None = None
    pieces: PairClassifier | None = None

    def used(self) -> ExitStack:
        """Return a context in which segmentation uses them."""
        stack = ExitStack()
        for module, name, one in (
            (part_merging, "default_merging_classifier", self.parts),
            (part_splitting, "default_splitting_classifier", self.pieces),
        ):
            if one is not None:
                stack.enter_context(mock.patch.object(module, name, partial(_given, one)))
        return stack


def _given(one: PairClassifier) -> PairClassifier:
    return one


def without(scans: Sequence[Scans], family: str) -> tuple[Scans, ...]:
    """Return the scans that are not like a family of volumes."""
    return tuple(some for some in scans if some.family not in ALIKE[family])


def trained_without(
    family: str,
    folder: Path,
    shorten: int,
    workers: int,
    parts_of: dict[str, list[part_merging_training.State]],
) -> Pair:
    """Return classifiers that saw nothing like a family; those in the folder are read.

    Parameters
    ----------
    family : str
        See `ALIKE`.
    folder : Path
        Where they are kept.
    shorten : int
        Divides the numbers of scans.
    workers : int
        Processes.
    parts_of : dict of str to list
        The parts of scans that were measured for another family, which are the same for each;
        pieces are not, since they come after the parts that this family's classifier merges.
    """
    folder.mkdir(parents=True, exist_ok=True)
    places = [folder / f"{name}-{family}-{shorten}.npz" for name in ("parts", "pieces")]
    if not places[0].exists():
        training = part_merging_training
        scans = without(training.SCANS, family)
        classifier = fitted(training.measured, scans, training.fit, shorten, workers, parts_of)
        classifier.save(places[0])
    parts = PairClassifier.load(places[0], part_merging.FEATURES)
    if not places[1].exists():
        training = part_splitting_training
        scans, measure = without(training.SCANS, family), partial(_pieces_after, parts)
        fitted(measure, scans, training.fit, shorten, workers).save(places[1])
    return Pair(parts, PairClassifier.load(places[1], part_splitting.PIECE_FEATURES))


def _pieces_after(parts: PairClassifier, scanned: Scan) -> part_splitting_training.State:
    with Pair(parts).used():
        return part_splitting_training.measured(scanned)


def scores_of(pair: Pair, family: str, seed: int) -> tuple[float, float]:
    """Return F1 and VOI of a volume as these classifiers segment it."""
    case = next(cases(family, 1, seed))
    with pair.used():
        found = segment(case.volume, case.spacing).labels
    marks = score(case.labels, found)
    return marks["f1"], marks["voi"]


def table(folder: Path, count: int, shorten: int, workers: int) -> pd.DataFrame:
    """Return F1 and VOI of every family, by what never saw it and by what ships.

    Parameters
    ----------
    folder : Path
    count : int
        Volumes of a family.
    shorten, workers : int
        See `trained_without`.
    """
    rows, parts_of = {}, dict[str, list[part_merging_training.State]]()
    for family in ALIKE:
        shown = {}
        blind = trained_without(family, folder, shorten, workers, parts_of)
        seeds = range(FIRST, FIRST + count)
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as processes:
            for name, pair in (("never saw it", blind), ("ships", Pair())):
                found = list(processes.map(partial(scores_of, pair, family), seeds))
                f1, voi = np.mean(found, axis=0)
                shown[name] = f"{f1:.2f} / {voi:.2f}"
        rows[FAMILIES[family].title] = {"volumes": count, **shown}
    return pd.DataFrame.from_dict(rows, orient="index")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=Path("left-out"), help="of classifiers")
    parser.add_argument("--count", type=int, default=20, help="volumes of each family")
    parser.add_argument("--shorten", type=int, default=1, help="divide the numbers of scans")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    options = parser.parse_args()
    found = table(options.folder, options.count, options.shorten, options.workers)
    print(markdown(found, "F1 / VOI"))


if __name__ == "__main__":
    main()
