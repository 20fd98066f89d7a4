"""Arguments of a session, checked once at the door."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.axes import Matrix, fixed, is_integer, number
from napari_unpack.geometry.masks import unmasked
from napari_unpack.geometry.relabeling import compact_labels
from napari_unpack.geometry.transforms import Pose, is_rotation
from napari_unpack.rendering import validation
from napari_unpack.rendering.object_style import ObjectStyle

# Kernels and textures see labels of 16 bits.
MOST_ID = 65535

WIDEST = 65_535
"""Pixels of a window; GPUs take textures of 16,384 or 32,768."""


def checked_volume(volume: ArrayLike) -> NDArray[Any]:
    """Return a volume one can look into; one of True and False is one of 0 and 1.

    What is masked was not measured, NaN.

    Raises
    ------
    TypeError
        If it does not hold real numbers.
    ValueError
        If it is not 3D, is empty, or has no finite value.
    """
    array = unmasked(volume, np.nan)
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
    array = unmasked(labels, 0)
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
    given = list(ids) if np.iterable(ids) else [ids]
    for i in given:
        if not is_integer(i):
            raise TypeError(f"{name} must be object IDs (integers), got {i!r}")
    # In the order given, in which they leave where nothing else decides.
    wanted = list(dict.fromkeys(int(i) for i in given))
    strangers = set(wanted).difference(known)
    if strangers:
        raise ValueError(f"{name} must be objects of this session, got {sorted(strangers)}")
    return wanted


def checked_id(object_id: int, known: Iterable[int]) -> int:
    """Return one ID.

    Parameters
    ----------
    object_id : int
    known : iterable of int
        The objects there are.

    Raises
    ------
    TypeError
        If it is no integer, such as a list of one.
    ValueError
        If it is not among the known.
    """
    if not is_integer(object_id):
        raise TypeError(f"object_id must be one object ID (an integer), got {object_id!r}")
    return checked_ids(object_id, known, "object_id")[0]


def checked_whole(value: int, name: str) -> int:
    """Return a whole number from 0.

    Parameters
    ----------
    value : int
    name : str
        Of the argument, for the message.

    Raises
    ------
    TypeError
        If it is not whole.
    ValueError
        If it is negative.
    """
    if not is_integer(value):
        raise TypeError(f"{name} must be a whole number, got {value!r}")
    if value < 0:
        raise ValueError(f"{name} must not be negative, got {value!r}")
    return int(value)


def checked_margin(margin: float) -> float:
    """Return a fraction of hue arcs that is left empty.

    Raises
    ------
    ValueError
        If it is outside [0, 1); TypeError if it is no number.
    """
    found = number(margin, "hue_margin")
    if not 0.0 <= found < 1.0:
        raise ValueError(f"hue_margin must be in [0, 1), got {margin!r}")
    return found


def checked_hues(hues: Mapping[int, float]) -> dict[int, float]:
    """Return hues by ID as plain numbers.

    Raises
    ------
    ValueError
        If one is no number in [0, 1).
    """
    for i, hue in hues.items():
        if not isinstance(hue, int | float | np.number) or not 0.0 <= hue < 1.0:
            raise ValueError(f"the hue of object {i} must be a number in [0, 1), got {hue!r}")
    return {int(i): float(hue) for i, hue in hues.items()}


def checked_rotation(rotation: ArrayLike) -> Matrix:
    """Return a (3, 3) rotation; a copy nobody can write to.

    Raises
    ------
    ValueError
        If it is another matrix: it enlarges, mirrors, is not finite, or is none.
    """
    try:
        turn = fixed(rotation)
    except (TypeError, ValueError):
        turn = np.empty(0)
    if turn.shape != (3, 3) or not is_rotation(turn):
        given = rotation.tolist() if isinstance(rotation, np.ndarray) else rotation
        raise ValueError(
            f"rotation must be a (3, 3) rotation, which neither enlarges nor mirrors, got {given!r}"
        )
    return turn


def checked_pose(pose: Pose) -> Pose:
    """Return a pose whose arrays nobody can write to.

    Raises
    ------
    TypeError
        If it is none.
    ValueError
        If its centre is not three finite numbers, its rotation no rotation, or its scale not
        positive.
    """
    checked_kind(pose, Pose, "pose")
    if np.shape(pose.center) != (3,) or not np.isfinite(pose.center).all():
        raise ValueError(
            "center of the pose must be three finite numbers of mm (towards, down, right), got "
            f"{np.asarray(pose.center).tolist()}"
        )
    if not 0.0 < number(pose.scale, "scale of the pose") < np.inf:
        raise ValueError(f"scale of the pose must be a positive number, got {pose.scale!r}")
    checked_rotation(pose.rotation)
    return pose.kept()


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


def checked_array(value: ArrayLike, shape: tuple[int, ...], name: str) -> NDArray[np.float64]:
    """Return finite numbers of a shape as a float64 array, a copy.

    Parameters
    ----------
    value : array_like
    shape : tuple of int
    name : str
        Of the argument, for the message.

    Raises
    ------
    ValueError
        If they are others.
    """
    try:
        found = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        found = np.empty(0)
    if found.shape != shape or not np.isfinite(found).all():
        size = " x ".join(map(str, shape))
        # In one line.
        given = value.tolist() if isinstance(value, np.ndarray) else value
        raise ValueError(f"{name} must be {size} finite numbers, got {given!r}")
    return found


def checked_style(style: ObjectStyle | None) -> ObjectStyle | None:
    """Return a style whose cut is a plane.

    Raises
    ------
    TypeError
        If it is no style.
    ValueError
        If the cut is not a point and a normal that is not 0.
    """
    if style is None:
        return None
    checked_kind(style, ObjectStyle, "style")
    if style.cut is None:
        return style
    point, normal = checked_array(style.cut, (2, 3), "cut of the style")
    if not 0.0 < np.linalg.norm(normal) < np.inf:
        raise ValueError(f"cut of the style must have a normal that is not 0, got {style.cut!r}")
    return replace(style, cut=(point, normal))


def checked_stretch(
    stretch: ArrayLike, name: str = "stretch", least: float = 0.0
) -> NDArray[np.float64]:
    """Return how the world is stretched; see `Camera.stretch`.

    Parameters
    ----------
    stretch : (3, 3) array_like of float
    name : str
        Of the argument, for the message.
    least : float
        What lengths shrink to is larger.

    Raises
    ------
    ValueError
        If it is not symmetric, definite and of determinant 1 or -1.
    """
    found = checked_array(stretch, (3, 3), name)
    # A mirroring affine has a negative determinant, and its stretch is negative definite.
    lengths = np.linalg.eigvalsh(found * np.sign(np.linalg.det(found)))
    same = np.allclose(found, found.T, atol=1e-6)
    if not same or lengths.min() <= least or abs(np.prod(lengths) - 1) > 1e-3:
        raise ValueError(
            f"{name} must be symmetric, definite and of determinant 1 or -1, got {found.tolist()}"
        )
    return found


def whole_numbers(values: object, count: int) -> tuple[int, ...] | None:
    """Return so many whole numbers as plain ones; None where they are anything else.

    Parameters
    ----------
    values : object
        5.0 is whole as well; True is none.
    count : int
    """
    found: list[Any] = list(values) if np.iterable(values) else []
    whole = [is_integer(n) or (isinstance(n, float) and n.is_integer()) for n in found]
    return tuple(int(n) for n in found) if len(found) == count and all(whole) else None


def checked_size(size: Sequence[int]) -> tuple[int, int]:
    """Return height and width of a window in pixels.

    Raises
    ------
    ValueError
        If they are not two whole numbers from 1 to `WIDEST`.
    """
    found = whole_numbers(size, 2)
    if found is None or not all(0 < n <= WIDEST for n in found):
        raise ValueError(
            "canvas_size must be height and width, two whole numbers of pixels from 1 to "
            f"{WIDEST}, got {size!r}"
        )
    return found[0], found[1]


def checked_planes(planes: ArrayLike | None) -> NDArray[np.float64]:
    """Return clipping planes as (N, 2, 3) float64, none for None; a copy nobody can write to.

    Raises
    ------
    ValueError
        As `rendering.validation.checked_planes`.
    """
    # Sessions share planes with scenes that workers draw.
    return fixed(validation.checked_planes(planes))
