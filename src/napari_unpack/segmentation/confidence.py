"""The confidence oracle: how much a region looks like exactly one object.

One-class, after Grady et al. 2012 (AQUA): features of good objects are z-scored, rotated by
principal components, and their density is modelled by a mixture of Gaussians.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.features import FEATURES, features
from napari_unpack.segmentation.region import Region

FORMAT = "napari-unpack oracle 1"
FIELDS = ("center", "scale", "axes", "weights", "means", "covariances", "quantiles")


@dataclass(frozen=True, eq=False)
class Oracle:
    """A trained confidence.

    Parameters
    ----------
    center, scale : (F,) ndarray of float64
        z-score of the features.
    axes : (C, F) ndarray of float64
        Principal components.
    weights, means, covariances : (K,), (K, C), (K, C, C) ndarrays of float64
        The mixture.
    quantiles : (101,) ndarray of float64
        Log-likelihoods of the training objects at every percentile.
    """

    center: NDArray[np.float64]
    scale: NDArray[np.float64]
    axes: NDArray[np.float64]
    weights: NDArray[np.float64]
    means: NDArray[np.float64]
    covariances: NDArray[np.float64]
    quantiles: NDArray[np.float64]

    @staticmethod
    def fit(objects: Iterable[Region], seed: int = 0) -> Oracle:
        """Learn what good objects look like.

        Parameters
        ----------
        objects : iterable of Region
            At least eight, each exactly one object.
        seed : int
            Of the mixture's initialisation.

        Returns
        -------
        Oracle

        Raises
        ------
        ValueError
            If there are fewer than eight objects.
        """
        return fit_features(np.array([features(region) for region in objects]), seed)

    def log_likelihood(self, table: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the log-likelihood of (N, F) feature rows under the mixture."""
        from scipy.special import logsumexp

        scores = np.clip((table - self.center) / self.scale, -12, 12) @ self.axes.T
        terms = []
        for weight, mean, covariance in zip(
            self.weights, self.means, self.covariances, strict=True
        ):
            root = np.linalg.cholesky(covariance)
            whitened = np.linalg.solve(root, (scores - mean).T)
            spread = 2 * np.log(np.diag(root)).sum() + len(mean) * np.log(2 * np.pi)
            terms.append(np.log(weight) - (np.square(whitened).sum(axis=0) + spread) / 2)
        return np.asarray(logsumexp(terms, axis=0))

    def percentile(self, table: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the share of training objects that (N, F) feature rows surpass, in [0, 1].

        Notes
        -----
        Below every training object the percentile falls on as exp of the shortfall, so that
        bad regions can still be told from worse ones.
        """
        likelihood = self.log_likelihood(table)
        inside = np.interp(likelihood, self.quantiles, np.linspace(0.01, 1, len(self.quantiles)))
        span = max(float(self.quantiles[50] - self.quantiles[0]), 1.0)
        short = np.minimum(likelihood - self.quantiles[0], 0) / span
        return np.where(short < 0, 0.01 * np.exp(short), inside)

    def score(self, region: Region) -> float:
        """Return the confidence in [0, 1] that a region is exactly one object."""
        return float(self.percentile(features(region)[None])[0])

    __call__ = score

    def save(self, path: str | Path) -> None:
        """Write the oracle as an npz of plain arrays."""
        arrays = {name: getattr(self, name) for name in FIELDS}
        with Path(path).open("wb") as file:
            np.savez_compressed(file, format=FORMAT, features=np.array(FEATURES), **arrays)

    @staticmethod
    def load(path: str | Path) -> Oracle:
        """Read an oracle.

        Raises
        ------
        ValueError
            If the file is not an oracle, is damaged, or is of another version.
        """
        import zipfile

        try:
            with np.load(path) as file:
                found = {name: file[name] for name in file.files}
        except (ValueError, EOFError, OSError, zipfile.BadZipFile, KeyError) as error:
            if isinstance(error, FileNotFoundError):
                raise
            raise ValueError(f"{path} is not an oracle, or is damaged: {error}") from error
        if str(found.get("format")) != FORMAT or tuple(found.get("features", ())) != FEATURES:
            raise ValueError(
                f"{path} is not an oracle of this version ({FORMAT}, {len(FEATURES)} features); "
                "train it again"
            )
        missing = [name for name in FIELDS if name not in found]
        if missing:
            raise ValueError(f"{path} is a damaged oracle: it lacks {', '.join(missing)}")
        return Oracle(**{name: np.asarray(found[name], np.float64) for name in FIELDS})


def fit_features(table: NDArray[np.float64], seed: int = 0) -> Oracle:
    """Fit an oracle to the features of good objects.

    Parameters
    ----------
    table : (N, F) ndarray of float64
        A row for every object, columns as `features.FEATURES`; N at least 8.
    seed : int
        Of the mixture's initialisation.

    Returns
    -------
    Oracle

    Raises
    ------
    ValueError
        If there are too few rows.

    Notes
    -----
    z-score by mean and standard deviation; principal components keep 95 % of the variance; the
    mixture has 1 to 10 full Gaussians, as many as BIC prefers, regularised by 1e-2 in units of
    a standard deviation.
    """
    from sklearn.mixture import GaussianMixture

    if len(table) < 8:
        raise ValueError(f"an oracle needs at least 8 objects to learn from, got {len(table)}")
    center = table.mean(axis=0)
    scale = np.maximum(table.std(axis=0), 1e-3)
    scores = (table - center) / scale
    variances, vectors = np.linalg.eigh(np.cov(scores.T))
    order = np.argsort(variances)[::-1]
    share = np.cumsum(variances[order]) / variances.sum()
    axes = vectors[:, order[: int(np.searchsorted(share, 0.95)) + 1]].T
    # The sign of an eigenvector is arbitrary; fix it, so that training is reproducible.
    axes = axes * np.sign(axes[np.arange(len(axes)), np.abs(axes).argmax(axis=1)])[:, None]
    projected = scores @ axes.T
    most = max(1, min(10, len(table) // (2 * len(axes))))
    models = [
        GaussianMixture(
            k, reg_covar=1e-2, random_state=seed, n_init=2, init_params="k-means++"
        ).fit(projected)
        for k in range(1, most + 1)
    ]
    best = min(models, key=lambda model: model.bic(projected))
    blank = Oracle(
        center, scale, axes, best.weights_, best.means_, best.covariances_, np.zeros(101)
    )
    likelihood = blank.log_likelihood(table)
    quantiles = np.quantile(likelihood, np.linspace(0, 1, 101))
    return Oracle(center, scale, axes, best.weights_, best.means_, best.covariances_, quantiles)
