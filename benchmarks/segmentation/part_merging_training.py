"""Train the classifier of large parts, which decides what is merged, and which ships.

`python -m benchmarks.segmentation.part_merging_training
src/napari_unpack/segmentation/weights/part_merging.npz --workers 2` gives it,
to the bit for one state of the code, one network and one machine; no test
and no row of the tables uses its seeds, nor did the network see them. To be run after every
training of the network.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.segmentation.classifier_training import Scan, learn, train
from benchmarks.segmentation.pair_examples import fit_classifier, overlaps
from napari_unpack.segmentation.learned.pair_classifier import PairClassifier
from napari_unpack.segmentation.learned.part_merging import FEATURES, PredictedParts

BAGS, ROUNDS = 16, 2
State = tuple[PredictedParts, NDArray[np.float64]]


def measured(scanned: Scan) -> State:
    """Return the parts of a scan, and what they share with the true objects."""
    seen = scanned.seen()
    return seen.measured, overlaps(seen.parts, scanned.truth)


def fit(states: list[State]) -> PairClassifier:
    """Return the classifier of such parts."""
    return learn(states, ROUNDS, lambda pairs, one: fit_classifier(pairs, one, features=FEATURES))


if __name__ == "__main__":
    train(str(__doc__), measured, BAGS, ("",), fit)
