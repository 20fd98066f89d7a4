"""Train the judge of pairs that ships with the package.

`python -m benchmarks.segmentation.affinity_training src/napari_unpack/segmentation/affinity.npz`
gives it, to the bit for one state of the code; no test and no row of the table uses its seeds.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
from numpy.typing import NDArray

from napari_unpack.simulation import simulate_bag


def learn_from(
    seed: int, shape: tuple[int, int, int], count: int
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the pairs of parts of one simulated bag, and whether they are one object."""
    from napari_unpack.segmentation.training import pair_examples

    bag = simulate_bag(seed=seed, shape=shape, count=count)
    return pair_examples(bag.volume, bag.labels, tuple(bag.spacing))


def learn_from_solids(seed: int) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the pairs of parts of one volume of plain solids."""
    from benchmarks.touching_solids import touching_solids
    from napari_unpack.segmentation.training import pair_examples

    volume, labels = touching_solids(seed)
    return pair_examples(volume, labels, (1.0, 1.0, 1.0))


def train(
    path: str,
    seeds: range,
    shape: tuple[int, int, int],
    count: int,
    workers: int = 1,
    examples_path: str = "",
) -> None:
    """Train the affinity of pairs on simulated bags and plain solids, following the truth."""
    from napari_unpack.segmentation.learned.pair_classifier import fit_affinity

    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        jobs = [pool.submit(learn_from, seed, shape, count) for seed in seeds]
        jobs += [pool.submit(learn_from_solids, seed) for seed in range(2 * len(seeds))]
        examples = [job.result() for job in jobs]
    rows, same = (
        np.concatenate(part) for part in zip(*(e for e in examples if len(e[0])), strict=True)
    )
    fit_affinity(rows, same).save(path)
    if examples_path:
        np.savez_compressed(examples_path, rows=rows, same=same)
    print(f"{path}: {len(rows)} pairs of {len(seeds)} bags, {same.mean():.0%} one object")


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", help="where to save the affinity")
    parser.add_argument("--seeds", type=int, default=14)
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--shape", type=int, nargs=3, default=(160, 176, 256))
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--examples", default="", help="where to keep the pairs trained on")
    parser.add_argument("--workers", type=int, default=1, help="processes that train")
    options = parser.parse_args(argv)
    seeds = range(options.first, options.first + options.seeds)
    shape = tuple(options.shape)
    train(options.file, seeds, shape, options.count, options.workers, options.examples)


if __name__ == "__main__":
    main()
