"""Arguments of a session, checked once at the door."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.relabeling import compact_labels

# Kernels and textures see labels of 16 bits.
MOST_ID = 65535

MOST_PLANES = 8
"""Clipping planes that both backends take."""


def checked_volume(volume: ArrayLike) -> NDArray[Any]:
    """Return a volume one can look into; a mask is one of 0 and 1.

    Raises
    ------
    TypeError
        If it does not hold real numbers.
    ValueError
        If it is not 3D, is empty, or has no finite value.
    """
    array = np.asarray(volume)
    if array.ndim != 3:
        raise ValueError(f"volume must be 3D (Z, Y, X), got shape {array.shape}")
    if array.size == 0:
        raise ValueError(f"volume must not be empty, got shape {array.shape}")
    if array.dtype.kind not in "biuf":
        raise TypeError(f"volume must hold real numbers, got {array.dtype}")
    if array.dtype.kind == "b":
        return array.view(np.uint8)
    if array.dtype.kind == "f" and not np.isfinite(array).any():
        raise ValueError("volume must hold finite densities, got NaN or infinity everywhere")
    return array


def checked_labels(
    labels: ArrayLike, shape: tuple[int, ...]
) -> tuple[NDArray[np.uint16], NDArray[np.int64] | None]:
    """Return labels of a volume's shape as C-contiguous uint16.

    Parameters
    ----------
    labels : (Z, Y, X) array_like of int
        IDs from 0; those above 65,535 are renumbered.
    shape : tuple of int
        The volume's.

    Returns
    -------
    labels : (Z, Y, X) ndarray of uint16
    given : (N + 1,) ndarray of int64, optional
        By ID, what it was in the labels given; None where that is the same. IDs above 65,535
        are renumbered.

    Raises
    ------
    TypeError
        If they are not integers.
    ValueError
        If their shape is another, one is negative, all are 0, or there are more than 65,535.
    """
    array = np.asarray(labels)
    if array.shape != shape:
        raise ValueError(f"labels must have the volume's shape {shape}, got {array.shape}")
    if array.dtype.kind not in "uib":
        raise TypeError(f"labels must be integers, got {array.dtype}")
    low, high = int(array.min()), int(array.max())
    if low < 0:
        raise ValueError(f"labels must not be negative, got {low}")
    if high == 0:
        raise ValueError("labels hold no object: all are 0")
    if high > MOST_ID:
        # Tables of IDs are int64.
        if high > np.iinfo(np.int64).max:
            raise ValueError(f"labels must be below 2**63, got {high}: renumber them")
        return compact_labels(array)
    return np.ascontiguousarray(array, dtype=np.uint16), None


def checked_ids(ids: int | Iterable[int], known: Iterable[int], name: str = "ids") -> list[int]:
    """Return IDs as a list without repeats, in the order given.

    Parameters
    ----------
    ids : int or iterable of int
    known : iterable of int
        The objects there are.
    name : str
        Of the argument, for the message.

    Raises
    ------
    TypeError
        If one is not an integer.
    ValueError
        If one is not among the known.
    """
    given = [ids] if isinstance(ids, int | np.integer) else list(ids)
    for i in given:
        # True would pass for object 1.
        if isinstance(i, bool | np.bool_) or not isinstance(i, int | np.integer):
            raise TypeError(f"{name} must be object IDs (integers), got {i!r}")
    # In the order given, in which they leave where nothing else decides.
    wanted = list(dict.fromkeys(int(i) for i in given))
    strangers = set(wanted).difference(known)
    if strangers:
        raise ValueError(f"{name} must be objects of this session, got {sorted(strangers)}")
    return wanted


def checked_kind(value: object, kind: type, name: str) -> None:
    """Refuse what is not of a kind.

    Parameters
    ----------
    value : object
    kind : type
    name : str
        Of the argument, for the message.

    Raises
    ------
    TypeError
        If it is another.
    """
    if not isinstance(value, kind):
        raise TypeError(f"{name} must be a {kind.__name__}, got {value!r}")


def checked_count(n: int) -> int:
    """Return a number of objects.

    Raises
    ------
    ValueError
        If it is below 1.
    """
    if n < 1:
        raise ValueError(f"n_or_ids must be at least 1 object, or a list of IDs, got {n!r}")
    return int(n)


def checked_planes(planes: ArrayLike | None) -> NDArray[np.float64]:
    """Return clipping planes as (N, 2, 3) float64, none for None; a copy nobody can write to.

    Raises
    ------
    ValueError
        If the shape is another, there are more than 8, or a normal has no direction.
    """
    array = np.zeros((0, 2, 3)) if planes is None else np.array(planes, dtype=np.float64)
    if array.size == 0:
        array = array.reshape(0, 2, 3)
    if array.ndim != 3 or array.shape[1:] != (2, 3) or len(array) > MOST_PLANES:
        raise ValueError(
            f"clipping must be (N, 2, 3) with N up to {MOST_PLANES}, a point and a normal a plane "
            f"in voxels z y x, got shape {array.shape}"
        )
    if not np.isfinite(array).all() or (np.abs(array[:, 1]).max(axis=1, initial=0.0) == 0).any():
        raise ValueError("clipping must hold finite points and normals that are not zero")
    # Sessions share planes with scenes that workers draw.
    array.flags.writeable = False
    return array
