"""Train the classifier of large parts, which decides what is merged, and which ships.

`python -m benchmarks.segmentation.part_merging_training
src/napari_unpack/segmentation/weights/part_merging.npz --workers 2` gives it,
to the bit for one state of the code, one network and one machine; the shipped file is of these
families, but was fitted by other scripts: with scans of every second seed by rays from twice as
many, parts of linkage to 0.6, and a second round that follows the classifier before it. It needs
`pip install --group train`. No test and no row of the tables uses its seeds. To be run after every
training of the network.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.segmentation.classifier_training import METAL_AND_RAYS, Scans, learn, train
from benchmarks.segmentation.pair_examples import overlaps
from benchmarks.segmentation.training_scans import Scan
from napari_unpack.segmentation.learned.pair_classifier import PairClassifier
from napari_unpack.segmentation.learned.part_merging import FEATURES, PredictedParts

SCANS = (
    Scans("bags", 64),
    Scans("small bags", 115, times=2),
    Scans("solids", 64),
    Scans("clad solids", 40),
    Scans("coated solids", 30),
    Scans("alike solids", 120, times=8),
    *METAL_AND_RAYS,
)
ROUNDS = 1
State = tuple[PredictedParts, NDArray[np.float64]]


def measured(scanned: Scan) -> State:
    """Return the parts of a scan, and what they share with the true objects."""
    seen = scanned.seen()
    return seen.measured, overlaps(seen.parts, scanned.truth)


def fit(states: list[State]) -> PairClassifier:
    """Return the classifier of such parts."""
    from benchmarks.segmentation.pair_training import fit_ensemble

    return learn(states, ROUNDS, lambda pairs, same: fit_ensemble(pairs, same, FEATURES))


if __name__ == "__main__":
    train(str(__doc__), measured, SCANS, fit)
