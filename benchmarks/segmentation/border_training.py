"""Train the classifier of borders, which says whose a voxel is where objects touch.

`python -m benchmarks.segmentation.border_training
src/napari_unpack/segmentation/weights/border_classifier.npz --workers 2` gives it,
to the bit for one state of the code, one network, the classifiers before it and
one machine; the shipped file is of the classifier of parts of commit f0e3710, see
`part_splitting_training`. No
test and no row of the tables uses its seeds, nor did the network see them. To be run after every
training of the network or of the classifiers of parts and of pieces.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.segmentation.classifier_training import Scans, train
from benchmarks.segmentation.pair_examples import fit_classifier
from benchmarks.segmentation.training_scans import Scan
from napari_unpack.segmentation.evaluation import Overlaps
from napari_unpack.segmentation.learned.border_classifier import (
    BORDER_FEATURES,
    BorderEvidence,
    describe,
    find_rivals,
)
from napari_unpack.segmentation.learned.border_refinement import Borders, places_in
from napari_unpack.segmentation.learned.method import sharpened, split_at_density_steps
from napari_unpack.segmentation.learned.pair_classifier import PairClassifier
from napari_unpack.segmentation.learned.part_splitting import merge_pieces

SCANS = (Scans("bags", 24), Scans("solids", 40), Scans("clad solids", 40))
# Of the voxels at borders, and of all examples at most.
SHARE, MOST = 0.12, 400_000
# A label is an object's of which that has so much of it.
OWNED = 0.6
State = tuple[NDArray[np.float32], NDArray[np.bool_]]


def measured(scanned: Scan) -> State:
    """Return what tells about labels at voxels of a scan, and whether the voxels are theirs."""
    seen = scanned.seen()
    pieces, measured = split_at_density_steps(scanned.volume, scanned.spacing, seen)
    rough = merge_pieces(pieces, measured)
    generator = np.random.default_rng(0)
    found = []
    # Borders as they come, which are often further off, and as the classifier will get them.
    for labels in (rough, sharpened(rough, scanned.volume, seen)):
        steps = seen.prediction.next
        evidence = BorderEvidence.of(labels, scanned.volume, seen.scale, steps, seen.noise)
        chosen = generator.random(labels.shape) < SHARE
        found.append(border_examples(labels, evidence, chosen, scanned.truth))
    rows, right = zip(*found, strict=True)
    return np.concatenate(rows), np.concatenate(right)


def border_examples(
    labels: NDArray[np.int32],
    evidence: BorderEvidence,
    chosen: NDArray[np.bool_],
    truth: NDArray[np.integer[Any]],
) -> State:
    """Return what tells about the labels at voxels of borders, and whether the voxels are theirs.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Objects as found; 0 is background.
    evidence : BorderEvidence
        Of them.
    chosen : (Z, Y, X) ndarray of bool
        Voxels to look at; left out are those where a label around is no known object's, and
        those where not exactly one is the true object's.
    truth : (Z, Y, X) ndarray of int
        True objects.

    Returns
    -------
    rows : (N, F) ndarray of float32
        Columns as `border_features.BORDER_FEATURES`.
    right : (N,) ndarray of bool
    """
    at = places_in((labels > 0) & chosen, (0, len(labels)))
    rivals, counts, _ = find_rivals(labels, at)
    at, rivals, counts = at[counts > 1], rivals[counts > 1], counts[counts > 1]
    rows = describe(labels, Borders.of(labels).inside, evidence, at, rivals, counts)
    places = np.repeat(np.ravel_multi_index(tuple(at.T), labels.shape), counts)
    names = rivals[rivals > 0]
    whose = owners(labels, truth)[names]
    right = whose == truth.reshape(-1)[places]
    kept = np.bincount(places, right, truth.size)[places] == 1
    kept &= np.bincount(places, whose == 0, truth.size)[places] == 0
    return rows[kept], right[kept]


def owners(labels: NDArray[np.int32], truth: NDArray[np.integer[Any]]) -> NDArray[np.int64]:
    """Return the true object that each label mostly is, 0 where it is none's or several's."""
    table = Overlaps.of(labels, truth).table
    compact = np.flatnonzero(np.bincount(labels.reshape(-1)))
    objects = np.unique(np.append(truth.reshape(-1), 0))
    main = table.argmax(axis=1)
    clear = table.max(axis=1) > OWNED * table.sum(axis=1)
    owner = np.zeros(int(labels.max()) + 1, np.int64)
    owner[compact[compact > 0]] = np.where(clear, objects[main], 0)[1:]
    return owner


def fit(states: list[State]) -> PairClassifier:
    """Return the classifier of such labels."""
    rows = np.concatenate([r for r, _ in states])
    right = np.concatenate([one for _, one in states])
    print(f"{len(rows)} labels at voxels, {right.mean():.0%} theirs", flush=True)
    kept = np.random.default_rng(0).permutation(len(rows))[:MOST]
    return fit_classifier(rows[kept].astype(np.float64), right[kept], features=BORDER_FEATURES)


if __name__ == "__main__":
    train(str(__doc__), measured, SCANS, fit)
