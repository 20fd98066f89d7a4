"""Checks of what segmentation is given, with a sentence that says what is wrong."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry import axes
from napari_unpack.geometry.masks import unmasked

Spacing = tuple[float, float, float]


def proportions(spacing: Spacing) -> Spacing:
    """Return voxel edges in edges of a cube of the same volume."""
    z, y, x = (np.array(spacing) / np.cbrt(np.prod(spacing))).tolist()
    return z, y, x


def checked_volume(volume: ArrayLike) -> NDArray[np.generic]:
    """Return a density volume, NaN and infinities meaning "nothing measured", or say what is wrong.

    Not copied but from types that numba does not know; see `block_dtype`.

    Raises
    ------
    TypeError
        If the values are not real numbers.
    ValueError
        If it is not 3D, is empty, constant, or has no finite value.
    """
    array = np.asarray(volume)
    checked_form(array.shape, array.dtype)
    array = array.astype(block_dtype(array.dtype), copy=False)
    low, high = _finite_range(array)
    if not low < high:
        raise constant_volume(low)
    return array


def constant_volume(value: float) -> ValueError:
    """Return the error of a volume that is the same everywhere."""
    # -0 is 0.
    return ValueError(
        f"volume is constant ({value + 0.0:g} everywhere): there is nothing to tell apart in it"
    )


def checked_form(shape: tuple[int, ...], dtype: np.dtype[Any]) -> tuple[int, int, int]:
    """Return the shape of a density volume, or say what is wrong with it or its type.

    Parameters
    ----------
    shape : tuple of int
    dtype : numpy.dtype

    Raises
    ------
    TypeError
        If the values are not real numbers.
    ValueError
        If it is not 3D, or empty.
    """
    if len(shape) != 3:
        raise ValueError(f"volume must have 3 axes (z, y, x), got shape {shape}")
    if 0 in shape:
        raise ValueError(f"volume must not be empty, got shape {shape}")
    if dtype.kind not in "buif":
        raise TypeError(f"volume must hold real numbers, got dtype {dtype}")
    return shape[0], shape[1], shape[2]


def block_dtype(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """Return the type that numba works on for an array's type: no bool, float16 or long double."""
    if dtype.kind == "b":
        return np.dtype(np.uint8)
    # numba knows neither; float32 holds all of float16, float64 most of long double.
    if dtype.kind == "f" and dtype.itemsize not in (4, 8):
        return np.dtype(np.float32 if dtype.itemsize < 4 else np.float64)
    return dtype.newbyteorder("=")


def without_infinities(values: NDArray[Any]) -> NDArray[Any]:
    """Return densities with NaN for infinities, which say as well that nothing was measured.

    Parameters
    ----------
    values : (Z, Y, X) ndarray
        Copied only where there are some.
    """
    if values.dtype.kind != "f" or not any(np.isinf(plane).any() for plane in values):
        return values
    return np.where(np.isinf(values), values.dtype.type(np.nan), values)


_LOWEST_AIR = -1100.0
"""CT numbers below are no air's: the background of noise-free volumes lies above, or at 0."""

_LEAST_GAP = 0.2
"""Of the smallest value, by which the others lie above it where it says that nothing was measured:
streaks and noise reach down to their smallest value without a gap."""

_FEW = 0.0005
"""Of all voxels, that may be broken."""

_MOST_UNEVEN = 0.01
"""Of the voxels of padding, in columns that are not of it from end to end."""


