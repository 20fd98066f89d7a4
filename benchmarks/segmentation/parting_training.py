"""Train the judge of pieces, which parts what was joined over a step of density.

`python -m benchmarks.segmentation.parting_training src/napari_unpack/segmentation/parting.npz
--workers 2` gives it, to the bit for one state of the code, one network, one judge of parts and one
machine; no test and no row of the tables uses its seeds, nor did the network see them. To be run
after every training of the network or of the judge of parts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.segmentation.judges import Scan, learn, scanned_bag, scanned_solids, train
from napari_unpack.segmentation.affinity import Affinity, committee, fit_affinity
from napari_unpack.segmentation.learned import pieces_seen
from napari_unpack.segmentation.parting import PIECE_FEATURES, Pieces
from napari_unpack.segmentation.training import overlaps

SOLIDS, ROUNDS, MEMBERS, RESTRAINT = 70, 1, 3, 100.0
# Share of a piece that must be an object's for it to be a piece of that.
SOLID = 0.2
State = tuple[Pieces, NDArray[np.float64]]


def measured_bag(seed: int) -> State:
    """Return the pieces of a simulated bag, and what they share with the true objects."""
    return _measured(scanned_bag(seed))


def measured_solids(seed: int) -> State:
    """Return the same of packed solids, some of them with a coat."""
    return _measured(scanned_solids(seed, coated=True))


def _measured(scanned: Scan) -> State:
    pieces, measured = pieces_seen(scanned.volume, scanned.spacing, scanned.seen())
    return measured, owned(measured, overlaps(pieces, scanned.truth))


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


def fit(states: list[State]) -> Affinity:
    """Return the judge of such pieces, a committee."""

    def members(pairs: NDArray[np.float64], one: NDArray[np.bool_]) -> Affinity:
        return committee(
            [fit_affinity(pairs, one, seed, PIECE_FEATURES, RESTRAINT) for seed in range(MEMBERS)]
        )

    return learn(states, ROUNDS, members)


if __name__ == "__main__":
    train(str(__doc__), SOLIDS, measured_bag, measured_solids, fit)
