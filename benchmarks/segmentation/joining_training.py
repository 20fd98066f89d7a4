"""Train the judge that joins large parts with the network's help, and that ships with the package.

`python -m benchmarks.segmentation.joining_training
src/napari_unpack/segmentation/weights/part_merging.npz --workers 2` gives it,
to the bit for one state of the code, one network and one machine; no test
and no row of the tables uses its seeds, nor did the network see them. To be run after every
training of the network.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.segmentation.judges import Scan, learn, train
from napari_unpack.segmentation.learned.pair_classifier import PairClassifier, fit_affinity
from napari_unpack.segmentation.learned.part_merging import FEATURES, SeenParts
from napari_unpack.segmentation.training import overlaps

BAGS, ROUNDS = 16, 2
State = tuple[SeenParts, NDArray[np.float64]]


def measured(scanned: Scan) -> State:
    """Return the parts of a scan, and what they share with the true objects."""
    seen = scanned.seen()
    return seen.measured, overlaps(seen.parts, scanned.truth)


def fit(states: list[State]) -> PairClassifier:
    """Return the judge of such parts."""
    return learn(states, ROUNDS, lambda pairs, one: fit_affinity(pairs, one, features=FEATURES))


if __name__ == "__main__":
    train(str(__doc__), measured, BAGS, ("",), fit)
