"""A mixture of Gaussians as plain arrays: evaluated without scikit-learn, stored without it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Mixture:
    """K Gaussians in C dimensions.

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
        from scipy.special import logsumexp

        terms = []
        for weight, mean, covariance in zip(
            self.weights, self.means, self.covariances, strict=True
        ):
            root = np.linalg.cholesky(covariance)
            whitened = np.linalg.solve(root, (points - mean).T)
            spread = 2 * np.log(np.diag(root)).sum() + len(mean) * np.log(2 * np.pi)
            terms.append(np.log(weight) - (np.square(whitened).sum(axis=0) + spread) / 2)
        return np.asarray(logsumexp(terms, axis=0))


def fit_mixture(points: NDArray[np.float64], seed: int, most: int = 10) -> Mixture:
    """Fit a mixture with as many components as BIC prefers.

    Parameters
    ----------
    points : (N, C) ndarray of float64
        In units of about a standard deviation.
    seed : int
        Of the initialisation.
    most : int
        Components at most; never more than one for every 2 C points.

    Returns
    -------
    Mixture

    Notes
    -----
    Full covariances, regularised by 1e-2.
    """
    from sklearn.mixture import GaussianMixture

    count = max(1, min(most, len(points) // (2 * points.shape[1])))
    models = [
        GaussianMixture(
            k, reg_covar=1e-2, random_state=seed, n_init=2, init_params="k-means++"
        ).fit(points)
        for k in range(1, count + 1)
    ]
    best = min(models, key=lambda model: model.bic(points))
    return Mixture(best.weights_, best.means_, best.covariances_)
