"""Train the judge that joins large parts with the network's help, and that ships with the package.

`python -m benchmarks.segmentation.joining_training src/napari_unpack/segmentation/joining.npz
--workers 2` gives it, to the bit for one state of the code, one network and one machine; no test
and no row of the tables uses its seeds, nor did the network see them. To be run after every
training of the network.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from copy import deepcopy
from multiprocessing import get_context

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.boundaries.examples import scan
from benchmarks.boundaries.solids import packed_solids
from napari_unpack.segmentation.affinity import Affinity, fit_affinity
from napari_unpack.segmentation.joining import FEATURES, SeenParts
from napari_unpack.segmentation.learned import learned_parts
from napari_unpack.segmentation.training import examples_of, overlaps
from napari_unpack.simulation import simulate_bag

FIRST, BAGS, SOLIDS = 300, 16, 40
ROUNDS = 2
State = tuple[SeenParts, NDArray[np.float64]]


def measured_bag(seed: int) -> State:
    """Return the parts of a simulated bag, and what they share with the true objects."""
    bag = simulate_bag(seed=seed)
    a, b, c = (float(s) for s in bag.spacing)
    seen = learned_parts(bag.volume, (a, b, c), lambda fraction, text: None)
    return seen.measured, overlaps(seen.parts, bag.labels)


def measured_solids(seed: int) -> State:
    """Return the same of packed solids, as they are scanned to train the network."""
    density, labels = packed_solids(seed)
    scanned = scan(np.random.default_rng(seed), density.astype(np.float32))
    volume = np.clip(scanned, 0, 32000).astype(np.uint16)
    seen = learned_parts(volume, (1.0, 1.0, 1.0), lambda fraction, text: None)
    return seen.measured, overlaps(seen.parts, labels)


def fit(states: list[State], rounds: int = ROUNDS) -> Affinity:
    """Learn from the joins that the truth makes, then from those that the judge itself makes."""
    rows, same = [], []
    judge = None
    for _ in range(rounds + 1):
        for measured, shared in states:
            fresh = deepcopy(measured)
            pairs, one = examples_of(fresh, shared, judge, fresh.features)
            if len(pairs):
                rows.append(pairs)
                same.append(one)
        judge = fit_affinity(np.concatenate(rows), np.concatenate(same), features=FEATURES)
        print(
            f"{sum(map(len, rows))} pairs, {np.concatenate(same).mean():.0%} one object", flush=True
        )
    assert judge is not None
    return judge


def main(argv: list[str] | None = None) -> None:
    """Train and save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", help="where to save the judge")
    parser.add_argument("--bags", type=int, default=BAGS)
    parser.add_argument("--solids", type=int, default=SOLIDS)
    parser.add_argument("--workers", type=int, default=1, help="processes")
    options = parser.parse_args(argv)
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as pool:
        states = list(pool.map(measured_bag, range(FIRST, FIRST + options.bags)))
        # The network learned from the first 260.
        states += pool.map(measured_solids, range(FIRST, FIRST + options.solids))
    # Many threads on small matrices wait for one another, and add up in any order.
    with threadpool_limits(1):
        fit(states).save(options.file)


if __name__ == "__main__":
    main()