def padding_of(values: NDArray[Any]) -> float | None:
    """Return the smallest value where it stands for "nothing measured", as outside a round slice.

    It does where it is below the CT number of air and far from all others, as -2000 and -32768
    are, and is no background of things cut out: it has few voxels, or goes through the volume from
    end to end as what is outside a scanner's circle does.

    Parameters
    ----------
    values : (Z, Y, X) ndarray
        Without infinities.
    """
    if values.dtype.kind != "f" and values.dtype.kind != "i":
        return None
    low = min((float(np.nanmin(p)) for p in values if not np.isnan(p).all()), default=0.0)
    if not low < _LOWEST_AIR:
        return None
    least, most = np.inf, -np.inf
    # How many voxels of it there are along every line of voxels, by axis.
    lines: list[Any] = [np.zeros(values.shape[1:], np.int64), [], []]
    for plane in values:
        above, padded = plane[plane > low], plane == low
        if len(above):
            least, most = min(least, float(above.min())), max(most, float(above.max()))
        lines[0] += padded
        for axis in (0, 1):
            lines[axis + 1].append(np.count_nonzero(padded, axis=axis))
    # Of two values the smaller is the background.
    if not least < most or not least / 2 - low / 2 > _LEAST_GAP * -low / 2:
        return None
    number = int(lines[0].sum())
    uneven = min(
        np.where(np.array(counts) < length, counts, 0).sum()
        for counts, length in zip(lines, values.shape, strict=True)
    )
    return low if number <= _FEW * values.size or uneven <= _MOST_UNEVEN * number else None


def without_padding(values: NDArray[Any], padding: float | None) -> NDArray[Any]:
    """Return densities with NaN for what `padding_of` has found, as floats where it has.

    Parameters
    ----------
    values : (Z, Y, X) ndarray
    padding : float or None
    """
    if padding is None:
        return values
    floats = values.astype(unpadded_dtype(values.dtype))
    floats[values == padding] = np.nan
    return floats


