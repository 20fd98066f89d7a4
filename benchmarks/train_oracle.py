"""Train the confidence that ships with the package, and say how well it tells objects apart.

Run `python benchmarks/train_oracle.py src/napari_unpack/segmentation/oracle.npz` to make the
shipped file, to the bit for one state of the code, and `python benchmarks/train_oracle.py --judge`
to test it on bags it has not seen. Seeds 200 to 260 are for training; no test and no row of the
tables uses them.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation import Oracle, segment, train
from napari_unpack.segmentation.confidence import default_oracle
from napari_unpack.segmentation.evaluation import contingency, iou_table
from napari_unpack.segmentation.features import features
from napari_unpack.segmentation.training import oracle_examples, true_objects
from napari_unpack.simulation import simulate_bag

FIRST, BAGS, SOLIDS = 200, 24, 12
UNSEEN = range(1000, 1004)


@dataclass(frozen=True, eq=False)
class Solids:
    """A volume of plain touching solids, so that not all it has seen are bags."""

    volume: NDArray[Any]
    labels: NDArray[Any]
    spacing: tuple[float, float, float] = (1.0, 1.0, 1.0)


def labelled(bags: int, solids: int) -> Iterator[Any]:
    from touching_solids import touching_solids

    for seed in range(FIRST, FIRST + bags):
        yield simulate_bag(seed=seed)
    for seed in range(FIRST, FIRST + solids):
        yield Solids(*touching_solids(seed))


def auroc(good: NDArray[np.float64], bad: NDArray[np.float64]) -> float:
    """Return the probability that a good one scores above a bad one, ties by half."""
    above = (good[:, None] > bad[None, :]).mean()
    return float(above + (good[:, None] == bad[None, :]).mean() / 2)


def calibration(scores: NDArray[np.float64], right: NDArray[np.bool_], bins: int = 10) -> float:
    """Return the mean distance of the score from the share that is right, over bins of score."""
    place = np.minimum((scores * bins).astype(int), bins - 1)
    error = 0.0
    for k in np.unique(place):
        inside = place == k
        error += inside.mean() * abs(scores[inside].mean() - right[inside].mean())
    return float(error)


def judge(oracle: Oracle, seeds: range) -> dict[str, float]:
    """Return AUROC and calibration on true and false objects, and Spearman of score and IoU."""
    from scipy.stats import spearmanr

    good: list[NDArray[np.float64]] = []
    bad: list[NDArray[np.float64]] = []
    scores: list[float] = []
    overlaps: list[float] = []
    for seed in seeds:
        bag = simulate_bag(seed=seed)
        for side, rows in zip((good, bad), oracle_examples(bag, seed), strict=True):
            side.extend(rows)
        found = segment(bag.volume, bag.spacing).labels
        iou = iou_table(contingency(bag.labels, found)).max(axis=0, initial=0.0)
        regions = list(true_objects(bag.volume, found, bag.spacing, 1))
        scores.extend(oracle.scores(np.array([features(r) for r in regions])).tolist())
        overlaps.extend(iou.tolist())
    one, two = oracle.scores(np.array(good)), oracle.scores(np.array(bad))
    alone = [oracle.good.log_density(oracle.project(np.array(rows))) for rows in (good, bad)]
    everything = np.concatenate([one, two])
    # As many right as wrong, which is what the score was calibrated for.
    weight = np.repeat([True, False], [len(one), len(two)])
    return {
        "auroc": auroc(one, two),
        "auroc_one_class": auroc(*alone),
        "calibration_error": calibration(everything, weight),
        "spearman": float(spearmanr(scores, overlaps).statistic),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("path", nargs="?", help="where to write the oracle")
    parser.add_argument("--bags", type=int, default=BAGS)
    parser.add_argument("--solids", type=int, default=SOLIDS)
    parser.add_argument("--judge", action="store_true", help="test on unseen bags")
    options = parser.parse_args()
    oracle = default_oracle() if options.path is None else None
    if options.path:
        bags = labelled(options.bags, options.solids)
        oracle = train(bags, progress=lambda _, text: print(text, flush=True))
        oracle.save(options.path)
    if options.judge and oracle is not None:
        for name, value in judge(oracle, UNSEEN).items():
            print(f"{name:<20}{value:.3f}")


if __name__ == "__main__":
    main()
