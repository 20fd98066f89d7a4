"""A mixture as plain arrays: evaluated without scikit-learn, stored without it.

Fitted as Gaussians and evaluated with the tails of Student's distribution. What lies far from all
that was learned, such as the objects of another scanner, is then told by how far it is from either
side, not by the square of that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, logsumexp

# Of the tails, Student's.
DEGREES_OF_FREEDOM = 10.0
# Of every component. With 0.01, what looked a little unlike everything learned, as all of a real
# scan does, was taken for wrong.
ADDED_VARIANCE = 0.03
# At most; never more than one for every 2 C points, as covariances of fewer would fit their noise.
COMPONENTS = 10


@dataclass(frozen=True, eq=False)
class Mixture:
    """K components in C dimensions.

    Parameters
    ----------
    weights : (K,) ndarray of float64
        Positive, summing to 1.
    means : (K, C) ndarray of float64
        Centres.
    covariances : (K, C, C) ndarray of float64
        Positive definite.
    """

    weights: NDArray[np.float64]
    means: NDArray[np.float64]
    covariances: NDArray[np.float64]

    def log_density(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the log of the mixture's density at (N, C) points."""
        size = self.means.shape[1]
        apart = np.swapaxes(points - self.means[:, None], 1, 2)
        distances = np.square(np.linalg.solve(self._roots, apart)).sum(axis=1)
        tails = (DEGREES_OF_FREEDOM + size) / 2 * np.log1p(distances / DEGREES_OF_FREEDOM)
        return np.asarray(logsumexp(self._peaks[:, None] - tails, axis=0))

    @cached_property
    def _roots(self) -> NDArray[np.float64]:
        # No inverse is needed, and the determinant is the product of a root's diagonal.
        return np.asarray(np.linalg.cholesky(self.covariances))

    @cached_property
    def _peaks(self) -> NDArray[np.float64]:
        """Log density of each component at its mean, and of its weight."""
        size = self.means.shape[1]
        peak = gammaln((DEGREES_OF_FREEDOM + size) / 2) - gammaln(DEGREES_OF_FREEDOM / 2)
        peak -= size / 2 * np.log(DEGREES_OF_FREEDOM * np.pi)
        diagonals = np.diagonal(self._roots, axis1=1, axis2=2)
        return np.asarray(np.log(self.weights) + peak - np.log(diagonals).sum(axis=1))


def pooled(mixtures: Sequence[Mixture], counts: Sequence[int]) -> Mixture:
    """Return the mixture of mixtures, weighted by the points that each was fitted to.

    Parameters
    ----------
    mixtures : sequence of Mixture
    counts : sequence of int
        Points of each.
    """
    weights = [m.weights * n / float(sum(counts)) for m, n in zip(mixtures, counts, strict=True)]
    return Mixture(
        np.concatenate(weights),
        np.concatenate([m.means for m in mixtures]),
        np.concatenate([m.covariances for m in mixtures]),
    )


def fit_mixture(points: NDArray[np.float64], seed: int) -> Mixture:
    """Fit a mixture with as many components as BIC prefers.

    Parameters
    ----------
    points : (N, C) ndarray of float64
        In units of about a standard deviation.
    seed : int
        Of the initialisation.
    """
    # Full covariances.
    from sklearn.mixture import GaussianMixture

    count = max(1, min(COMPONENTS, len(points) // (2 * points.shape[1])))
    models = [
        GaussianMixture(
            k, reg_covar=ADDED_VARIANCE, random_state=seed, n_init=2, init_params="k-means++"
        ).fit(points)
        for k in range(1, count + 1)
    ]
    best = min(models, key=lambda model: model.bic(points))
    return Mixture(best.weights_, best.means_, best.covariances_)