def unpadded_dtype(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """Return the type of densities of which some become NaN.

    Parameters
    ----------
    dtype : numpy.dtype
        A number's; integers of 16 bits fit float32.
    """
    if dtype.kind == "f":
        return dtype
    return np.dtype(np.float32 if dtype.itemsize < 4 else np.float64)


def _finite_range(array: NDArray[np.generic]) -> tuple[float, float]:
    """Return the smallest and largest finite value of an array."""
    if array.dtype.kind != "f":
        return float(array.min()), float(array.max())
    low, high = np.inf, -np.inf
    # Plane by plane: a mask of the whole volume would need as much memory again.
    for plane in array:
        finite = plane[np.isfinite(plane)]
        if finite.size:
            low, high = min(low, float(finite.min())), max(high, float(finite.max()))
    if low > high:
        raise ValueError("volume has no finite value: all of it is NaN or infinite")
    return low, high


# Sums of squares of a volume's values stay exact to a millionth in float32 below the second; below
# the first, noise comes near the millionths that keep divisors from 0.
_SPANS = (0.5, 1e12)

_LARGEST_SPAN_SHARE = 1e4
"""How far from zero values may lie, in their own range: float32 tells 2^24 of them apart."""

_SPAN = 4096.0
"""What the range of odd values is brought to: that of CT numbers from air to metal."""


def in_common_range(
    density: NDArray[np.generic], level: str | float = 0.0
) -> tuple[NDArray[np.generic], str | float]:
    """Return densities that float32 can work with, and a density given beside them.

    What is found depends neither on the scale nor on the offset of values. Only where they are
    very large, very small or far from zero is a copy made.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
    level : str or float
        A number is moved with the values; a name stays.
    """
    low, high = _finite_range(density)
    # Halves: the span of the whole range of float64 is no float64.
    span = high / 2 - low / 2
    far = max(abs(low), abs(high)) / 2 > _LARGEST_SPAN_SHARE * span
    if not span or (_SPANS[0] < 2 * span < _SPANS[1] and not far):
        return density, level

    def moved(values: Any) -> Any:
        # By halves for the same reason.
        return (values / 2 - low / 2) / span * _SPAN

    scaled = np.empty(density.shape, np.float32)
    for plane, given in zip(scaled, density, strict=True):
        plane[...] = moved(given.astype(np.float64))
    return scaled, level if isinstance(level, str) else float(moved(level))


def check_out(out: Any, volume: Any, shape: tuple[int, int, int]) -> None:
    """Refuse an array that labels cannot be written to.

    Parameters
    ----------
    out : array
    volume : array
    shape : (int, int, int)
        Of the volume.

    Raises
    ------
    TypeError
        If it does not hold integers of 16 bits at least, or cannot be written to.
    ValueError
        If its shape is not the volume's, or it is the volume.
    """
    dtype = np.dtype(getattr(out, "dtype", object))
    if not hasattr(out, "__setitem__") or dtype.kind not in "ui" or dtype.itemsize < 2:
        raise TypeError(
            f"out must be an array of integers of 16 bits or more that can be written to, got "
            f"{type(out).__name__} of {dtype}"
        )
    locked = isinstance(out, np.ndarray) and not out.flags.writeable
    # A Zarr array says so itself.
    if locked or getattr(out, "read_only", False):
        raise TypeError("out must be an array that can be written to, got a read-only one")
    if tuple(out.shape) != shape:
        raise ValueError(f"out must have the volume's shape {shape}, got {tuple(out.shape)}")
    arrays = isinstance(out, np.ndarray) and isinstance(volume, np.ndarray)
    # A dask array reads from what it was made of.
    read = [_place_of(one) for one in (volume, *dict(getattr(volume, "dask", {})).values())]
    # Objects are measured after labels are written.
    if _place_of(out) in read or (arrays and np.may_share_memory(out, volume)):
        raise ValueError("out must be another array than the volume, which it would overwrite")


def check_room(out: Any, top: int) -> None:
    """Refuse an array whose type cannot hold so many objects.

    Parameters
    ----------
    out : array of int
    top : int
        The largest label.

    Raises
    ------
    ValueError
        If it is above what the type holds.
    """
    if top > np.iinfo(out.dtype).max:
        raise ValueError(f"out of {out.dtype} cannot hold {top} objects; pass one of int32")


def _place_of(array: Any) -> Any:
    """Return where values lie: the file of a memory map, the store and path of a Zarr array."""
    store, path, base = getattr(array, "store", None), getattr(array, "path", ""), array
    if store is not None:
        # Of a folder, or of a folder that dask has opened.
        root = getattr(store, "root", None) or getattr(store, "path", None)
        return (id(store), path) if root is None else os.path.realpath(os.path.join(root, path))
    while base is not None and getattr(base, "filename", None) is None:
        base = getattr(base, "base", None)
    return id(array) if base is None else os.path.realpath(base.filename)


def checked_labels(labels: ArrayLike, name: str) -> NDArray[np.integer]:
    """Return a label volume as an integer array.

    Parameters
    ----------
    labels : (Z, Y, X) array_like of int
    name : str
        Of the argument, for messages.

    Raises
    ------
    TypeError
        If it does not hold integers.
    ValueError
        If it is not 3D, is empty, or holds a negative label or one above int64.
    """
    array = unmasked(labels, 0)
    if array.dtype.kind == "b":
        # A mask is one object; as integers of the same memory.
        array = array.view(np.uint8)
    if array.dtype.kind not in "ui":
        raise TypeError(f"{name} must hold integers, got dtype {array.dtype}")
    if array.ndim != 3 or array.size == 0:
        raise ValueError(f"{name} must have 3 axes (z, y, x) and voxels, got shape {array.shape}")
    if array.min() < 0:
        raise ValueError(f"{name} must not hold negative labels, got {array.min()}")
    # Tables of IDs are int64.
    if array.max() > np.iinfo(np.int64).max:
        raise ValueError(f"{name} must be below 2**63, got {array.max()}; renumber them")
    return array


def check_smallest(smallest: float | None) -> None:
    """Check the size below which nothing is an object; None stands for the default.

    Raises
    ------
    ValueError
        If it is negative, infinite or NaN.
    TypeError
        If it is no number.
    """
    if smallest is not None and not 0 <= axes.number(smallest, "smallest") < np.inf:
        raise ValueError(f"smallest must be a volume in mm^3 of 0 or more, got {smallest!r}")
