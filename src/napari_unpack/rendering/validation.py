"""Checks of the public functions' arguments, and their conversion to what kernels take."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.axes import is_integer
from napari_unpack.geometry.masks import unmasked
from napari_unpack.geometry.relabeling import compact_labels
from napari_unpack.geometry.view import View
from napari_unpack.memory import PICTURE_BYTES, check_picture

# As many IDs as uint16 labels tell apart, the background among them.
MOST_IDS = 65_536
# Differences of such densities, and differences of those, are still float32 numbers.
MOST_DENSITY = 1e37
# Clipping planes that both backends take; the twin of shaders/lib/clip_planes.glsl.
MOST_PLANES = 8


@dataclass(frozen=True, eq=False)
class Labels:
    """A label volume fit for the kernels, and the way back to the IDs it was given with.

    Parameters
    ----------
    array : (Z, Y, X) ndarray of uint16
        C-contiguous.
    size : int
        One more than the largest label in `array`: the length of tables by ID.
    names : (size,) ndarray of int64, optional
        The given ID of every label; None where they are the same.
    """

    array: NDArray[np.uint16]
    size: int
    names: NDArray[np.int64] | None = None

    def row(self, object_id: int) -> int | None:
        """Return the label a given ID has in `array`, None where the volume lacks it."""
        if self.names is None:
            return object_id if 0 <= object_id < self.size else None
        at = int(np.searchsorted(self.names, object_id))
        return at if at < self.size and self.names[at] == object_id else None

    def name(self, label: int) -> int:
        """Return the given ID of a label in `array`."""
        return label if self.names is None else int(self.names[label])

    def visible(self, hidden: Iterable[int]) -> NDArray[np.bool_]:
        """Return the (size,) table of what is visible to the ID passes."""
        table = np.ones(self.size, np.bool_)
        table[0] = False
        for label in map(self.row, checked_ids(hidden, "hidden")):
            if label is not None:
                table[label] = False
        return table

    def tints(
        self, tints: Mapping[int, Sequence[float]] | None, hidden: Iterable[int]
    ) -> NDArray[np.float32]:
        """Return the (size, 4) float32 table of tints; white where none is given.

        Parameters
        ----------
        tints : mapping of int to (r, g, b) or (r, g, b, a), optional
            Straight, by given ID.
        hidden : iterable of int
            Given IDs.

        Raises
        ------
        TypeError
            If an ID is no integer.
        ValueError
            If a tint is not three or four numbers from 0 to 1.
        """
        table = np.ones((self.size, 4), np.float32)
        given = tints or {}
        for object_id, tint in zip(checked_ids(given, "tints"), given.values(), strict=True):
            try:
                colour = np.asarray(tint, dtype=np.float32)
            except (TypeError, ValueError):
                colour = np.zeros(0, np.float32)
            if colour.shape not in ((3,), (4,)) or not ((colour >= 0) & (colour <= 1)).all():
                raise ValueError(
                    f"tints must be three or four numbers from 0 to 1, got {tint!r} "
                    f"for object {object_id}"
                )
            label = self.row(object_id)
            if label is not None:
                table[label, : len(colour)] = colour
        for label in map(self.row, checked_ids(hidden, "hidden")):
            if label is not None:
                table[label] = 0
        return table


def checked_labels(labels: ArrayLike) -> Labels:
    """Check a (Z, Y, X) label volume and make it fit for the kernels.

    Memory is shared with the argument where that is uint16 and C-contiguous.

    Raises
    ------
    TypeError
        If the labels are not integers.
    ValueError
        If they are not 3D, empty, negative, above int64, or hold more than 65,535 objects.
    """
    array = unmasked(labels, 0)
    if array.dtype != np.bool_ and not np.issubdtype(array.dtype, np.integer):
        raise TypeError(f"labels must be integers (object IDs), got {array.dtype}; convert them")
    _check_shape(array, "labels")
    # Read as unsigned, a negative number is larger than all others: one look tells both.
    unsigned = array.dtype.str.replace("i", "u")
    top = int(array.view(unsigned).max())
    if array.dtype.kind == "i" and top > np.iinfo(array.dtype).max:
        raise ValueError(f"labels must not be negative, got {array.min()}")
    # Below that no renumbering is needed, and no copy where the type fits.
    if top < MOST_IDS:
        return Labels(np.ascontiguousarray(array, dtype=np.uint16), top + 1)
    if top > np.iinfo(np.int64).max:
        raise ValueError(f"labels must be below 2**63, got {top}; renumber them")
    # IDs above the kernels' range are numbered anew, and named again in every result.
    fitting, names = compact_labels(array)
    return Labels(fitting, len(names), names)


def checked_volume(
    volume: ArrayLike, shape: tuple[int, ...] | None = None
) -> NDArray[np.uint16] | NDArray[np.float32]:
    """Check a density volume and make it fit for the kernels.

    Parameters
    ----------
    volume : (Z, Y, X) array_like of real numbers
        Density. NaN counts as the lowest density, as infinities do as the extremes, and what is
        beyond MOST_DENSITY as that.
    shape : tuple of int, optional
        The shape it must have.

    Returns
    -------
    (Z, Y, X) ndarray of uint16 or float32
        uint16 if it was uint8 or uint16, else float32. C-contiguous; shares memory if it can.

    Raises
    ------
    TypeError
        If the volume does not hold real numbers.
    ValueError
        If it is not 3D, empty, of another shape, or holds no finite number.
    """
    array = unmasked(volume, np.nan)
    if array.dtype.kind not in "biuf":
        raise TypeError(f"volume must hold real numbers, got {array.dtype}")
    _check_shape(array, "volume")
    if shape is not None and array.shape != shape:
        raise ValueError(f"volume and labels must have one shape, got {array.shape} and {shape}")
    if array.dtype in (np.bool_, np.uint8, np.uint16):
        return np.ascontiguousarray(array, dtype=np.uint16)
    with np.errstate(over="ignore"):
        density = np.ascontiguousarray(array, dtype=np.float32)
    # The usual volume is taken as it is; a NaN fails both comparisons.
    with np.errstate(invalid="ignore"):
        if density.min() >= -MOST_DENSITY and density.max() <= MOST_DENSITY:
            return density
    # Of the array itself: what is finite there may be too much for single precision.
    finite = np.isfinite(array)
    if not finite.any():
        raise ValueError("volume must hold finite numbers, got none")
    extremes = np.array([array[finite].min(), array[finite].max()], np.float64)
    low, high = np.clip(extremes, -MOST_DENSITY, MOST_DENSITY).tolist()
    # Kernels would spread NaN over every sample that touches it.
    known = np.nan_to_num(density, nan=low, posinf=high, neginf=low)
    return np.clip(known, -MOST_DENSITY, MOST_DENSITY, out=known)


def checked_view(view: View | None) -> View:
    """Check a view, the default one for None; raise TypeError otherwise.

    Raises
    ------
    TypeError
        If it is no View.
    """
    if view is None:
        return View()
    if not isinstance(view, View):
        raise TypeError(f"view must be a View, such as View(direction=(0, 0, 1)), got {view!r}")
    return view


def checked_size(size: Sequence[int], bytes_a_pixel: float = PICTURE_BYTES) -> tuple[int, int]:
    """Check an image size: (height, width) of at least one pixel; raise ValueError otherwise.

    Parameters
    ----------
    size : sequence of int
    bytes_a_pixel : float
        Of all that is held at once.

    Raises
    ------
    ValueError
        If it is not two positive whole numbers, or does not fit into memory.
    """
    if np.shape(size) != (2,) or any(not 1 <= n < np.inf or int(n) != n for n in size):
        raise ValueError(f"size must be two positive integers (height, width), got {size!r}")
    height, width = int(size[0]), int(size[1])
    check_picture((height, width), bytes_a_pixel)
    return height, width


def checked_planes(planes: ArrayLike | None) -> NDArray[np.float64]:
    """Check clipping planes: (N, 2, 3), none for None.

    Parameters
    ----------
    planes : (N, 2, 3) array_like, optional
        Planes (point, normal), voxels.

    Raises
    ------
    ValueError
        If the shape is another, there are more than 8, or one lies nowhere or faces nowhere.
    """
    array = np.asarray([] if planes is None else planes, dtype=np.float64)
    if array.size == 0:
        array = array.reshape(0, 2, 3)
    if array.ndim != 3 or array.shape[1:] != (2, 3) or len(array) > MOST_PLANES:
        raise ValueError(
            f"clipping must be (N, 2, 3) with N up to {MOST_PLANES}, a point and a normal a plane "
            f"in voxels z y x, got shape {array.shape}"
        )
    if not np.isfinite(array).all() or not array[:, 1].any(axis=1).all():
        raise ValueError("clipping must hold finite points and normals that are not zero")
    return array


def checked_ids(ids: Iterable[int], name: str) -> list[int]:
    """Check object IDs such as `hidden`; raise TypeError unless they are integers.

    Parameters
    ----------
    ids : iterable of int
    name : str
        Of the argument, for the message.

    Raises
    ------
    TypeError
        If they are not a collection of integers.
    """
    if isinstance(ids, (str, bytes)) or not isinstance(ids, Iterable):
        raise TypeError(f"{name} must be a collection of object IDs, got {ids!r}")
    out = list(ids)
    for object_id in out:
        if not is_integer(object_id):
            raise TypeError(f"{name} must hold object IDs (integers), got {object_id!r}")
    return [int(i) for i in out]


def _check_shape(array: NDArray[np.generic], name: str) -> None:
    if array.ndim != 3:
        raise ValueError(
            f"{name} must be 3D (Z, Y, X), got {array.ndim}D of shape {array.shape}; "
            "take one time point or channel of it"
        )
    if array.size == 0:
        raise ValueError(f"{name} must not be empty, got shape {array.shape}")
