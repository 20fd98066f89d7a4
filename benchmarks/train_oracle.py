"""Train the confidence that ships with the package, and say how well it tells objects apart.

Run `python benchmarks/train_oracle.py
src/napari_unpack/segmentation/weights/oracle.npz` to make the
shipped file, to the bit for one state of the code, and `python benchmarks/train_oracle.py --test`
to test it on bags it has not seen. Seeds 200 to 280 are for training; no test and no row of the
tables uses them.

Real scans have voxels of two millimetres and more, blur, noise, twelve bits, and objects whose
borders a segmentation has drawn. So every bag is learned from as it is, and twice as such a scanner
would show it: its true objects with their unions and halves, and what `segment` finds in it.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from napari_unpack.segmentation import Oracle, segment
from napari_unpack.segmentation.confidence.features import features
from napari_unpack.segmentation.confidence.oracle import default_oracle, fit_features
from napari_unpack.segmentation.evaluation import Overlaps
from napari_unpack.segmentation.training import oracle_examples, true_objects
from napari_unpack.simulation import simulate_bag

FIRST, BAGS, SOLIDS, SCANS = 200, 24, 72, 2
# IoU from which what is found is an object, and below which it is none.
RIGHT, WRONG = 0.6, 0.4
Examples = tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]
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


def coarser(bag: Any, seed: int) -> Solids:
    """Return a bag as a scanner of two or three times its voxel size shows it."""
    generator = np.random.default_rng(seed)
    across, along = (int(n) for n in generator.integers(2, 4, 2))
    factors = (along, across, across)
    shape = [n // f for n, f in zip(bag.volume.shape, factors, strict=True)]
    kept = tuple(slice(0, n * f) for n, f in zip(shape, factors, strict=True))
    cells = bag.volume[kept].astype(np.float32)
    cells = cells.reshape([n for pair in zip(shape, factors, strict=True) for n in pair])
    blurred = gaussian_filter(cells.mean(axis=(1, 3, 5)), generator.uniform(0, 0.8))
    noise = generator.normal(0, generator.uniform(5, 30), blurred.shape)
    volume = np.clip(np.rint(blurred + noise), 0, 4095).astype(np.uint16)
    middles = tuple(slice(f // 2, None, f) for f in factors)
    labels = np.ascontiguousarray(bag.labels[kept][middles])
    z, y, x = (float(s) * f for s, f in zip(bag.spacing, factors, strict=True))
    return Solids(volume, labels, (z, y, x))


def best_iou(truth: NDArray[np.integer], found: NDArray[np.integer]) -> NDArray[np.float64]:
    """Return the largest IoU of each found object with a true one, by ascending found label."""
    overlaps = Overlaps.of(truth, found)
    best, kept = np.zeros(len(overlaps.found_ids)), overlaps.of_objects
    np.maximum.at(best, overlaps.columns[kept], overlaps.iou()[kept])
    return best[1:]


def found_examples(bag: Any) -> Examples:
    """Return the features of what is found in a bag, of objects and of what is none."""
    labels = segment(bag.volume, bag.spacing).labels
    overlap = best_iou(bag.labels, labels)
    good, bad = [], []
    regions = true_objects(bag.volume, labels, bag.spacing, 1)
    for region, iou in zip(regions, overlap.tolist(), strict=True):
        if iou > RIGHT:
            good.append(features(region))
        elif iou < WRONG:
            bad.append(features(region))
    return good, bad


def examples(bags: int, solids: int) -> Iterator[tuple[Examples, Examples]]:
    """Yield what there is to learn from every volume: as it is, and from coarser scans of it."""
    for k, bag in enumerate(labelled(bags, solids)):
        fine, coarse = oracle_examples(bag, k), ([], [])
        for scan in range(SCANS if k < bags else 0):
            worse = coarser(bag, 1000 * (scan + 1) + k)
            for more in (oracle_examples(worse, k), found_examples(worse)):
                for side, rows in zip(coarse, more, strict=True):
                    side.extend(rows)
        print(f"Learned from volume {k + 1}", flush=True)
        yield fine, coarse


def fitted(taught: Iterable[tuple[Examples, Examples]]) -> Oracle:
    """Return the oracle of these examples, in which fine and coarse scans stand side by side."""
    sides: list[list[list[NDArray[np.float64]]]] = [[[], []], [[], []]]
    for scans in taught:
        for scan, pair in enumerate(scans):
            for side, rows in enumerate(pair):
                sides[side][scan].extend(rows)
    good, bad = ([np.array(rows) for rows in side if len(rows)] for side in sides)
    return fit_features(good, bad)


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


def quality(oracle: Oracle, seeds: range) -> dict[str, float]:
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
        iou = best_iou(bag.labels, found)
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
    parser.add_argument("--test", action="store_true", help="test on unseen bags")
    options = parser.parse_args()
    if options.path is None and not options.test:
        parser.error("name a file to write the oracle to, or ask for --test")
    oracle = default_oracle() if options.path is None else None
    if options.path:
        oracle = fitted(examples(options.bags, options.solids))
        oracle.save(options.path)
    if options.test and oracle is not None:
        for name, value in quality(oracle, UNSEEN).items():
            print(f"{name:<20}{value:.3f}")


if __name__ == "__main__":
    main()
