"""Train the judge of pieces, which parts what was joined over a step of density.

`python -m benchmarks.segmentation.parting_training src/napari_unpack/segmentation/parting.npz
--workers 2` gives it, to the bit for one state of the code, one network, one judge of parts and one
machine; no test and no row of the tables uses its seeds, nor did the network see them. To be run
after every training of the network or of the judge of parts.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from copy import deepcopy
from multiprocessing import get_context
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.boundaries.examples import scan
from benchmarks.boundaries.solids import coat, packed_solids
from napari_unpack.segmentation.affinity import Affinity, committee, fit_affinity
from napari_unpack.segmentation.learned import learned_parts, pieces_seen
from napari_unpack.segmentation.parting import PIECE_FEATURES, Pieces
from napari_unpack.segmentation.training import examples_of, overlaps
from napari_unpack.simulation import simulate_bag

FIRST, BAGS, SOLIDS = 300, 16, 70
ROUNDS, MEMBERS, RESTRAINT = 1, 3, 100.0
# Share of a piece that must be an object's for it to be a piece of that.
SOLID = 0.2
State = tuple[Pieces, NDArray[np.float64]]


def measured_bag(seed: int) -> State:
    """Return the pieces of a simulated bag, and what they share with the true objects."""
    bag = simulate_bag(seed=seed)
    return _measured(bag.volume, bag.labels, bag.spacing)


def measured_solids(seed: int) -> State:
    """Return the same of packed solids, some of them with a coat."""
    density, labels = packed_solids(seed)
    coat(seed, density, labels)
    scanned = scan(np.random.default_rng(seed), density.astype(np.float32))
    return _measured(np.clip(scanned, 0, 32000).astype(np.uint16), labels, (1.0, 1.0, 1.0))


def _measured(volume: NDArray[Any], truth: NDArray[Any], spacing: tuple[float, ...]) -> State:
    a, b, c = (float(s) for s in spacing)
    seen = learned_parts(volume, (a, b, c), lambda fraction, text: None)
    pieces, measured = pieces_seen(volume, (a, b, c), seen)
    return measured, owned(measured, overlaps(pieces, truth))


def owned(measured: Pieces, shared: NDArray[np.float64]) -> NDArray[np.float64]:
    """Give pieces that are no object's, such as blurred rims, to what their host mostly is.

    Parameters
    ----------
    measured : Pieces
        M pieces.
    shared : (M, T) ndarray of float64
        See `training.overlaps`.

    Returns
    -------
    (M, T) ndarray of float64
    """
    shared = shared.copy()
    shared[shared[:, 1:].sum(axis=1) > SOLID * shared.sum(axis=1), 0] = 0
    hosts = np.zeros((int(measured.host.max()) + 1, shared.shape[1]))
    np.add.at(hosts, measured.host, shared)
    hosts[:, 0] = 0
    for piece in np.flatnonzero(shared.argmax(axis=1) == 0):
        host = hosts[measured.host[piece]]
        if piece and host.any():
            shared[piece] = 0
            shared[piece, host.argmax()] = measured.sums[piece, 0]
    return shared


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
        examples = np.concatenate(rows), np.concatenate(same)
        judge = committee(
            [fit_affinity(*examples, seed, PIECE_FEATURES, RESTRAINT) for seed in range(MEMBERS)]
        )
        print(f"{len(examples[0])} pairs, {examples[1].mean():.0%} one object", flush=True)
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
        states += pool.map(measured_solids, range(FIRST, FIRST + options.solids))
    # Many threads on small matrices wait for one another, and add up in any order.
    with threadpool_limits(1):
        fit(states).save(options.file)


if __name__ == "__main__":
    main()
