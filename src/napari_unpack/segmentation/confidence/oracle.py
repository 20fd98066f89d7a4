"""The confidence oracle: how much a region looks like exactly one object.

After Grady et al. 2012 (AQUA): features of good objects are z-scored, rotated by principal
components, and their density is modelled by a mixture of Gaussians. Regions known to be wrong
(pieces, unions) may be given too; their density calibrates the score (docs/decisions/0005).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from zipfile import BadZipFile, ZipFile

import numpy as np
from numpy.typing import NDArray

from napari_unpack.atomic import checked_target, given_path, written_atomically
from napari_unpack.file_sizes import check_plain_file, load_arrays
from napari_unpack.read_errors import read_errors_told
from napari_unpack.segmentation.common.region import Region
from napari_unpack.segmentation.confidence.examples import FEWEST
from napari_unpack.segmentation.confidence.features import FEATURES, features
from napari_unpack.segmentation.confidence.mixture import Mixture, fit_mixture, pooled
from napari_unpack.tasks import SILENT, Share

FORMAT = "napari-unpack oracle 3"
# Deviations; one feature that is far off must not outweigh all others.
Z_SCORE_LIMIT = 8.0
# Rows from which mixtures are fitted to three quarters of them in turn and averaged: what one
# alone says of things unlike all it learned depends on which these were.
ENOUGH_TO_RESAMPLE = 500

Rows = NDArray[np.float64] | list[NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class Oracle:
    """A trained confidence.

    Parameters
    ----------
    center, scale : (F,) ndarray of float64
        z-score of the features.
    axes : (C, F) ndarray of float64
        Principal components, each over its standard deviation.
    good : Mixture
        Of true objects.
    quantiles : (101,) ndarray of float64
        Log-likelihoods of the training objects at every percentile.
    bad : Mixture, optional
        Of regions that are not one object.
    logistic : (2,) ndarray of float64
        Slope and offset that turn the log-likelihood ratio into a probability.
    """

    center: NDArray[np.float64]
    scale: NDArray[np.float64]
    axes: NDArray[np.float64]
    good: Mixture
    quantiles: NDArray[np.float64]
    bad: Mixture | None
    logistic: NDArray[np.float64]

    @staticmethod
    def fit(objects: Iterable[Region], wrong: Iterable[Region] = (), seed: int = 0) -> Oracle:
        """Learn what good objects look like.

        Parameters
        ----------
        objects : iterable of Region
            At least eight, each exactly one object.
        wrong : iterable of Region
            None, or at least eight regions that are pieces or unions.
        seed : int
            Of the mixtures' initialisation.

        Raises
        ------
        ValueError
            If there are fewer than eight objects, or one to seven wrong ones.
        """
        good = np.array([features(region) for region in objects])
        bad = np.array([features(region) for region in wrong])
        return fit_features(good, bad if len(bad) else None, seed)

    def project(self, table: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the principal components of (N, F) feature rows."""
        return (
            np.clip((table - self.center) / self.scale, -Z_SCORE_LIMIT, Z_SCORE_LIMIT) @ self.axes.T
        )

    def scores(self, table: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the confidence of (N, F) feature rows, in [0, 1] (Li et al. 2012, section 3)."""
        # Without wrong regions this is the percentile of the log-likelihood among the training
        # objects, falling on as exp of the shortfall below the worst of them, so that bad regions
        # can still be told from worse ones. With them it is the calibrated probability of being
        # good.
        points = self.project(table)
        likelihood = self.good.log_density(points)
        if self.bad is not None:
            ratio = likelihood - self.bad.log_density(points)
            # Beyond 40 a confidence is as good as 0 or 1, and far beyond exp would overflow.
            exponent = np.clip(self.logistic[0] * ratio + self.logistic[1], -40, 40)
            return np.asarray(1 / (1 + np.exp(-exponent)))
        inside = np.interp(likelihood, self.quantiles, np.linspace(0.01, 1, len(self.quantiles)))
        span = max(float(self.quantiles[50] - self.quantiles[0]), 1.0)
        short = np.minimum(likelihood - self.quantiles[0], 0) / span
        return np.where(short < 0, 0.01 * np.exp(short), inside)

    def score(self, region: Region) -> float:
        """Return the confidence in [0, 1] that a region is exactly one object."""
        return float(self.scores(features(region)[None])[0])

    __call__ = score

    def save(self, path: str | Path) -> None:
        """Write the oracle as an npz of plain arrays."""
        arrays, names = self.arrays(), np.array(FEATURES)
        with written_atomically(checked_target(path)) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, format=FORMAT, features=names, **arrays)  # type: ignore[arg-type]

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """Return all that it consists of, by the names in `ARRAYS`."""
        found = {name: getattr(self, name) for name in _OWN}
        for side, mixture in (("good", self.good), ("bad", self.bad)):
            if mixture is not None:
                found |= {f"{side}_{name}": getattr(mixture, name) for name in _MIXTURE}
        return found

    @staticmethod
    def of_arrays(found: Mapping[str, NDArray[np.float64]], source: object) -> Oracle:
        """Make an oracle of its arrays.

        Parameters
        ----------
        found : mapping of str to ndarray
            As from `arrays`; others are left alone.
        source : object
            Where they are from, for messages.

        Raises
        ------
        ValueError
            If one is missing, they do not fit each other, or nothing can be scored by them.
        """
        missing = [name for name in ARRAYS if name not in found and not name.startswith("bad_")]
        if missing:
            raise ValueError(f"{source} is a damaged oracle: it lacks {', '.join(missing)}")
        sides: dict[str, Mixture | None] = {"good": None, "bad": None}
        for side in sides:
            if f"{side}_weights" in found:
                sides[side] = Mixture(*(found.get(f"{side}_{n}", np.zeros(0)) for n in _MIXTURE))
        oracle = Oracle(**sides, **{name: found[name] for name in _OWN})  # type: ignore[arg-type]
        if not _fits(oracle):
            raise ValueError(f"{source} is a damaged oracle: its arrays do not fit each other")
        if not _scores(oracle):
            raise ValueError(f"{source} is a damaged oracle: its numbers are those of no model")
        return oracle

    @staticmethod
    def load(path: str | Path) -> Oracle:
        """Read an oracle.

        Raises
        ------
        ValueError
            If the file is not an oracle, is damaged, or is of another version.
        FileNotFoundError
            If there is none.
        """
        path = given_path(path)
        with read_errors_told(path, "an oracle"):
            check_plain_file(path)
            # What numpy says of other archives, such as sessions, says nothing of oracles.
            others = [name for name in _members(path) if not name.endswith(".npy")]
            if others:
                raise ValueError(
                    f"{path} is not an oracle: it holds {_listed_names(others)}, and an oracle "
                    "holds arrays (.npy) alone"
                )
            found, _ = load_arrays(path)
        if str(found.get("format")) != FORMAT or tuple(found.get("features", ())) != FEATURES:
            raise ValueError(
                f"{path} is not an oracle of this version ({FORMAT}, {len(FEATURES)} features); "
                "train it again"
            )
        return Oracle.of_arrays(found, path)


def is_oracle(path: str | Path) -> bool:
    """Return whether a file is an oracle, of this or another version; no array is read."""
    try:
        return {"format.npy", "features.npy"} <= set(_members(path))
    except (OSError, BadZipFile):
        return False


_OWN = ("center", "scale", "axes", "quantiles", "logistic")
_MIXTURE = ("weights", "means", "covariances")
ARRAYS = (*_OWN, *(f"{side}_{name}" for side in ("good", "bad") for name in _MIXTURE))


def _members(path: str | Path) -> list[str]:
    with ZipFile(path) as archive:
        return archive.namelist()


def _listed_names(names: list[str]) -> str:
    # Some archives hold thousands.
    return ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")


@cache
def default_oracle() -> Oracle:
    """Return the oracle that ships with the package; `benchmarks/train_oracle.py` makes it."""
    return Oracle.load(Path(__file__).parents[1] / "weights" / "oracle.npz")


def _fits(oracle: Oracle) -> bool:
    """Return whether the arrays of an oracle have each other's shapes and finite values."""
    parts, width = oracle.axes.shape[0] if oracle.axes.ndim == 2 else -1, len(FEATURES)
    shapes = [
        (oracle.center, (width,)),
        (oracle.scale, (width,)),
        (oracle.axes, (parts, width)),
        (oracle.quantiles, (101,)),
        (oracle.logistic, (2,)),
    ]
    for mixture in filter(None, (oracle.good, oracle.bad)):
        count = len(mixture.weights)
        shapes += [(mixture.weights, (max(count, 1),)), (mixture.means, (count, parts))]
        shapes.append((mixture.covariances, (count, parts, parts)))
    return all(a.shape == shape and np.isfinite(a).all() for a, shape in shapes)


def _scores(oracle: Oracle) -> bool:
    """Return whether an oracle divides by nothing that is 0, and has densities."""
    mixtures = [m for m in (oracle.good, oracle.bad) if m is not None]
    if not (oracle.scale > 0).all() or not all((m.weights > 0).all() for m in mixtures):
        return False
    try:
        # As `Mixture` does: of others the first repair would fail.
        for mixture in mixtures:
            np.linalg.cholesky(mixture.covariances)
    except np.linalg.LinAlgError:
        return False
    return True


def fit_features(
    good: Rows, bad: Rows | None = None, seed: int = 0, share: Share = SILENT
) -> Oracle:
    """Fit an oracle to feature rows.

    Parameters
    ----------
    good : (N, F) ndarray of float64, or a list of such
        Of true objects, columns as `features.FEATURES`; N at least 8. Each of a list, such as the
        scans of one scanner, gets a mixture of its own.
    bad : (M, F) ndarray of float64, or a list of such, optional
        Of wrong regions; M at least 8.
    seed : int
        Of the mixtures' initialisation.
    share : Share

    Raises
    ------
    ValueError
        If there are too few rows.
    """
    # z-score by the mean and standard deviation of the good, and their principal components up to
    # 95 % of the variance, scaled to unit variance. Measured on unseen bags this told true objects
    # from false ones better than 99 %, and than median and MAD, which blow up features that are
    # alike in most objects.
    kinds, wrong = _listed(good), [] if bad is None else _listed(bad)
    for side, name in ((kinds, "objects"), (kinds if bad is None else wrong, "wrong regions")):
        if (least := min(map(len, side))) < FEWEST:
            raise ValueError(f"an oracle needs at least {FEWEST} {name} to learn from, got {least}")
    true = np.concatenate(kinds)
    center = true.mean(axis=0)
    scale = np.maximum(true.std(axis=0), 1e-3)
    axes = _principal(np.clip((true - center) / scale, -Z_SCORE_LIMIT, Z_SCORE_LIMIT), 0.95)
    blank = Oracle(
        center, scale, axes, Mixture(*(np.zeros(1),) * 3), np.zeros(101), None, np.zeros(2)
    )

    def fit(side: list[NDArray[np.float64]], share: Share) -> Mixture:
        parts = [rows for group in side for rows in _resampled(blank.project(group))]
        fitted = [fit_mixture(rows, seed) for rows in share.over(parts)]
        return pooled(fitted, [len(rows) for rows in parts])

    model = fit(kinds, share.part(0.0, 0.5))
    quantiles = np.quantile(model.log_density(blank.project(true)), np.linspace(0, 1, 101))
    if bad is None:
        return Oracle(center, scale, axes, model, quantiles, None, np.array([1.0, 0.0]))
    other = fit(wrong, share.part(0.5, 1.0))
    ratios = [
        model.log_density(blank.project(rows)) - other.log_density(blank.project(rows))
        for rows in (true, np.concatenate(wrong))
    ]
    return Oracle(center, scale, axes, model, quantiles, other, _calibrate(*ratios))


def _resampled(rows: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return rows without each quarter of them in turn, where they are many."""
    if len(rows) < ENOUGH_TO_RESAMPLE:
        return [rows]
    quarters = np.array_split(np.arange(len(rows)), 4)
    return [np.delete(rows, quarter, axis=0) for quarter in quarters]


def _listed(rows: Rows) -> list[NDArray[np.float64]]:
    return [rows] if isinstance(rows, np.ndarray) else list(rows)


def _principal(rows: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    variances, vectors = np.linalg.eigh(np.cov(rows.T))
    order = np.argsort(variances)[::-1]
    # Not divided by their sum, which is 0 where all objects are alike.
    explained, wanted = np.cumsum(variances[order]), share * variances.sum()
    # The first components that explain the share: what is left is noise of single bags.
    axes = vectors[:, order[: int(np.searchsorted(explained, wanted)) + 1]].T
    # The sign of an eigenvector is arbitrary; fixing it keeps training reproducible.
    signs = np.sign(axes[np.arange(len(axes)), np.abs(axes).argmax(axis=1)])
    deviations = np.sqrt(np.maximum(variances[order[: len(axes)]], 1e-12))
    return np.asarray(axes * (signs / deviations)[:, None])


def _calibrate(good: NDArray[np.float64], bad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the logistic regression of good (1) and bad (0), equally weighted, on the ratio."""
    from scipy.optimize import minimize

    # A few extreme ratios would bend the slope for all others.
    low, high = np.quantile(np.concatenate([good, bad]), [0.02, 0.98])
    one, two = np.clip(good, low, high), np.clip(bad, low, high)

    def loss(p: NDArray[np.float64]) -> float:
        right = np.logaddexp(0, -(p[0] * one + p[1])).mean()
        return float(right + np.logaddexp(0, p[0] * two + p[1]).mean())

    return np.asarray(minimize(loss, np.array([0.5, 0.0]), method="Nelder-Mead").x)
