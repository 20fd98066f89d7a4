"""Learning classifiers of pairs: examples from labelled volumes, fitting, and ensembles."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from napari_unpack.segmentation.evaluation import Overlaps
from napari_unpack.segmentation.learned.pair_classifier import (
    PAIR_FEATURES,
    PairClassifier,
    Parts,
    agglomerate,
)


def fit_classifier(
    rows: NDArray[np.float64],
    same: NDArray[np.bool_],
    features: tuple[str, ...] = PAIR_FEATURES,
) -> PairClassifier:
    """Train one small classifier; `pair_training.fit_ensemble` makes quieter ones.

    Parameters
    ----------
    rows : (N, F) ndarray of float64
        Pairs.
    same : (N,) ndarray of bool
        Whether they are one object.
    features : tuple of str
        Names of the columns.
    """
    from sklearn.neural_network import MLPClassifier

    center, scale = np.median(rows, axis=0), rows.std(axis=0) + 1e-6
    network = MLPClassifier(
        (24, 12), activation="tanh", solver="lbfgs", alpha=1.0, max_iter=800, random_state=0
    )
    network.fit(np.clip((rows - center) / scale, -6, 6), same)
    weights = tuple(w.astype(np.float32) for w in network.coefs_)
    offsets = tuple(o.astype(np.float32) for o in network.intercepts_)
    return PairClassifier(center, scale, weights, offsets, features)


def ensemble(members: Sequence[PairClassifier]) -> PairClassifier:
    """Return the one network whose logit is the mean of those of several.

    Parameters
    ----------
    members : sequence of PairClassifier
        Over the same features, with the same center and scale and as many layers.
    """
    first = [np.hstack([j.weights[0] for j in members])]
    layers = zip(*(j.weights[1:-1] for j in members), strict=True)
    between = [block_diag(*layer) for layer in layers]
    last = [np.vstack([j.weights[-1] for j in members]) / len(members)]
    inner = zip(*(j.offsets[:-1] for j in members), strict=True)
    offsets = [np.concatenate(layer) for layer in inner]
    offsets.append(np.mean([j.offsets[-1] for j in members], axis=0))
    one = members[0]
    weights = (*first, *between, *last)
    return PairClassifier(one.center, one.scale, weights, tuple(offsets), one.features)


def overlaps(parts: NDArray[np.int32], truth: NDArray[np.integer]) -> NDArray[np.float64]:
    """Return the voxels that each part shares with each true object.

    Parameters
    ----------
    parts, truth : (Z, Y, X) ndarray of int
        0 is background.

    Returns
    -------
    (M, T) ndarray of float64
        Row 0 is empty.
    """
    table = Overlaps.of(parts, truth).table
    compact = np.flatnonzero(np.bincount(parts.reshape(-1)))
    found = np.zeros((int(parts.max(initial=0)) + 1, table.shape[1]))
    found[compact[compact > 0]] = table[1:]
    return found


def examples_of(
    measured: Parts,
    shared: NDArray[np.float64],
    affinity: PairClassifier | None = None,
    described: Callable[[int, int, NDArray[np.float64]], NDArray[np.float64]] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the pairs that merging parts meets: their features, and whether they are one object.

    Parameters
    ----------
    measured : Parts
        Used up.
    shared : (M, T) ndarray of float64
        See `overlaps`.
    affinity : PairClassifier, optional
        A classifier to follow, so that it learns from the states its own mistakes lead to;
        without one the truth is followed.
    described : callable, optional
        `described(one, two, features) -> features` that the classifier takes.

    Returns
    -------
    rows : (N, F) ndarray of float64
    same : (N,) ndarray of bool
    """
    rows: list[NDArray[np.float64]] = []
    same: list[bool] = []

    def follow(one: int, two: int, row: NDArray[np.float64]) -> float:
        first, second = shared[one], shared[two]
        main = first.argmax(), second.argmax()
        agree = main[0] == main[1]
        if described is not None:
            row = described(one, two, row)
        # Foreground without a label, such as the bag's shell, is no example of anything.
        if main[0] or main[1]:
            rows.append(row)
            same.append(bool(agree))
        if affinity is None:
            return float(agree and main[0] > 0)
        chance = float(affinity.probability(row[None])[0])
        # After a wrong merge no right answer is left: it is recorded, not made.
        return chance if agree else 0.0

    agglomerate(measured, follow)
    return np.array(rows), np.array(same, np.bool_)
