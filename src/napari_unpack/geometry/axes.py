"""Vectors, voxel sizes and homogeneous matrices, in z, y, x order (see CONVENTIONS.md).

x, y, z exists only towards vispy and file formats, and `flip` converts it there.
"""

from __future__ import annotations

from collections.abc import Iterable
from numbers import Real
from typing import TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

LARGEST_SPACING = 1e9
"""mm; a thousand kilometres. A billionth of a millimetre is the other end: less than an atom."""

STRETCHED = 10_000
"""Times that one side of a voxel may be longer than another: rays go in steps of the shortest."""


def flip(vectors: ArrayLike) -> NDArray[np.float64]:
    """Swap z, y, x and x, y, z along the last axis of (..., 3) points or vectors."""
    return np.asarray(vectors, dtype=np.float64)[..., ::-1]


def flip_matrix(matrix: ArrayLike) -> Matrix:
    """Reorder an affine or projective (4, 4) column-vector matrix between zyx and xyz."""
    order = [2, 1, 0, 3]
    return np.asarray(matrix, dtype=np.float64)[np.ix_(order, order)]


def fixed(array: ArrayLike) -> NDArray[np.float64]:
    """Return an array that cannot be written to: itself where it is one, else a copy."""
    found = np.asarray(array, dtype=np.float64)
    if found.flags.writeable:
        found = found.copy()
        found.flags.writeable = False
    return found


def is_integer(value: object) -> TypeGuard[int | np.integer]:
    """Tell whether a value is a whole number, of Python or of numpy; True and False are none."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def number(value: object, name: str) -> float:
    """Return a real number as a plain one.

    Parameters
    ----------
    value : object
    name : str
        What to call it in the error.

    Raises
    ------
    TypeError
        If it is none.
    """
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if isinstance(value, bool) or not isinstance(value, Real):
        raise TypeError(f"{name} must be a number, got {value!r}")
    return float(value)


def unit(vector: ArrayLike, name: str = "vector") -> Vector:
    """Scale a (3,) vector to length 1.

    Parameters
    ----------
    vector : (3,) array_like
        Any finite vector but zero.
    name : str
        What to call it in the error.

    Raises
    ------
    ValueError
        If it is not three finite numbers, or zero.
    """
    v = np.asarray(vector, dtype=np.float64)
    if v.shape != (3,) or not np.isfinite(v).all():
        raise ValueError(f"{name} must be three finite numbers (z, y, x), got {vector!r}")
    if not v.any():
        raise ValueError(f"{name} must not be zero, got {vector!r}")
    # Squares of very large or small numbers are infinite or nothing.
    if not 1e-150 < np.abs(v).max() < 1e150:
        v = v / np.abs(v).max()
    return np.asarray(v / float(np.linalg.norm(v)))


def checked_spacing(spacing: ArrayLike, name: str = "spacing") -> NDArray[np.float64]:
    """Return a voxel size as an array that nobody can write to.

    Parameters
    ----------
    spacing : (3,) array_like, mm z y x
    name : str
        What to call it in the error.

    Raises
    ------
    ValueError
        If it is not three positive finite numbers, or no microscope and no telescope has such.
    """
    try:
        mm = fixed(spacing)
    except (TypeError, ValueError):
        mm = np.zeros(0)
    if mm.shape != (3,) or not (np.isfinite(mm) & (mm > 0)).all():
        raise ValueError(f"{name} must be three positive numbers of mm (z, y, x), got {spacing!r}")
    if mm.min() < 1 / LARGEST_SPACING or mm.max() > min(LARGEST_SPACING, STRETCHED * mm.min()):
        raise ValueError(
            f"{name} must be from {1 / LARGEST_SPACING:g} to {LARGEST_SPACING:g} mm, and along one "
            f"axis at most {STRETCHED:,} times that along another, got {mm.tolist()}"
        )
    return mm


def voxel_size(spacing: ArrayLike, source: object = None) -> tuple[float, float, float]:
    """Return a voxel size as three floats.

    Parameters
    ----------
    spacing : (3,) array_like, mm z y x
    source : object, optional
        What holds it, for the message.

    Raises
    ------
    ValueError
        As for `checked_spacing`.
    """
    name = "spacing" if source is None else f"the voxel size in {source}"
    return triple(checked_spacing(spacing, name))


def transform_points(matrix: Matrix, points: ArrayLike) -> NDArray[np.float64]:
    """Apply a (4, 4) column-vector matrix to (..., 3) points, dividing by w.

    Parameters
    ----------
    matrix : (4, 4) ndarray of float64
        Affine or projective.
    points : (..., 3) array_like
        Points in the matrix's source space.
    """
    p = np.asarray(points, dtype=np.float64)
    q = p @ matrix[:3, :3].T + matrix[:3, 3]
    w = p @ matrix[3, :3] + matrix[3, 3]
    return q / w[..., None]


def triple(vector: Iterable[float]) -> tuple[float, float, float]:
    """Return three numbers as they stand in states: a tuple, which can be compared."""
    z, y, x = (float(v) for v in vector)
    return z, y, x
