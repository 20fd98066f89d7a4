"""Train the classifier of pieces, which parts what was joined over a step of density.

`python -m benchmarks.segmentation.part_splitting_training
src/napari_unpack/segmentation/weights/part_splitting.npz --workers 2` gives it,
to the bit for one state of the code, one network, one classifier of parts and one
machine. No test and no row of the tables uses its seeds, nor did the network see them. To be run
after every training of the network or of the classifier of parts.

Two committees are trained: one on bags and dressed solids, one on all families. The mean of their
logits, seven tenths of it the second's, is what ships. The second alone joins a plate of metal with
the block that it lies on; the first alone takes scans by rays and much metal apart. The shipped
file holds the first as it was trained after the classifier of parts of commit f0e3710.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.segmentation.classifier_training import arguments, ensembles, learn, trained
from benchmarks.segmentation.pair_examples import ensemble, like, overlaps
from benchmarks.segmentation.training_scans import WIDE, Scan
from napari_unpack.segmentation.learned.method import split_at_density_steps
from napari_unpack.segmentation.learned.pair_classifier import PairClassifier
from napari_unpack.segmentation.learned.part_splitting import PIECE_FEATURES, Pieces

NARROW = {"bags": 24, "coated solids": 40, "clad solids": 40}
ALL = {"bags": 16, **WIDE, "coated solids": 30, "clad solids": 30}
ROUNDS, RESTRAINT, OF_NARROW, OF_ALL = 1, 100.0, 9, 4
# Of the committee of all families: with less, scans by rays gain less; with all, metal is lost.
SHARE_OF_ALL = 0.7
# Share of a piece that must be an object's for it to be a piece of that.
SOLID = 0.2
State = tuple[Pieces, NDArray[np.float64]]


def measured(scanned: Scan) -> State:
    """Return the pieces of a scan, and what they share with the true objects."""
    pieces, measured = split_at_density_steps(scanned.volume, scanned.spacing, scanned.seen())
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


def fit_narrow(states: list[State]) -> PairClassifier:
    """Return the committee of bags and dressed solids."""
    return learn(states, ROUNDS, ensembles(PIECE_FEATURES, RESTRAINT, OF_NARROW))


def fit_all(states: list[State]) -> PairClassifier:
    """Return the committee of all families."""
    return learn(states, ROUNDS, ensembles(PIECE_FEATURES, RESTRAINT, OF_ALL))


if __name__ == "__main__":
    options = arguments(str(__doc__))
    narrow = trained(measured, NARROW, fit_narrow, options.workers)
    wide = trained(measured, ALL, fit_all, options.workers)
    ensemble([like(narrow, wide), wide], [1 - SHARE_OF_ALL, SHARE_OF_ALL]).save(options.file)
