"""A small model that learns from a person's answers while they are given."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# What is measured of a decision: which kind it is, the smaller side's voxels (log10 of
# thousands), how much larger the other is (log10), the share of its surface that touches it, and
# of log densities the gap, the step at the contact, the dip there, and the denser side's mean; of
# an object alone, its mean and its surface over its volume.
FEATURES = (
    "join",
    "border",
    "object",
    "size",
    "ratio",
    "contact",
    "gap",
    "step",
    "dip",
    "density",
    "ragged",
)
# Their usual spread on simulated bags; weights are per spread.
SPREAD = np.array([1.0, 1.0, 1.0, 1.0, 0.7, 0.2, 0.4, 0.3, 0.2, 0.7, 0.7])
# Weights before any answer, and how far the method's odds are believed: fitted by
# `python -m benchmarks.segmentation.review --fit` on validation bags.
SEED = np.array([1.02, -1.84, 1.49, 0.07, -0.43, 0.71, -0.29, -0.44, 0.11, 0.29, 0.55])
BELIEF = 0.24
# Deviation of a weight before any answer. An answer against the method moves what is like it by
# about so much in odds, and ten that agree turn it round.
PRIOR = 0.5
# Odds beyond are not believed: what was learned elsewhere may be wrong here.
MOST_ODDS = 5.0


@dataclass(frozen=True, eq=False)
class Rescoring:
    """The weights of the features, on top of the method's own probability.

    Parameters
    ----------
    weights : (F,) ndarray of float64
    """

    weights: Floats

    @staticmethod
    def of(rows: Floats, same: NDArray[np.bool_], chances: Floats) -> Rescoring:
        """Learn from answers: logistic regression with the method's odds as offset.

        Parameters
        ----------
        rows : (N, F) ndarray of float64
        same : (N,) ndarray of bool
            Whether a person called both sides one object.
        chances : (N,) ndarray of float64
            What the method had said.
        """
        weights = SEED
        if not len(rows):
            return Rescoring(weights)
        known, base = rows / SPREAD, BELIEF * odds(chances)
        # Newton's steps on the posterior; it is convex, and small.
        for _ in range(20):
            said = 1 / (1 + np.exp(-(base + known @ weights)))
            slope = known.T @ (same - said) - (weights - SEED) / PRIOR**2
            bend = (known.T * (said * (1 - said))) @ known + np.eye(len(weights)) / PRIOR**2
            change = np.linalg.solve(bend, slope)
            weights = weights + change
            if np.abs(change).max() < 1e-6:
                break
        return Rescoring(weights)

    def chances(self, rows: Floats, chances: Floats) -> Floats:
        """Return the probability that both sides are one object, by method and answers.

        Parameters
        ----------
        rows : (N, F) ndarray of float64
        chances : (N,) ndarray of float64
            What the method had said.
        """
        total = BELIEF * odds(chances) + rows / SPREAD @ self.weights
        return np.asarray(1 / (1 + np.exp(-total)))


def odds(chances: Floats) -> Floats:
    """Return the log odds of probabilities, within bounds."""
    safe = np.clip(chances, 1e-6, 1 - 1e-6)
    return np.asarray(np.clip(np.log(safe / (1 - safe)), -MOST_ODDS, MOST_ODDS))
