"""Train the classifier of pieces, which parts what was joined over a step of density.

`python -m benchmarks.segmentation.part_splitting_training
src/napari_unpack/segmentation/weights/part_splitting.npz --workers 2` gives it,
to the bit for one state of the code, one network, one classifier of parts and one machine; it needs
`pip install --group train`. The shipped file is the mean of two: an older one, of bags, coated and
clad solids alone with the classifier of parts of commit f0e3710, and one of these families and of
caps alone in air with that of commit 3bcf02c. What these families give alone joins a cap with its
ball (docs/segmentation.md). No test and no row of the tables uses its seeds. To be run after every
training of the network or of the classifier of parts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.segmentation.classifier_training import METAL_AND_RAYS, Scans, learn, train
from benchmarks.segmentation.pair_examples import overlaps
from benchmarks.segmentation.training_scans import Scan
from napari_unpack.segmentation.learned.method import split_at_density_steps
from napari_unpack.segmentation.learned.pair_classifier import PairClassifier
from napari_unpack.segmentation.learned.part_splitting import PIECE_FEATURES, Pieces

SCANS = (
    Scans("bags", 40),
    Scans("solids", 30),
    Scans("clad solids", 40),
    Scans("coated solids", 40),
    Scans("alike solids", 30, times=4),
    *METAL_AND_RAYS,
)
ROUNDS = 1
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


def fit(states: list[State]) -> PairClassifier:
    """Return the classifier of such pieces."""
    from benchmarks.segmentation.pair_training import fit_ensemble

    return learn(states, ROUNDS, lambda pairs, same: fit_ensemble(pairs, same, PIECE_FEATURES))


if __name__ == "__main__":
    train(str(__doc__), measured, SCANS, fit)
