"""OME-Zarr (NGFF 0.4 and 0.5) and bare Zarr arrays."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from napari_unpack.atomic import holds_only
from napari_unpack.file_sizes import TooLargeError, check_size, stored_size
from napari_unpack.geometry.axes import Matrix, voxel_size
from napari_unpack.geometry.coarser_labels import halved
from napari_unpack.geometry.transforms import checked_place
from napari_unpack.io.file_data import (
    LABELS_LEFT_OUT,
    NO_UNIT,
    NO_VOXEL_SIZE,
    SPACE,
    FileData,
    axis_name,
    in_millimetres,
)
from napari_unpack.io.optional import needed
from napari_unpack.io.scan import (
    Spacing,
    checked_label_array,
    checked_volume_array,
)

CHUNK = 64
"""Voxels along an axis of a block: labels of it deflate to a few kB."""

SMALLEST_LEVEL = 128
"""Voxels along the longest axis: a level below that shows nothing of a bag."""

MOST_NAMED = 4
"""Images of a folder in a message."""


def read_zarr(path: Path, large: bool = False) -> FileData:
    """Read the finest level of a multiscale image, and its first label image if it has one.

    Labels of another shape than the volume's are left out, which is told.

    Parameters
    ----------
    path, large
        As for `load_volume`.

    Raises
    ------
    ValueError, ImportError
        As for `load_volume`.
    """
    node, said = _image(path)
    if not hasattr(node, "keys"):
        array = checked_volume_array(_voxels(node, path, large), path)
        return FileData(array, assumed=(NO_VOXEL_SIZE,))
    found = _finest(node, path, large)
    found = replace(found, assumed=said + found.assumed)
    labels = _labels(node, path, large)
    assert found.volume is not None, "it was read"
    lengths = dict(zip(found.axes, found.volume.shape, strict=True))
    # Labels of a coarser level, or of other time points, cannot be laid over the volume.
    if labels is not None:
        axes = SPACE if labels.ndim == len(SPACE) else f"t{SPACE}"
        if labels.shape != tuple(lengths.get(axis) for axis in axes):
            return _without_labels(found)
    return replace(found, labels=labels)


def _without_labels(found: FileData) -> FileData:
    return replace(found, assumed=(*found.assumed, LABELS_LEFT_OUT), is_density=True)


@dataclass(frozen=True, eq=False)
class StoredLevels:
    """A multiscale image that is not read.

    Parameters
    ----------
    described : FileData
        What is said of it; it holds no volume.
    image, labels : list of dask array
        Their levels, the finest first; empty where there are none. Of a label image labels alone.
    """

    described: FileData
    image: list[Any]
    labels: list[Any]


def stored_levels(path: Path) -> StoredLevels | None:
    """Return the levels of a multiscale image whose last axes are z, y, x; None of anything else.

    Parameters
    ----------
    path : Path

    Raises
    ------
    ValueError
        If it is not a Zarr image.
    ImportError
        If zarr or dask is missing.
    """
    node, said = _image(path)
    if not hasattr(node, "keys"):
        return None
    _, described = _described(node, path)
    described = replace(described, assumed=said + described.assumed)
    image = _levels(node)
    if len(image) < 2 or not described.axes.endswith(SPACE):
        return None
    if _says_labels(node) and holds_ids(image[0]):
        return StoredLevels(described, [], image)
    names = list(_label_names(node))
    labels = _levels(node["labels"][names[0]]) if names else []
    finest = image[0].shape[-len(SPACE) :]
    if labels and labels[0].shape != finest:
        return StoredLevels(_without_labels(described), image, [])
    return StoredLevels(described, image, labels if labels and holds_ids(labels[0]) else [])


def _levels(node: Any) -> list[Any]:
    dask = needed("dask.array", "reading a volume larger than the memory")
    scales = _attributes(node).get("multiscales") or [{"datasets": []}]
    return [dask.from_zarr(node[level["path"]]) for level in scales[0]["datasets"]]


def write_labels_zarr(
    path: Path, labels: NDArray[Any], spacing: Spacing, place: Matrix | None = None
) -> None:
    """Write labels as a multiscale OME-Zarr label image (NGFF 0.4), which `load_labels` reads.

    Parameters
    ----------
    path : Path
        A new folder.
    labels : (Z, Y, X) ndarray of int
    spacing : (float, float, float) of mm, z y x
    place : (4, 4) ndarray of float64, optional
        See `labels_zarr`.

    Raises
    ------
    ImportError
        If zarr is missing.
    """
    with labels_zarr(path, labels.shape, labels.dtype, spacing, place) as finest:
        finest[...] = labels


def new_label_array(path: Path, shape: tuple[int, ...], dtype: DTypeLike) -> Any:
    """Return a new Zarr array of zeros for labels of any size, alone in its folder.

    Parameters
    ----------
    path : Path
        A new folder.
    shape : (int, int, int)
    dtype : dtype of int

    Raises
    ------
    ImportError
        If zarr is missing.
    """
    zarr = needed("zarr", "labels larger than the memory")
    return zarr.create_array(str(path), shape=shape, dtype=dtype, chunks=_chunks(shape))


@contextmanager
def labels_zarr(
    path: Path,
    shape: tuple[int, ...],
    dtype: DTypeLike,
    spacing: Spacing,
    place: Matrix | None = None,
) -> Iterator[Any]:
    """Give an array for labels of any size; it becomes the finest level of a label image.

    Parameters
    ----------
    path : Path
        A new folder.
    shape : (int, int, int)
    dtype : dtype of int
    spacing : (float, float, float) of mm, z y x
    place : (4, 4) ndarray of float64, optional
        From the scan to the scanner, see `FileData`; kept where the scan is moved alone, as the
        format has no turns.

    Yields
    ------
    array
        Of Zarr, all 0, for any part to be written.

    Raises
    ------
    ImportError
        If zarr is missing.
    """
    zarr = needed("zarr", "writing OME-Zarr")
    node, origin = zarr.open_group(str(path), mode="w", zarr_format=2), _origin(place)
    factors = [1, 1, 1]
    datasets = [_level(0, factors, spacing, origin)]
    fine = _new_level(node, 0, shape, dtype)
    yield fine
    while max(fine.shape) >= 2 * SMALLEST_LEVEL:
        number = len(datasets)
        coarse = _new_level(node, number, tuple(-(-n // 2) for n in fine.shape), dtype)
        # Chunk by chunk, as labels may be larger than the memory.
        for corner in product(*(range(0, n, CHUNK) for n in coarse.shape)):
            here = tuple(slice(n, n + CHUNK) for n in corner)
            there = tuple(slice(2 * n, 2 * (n + CHUNK)) for n in corner)
            coarse[here] = halved(np.asarray(fine[there]))
        # A single voxel stays what it is.
        factors = [f * (2 if n > 1 else 1) for f, n in zip(factors, fine.shape, strict=True)]
        datasets.append(_level(number, factors, spacing, origin))
        fine = coarse
    axes = [{"name": axis, "type": "space", "unit": "millimeter"} for axis in SPACE]
    # Last: without them it is no image.
    node.attrs["multiscales"] = [{"version": "0.4", "axes": axes, "datasets": datasets}]
    node.attrs["image-label"] = {"version": "0.4"}


def _new_level(node: Any, number: int, shape: tuple[int, ...], dtype: DTypeLike) -> Any:
    return node.create_array(str(number), shape=shape, dtype=dtype, chunks=_chunks(shape))


def _chunks(shape: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(min(n, CHUNK) for n in shape)


def _level(
    number: int, factors: list[int], spacing: Spacing, origin: list[float] | None
) -> dict[str, Any]:
    sides = [mm * factor for mm, factor in zip(spacing, factors, strict=True)]
    steps = [{"type": "scale", "scale": sides}]
    if origin is not None or number:
        # A voxel is the middle of those that it stands for.
        moves = [(side - mm) / 2 for side, mm in zip(sides, spacing, strict=True)]
        first = [mm + move for mm, move in zip(origin or [0.0] * 3, moves, strict=True)]
        steps.append({"type": "translation", "translation": first})
    return {"path": str(number), "coordinateTransformations": steps}


def _origin(place: Matrix | None) -> list[float] | None:
    """Return where a scan begins, mm z y x, None where it is turned or nobody knows."""
    if place is None or not np.allclose(place[:3, :3], np.eye(3)[::-1]):
        return None
    return [float(mm) for mm in place[2::-1, 3]]


def stored_volume(path: Path) -> tuple[Any, FileData]:
    """Return the finest level of a multiscale image with the axes z, y, x, which is not read.

    Other axes are left out where they are 1 long. With it what is said of it: data without a
    volume.

    Parameters
    ----------
    path : Path

    Raises
    ------
    ValueError
        If it is not a Zarr image of one volume.
    ImportError
        If zarr is missing.
    """
    node, said = _image(path)
    if not hasattr(node, "keys"):
        array, found = node, FileData(None, assumed=(NO_VOXEL_SIZE,))
    else:
        array, found = _described(node, path)
        found = replace(found, assumed=said + found.assumed)
    if array.ndim == len(found.axes):
        lengths = dict(zip(found.axes, array.shape, strict=True))
        if long := {axis: n for axis, n in lengths.items() if axis not in SPACE and n > 1}:
            (axis, count), *_ = long.items()
            raise ValueError(
                f"{path} holds {count} {axis_name(axis)}s: save one of them as a Zarr volume, or "
                f"choose one with --at {axis}=0 and write .npz"
            )
        if len(lengths) > len(SPACE):
            dask = needed("dask.array", "an image of more axes than z, y, x")
            first = tuple(slice(None) if axis in SPACE else 0 for axis in lengths)
            array = dask.from_zarr(array)[first]
            found = replace(found, axes="".join(axis for axis in lengths if axis in SPACE))
    if found.axes != SPACE or array.ndim != len(SPACE):
        raise ValueError(
            f"{path} must hold one volume with axes z, y, x, got {found.axes} and {array.ndim} axes"
        )
    return array, found


def is_label_image(path: Path) -> bool:
    """Tell whether a folder says of itself that it is a label image, as `labels_zarr` writes one.

    Any other Zarr may be a scan, and the only copy of it.
    """
    try:
        return _says_labels(_opened(path))
    except ValueError:
        return False


def is_label_image_alone(path: Path) -> bool:
    """Tell whether a folder is a label image and holds nothing beside its levels."""
    if not is_label_image(path):
        return False
    scales = _attributes(_opened(path)).get("multiscales") or []
    levels = {level["path"] for scale in scales for level in scale["datasets"]}
    about = re.compile(r"\.z[a-z]+|zarr\.json")
    return holds_only(path, lambda name: name in levels or bool(about.fullmatch(name)))


def holds_ids(array: Any) -> bool:
    """Tell whether an array's numbers can be IDs: whole numbers, or true and false."""
    return array.dtype.kind in "iub"


def _says_labels(node: Any) -> bool:
    return "image-label" in _attributes(node)


def _opened(path: Path) -> Any:
    zarr = needed("zarr", "reading OME-Zarr")
    try:
        return zarr.open(str(path), mode="r")
    except Exception as error:
        # zarr raises many kinds of its own, which moved between its releases.
        raise ValueError(f"{path} is not a readable Zarr image: {error}") from error


def _image(path: Path) -> tuple[Any, tuple[str, ...]]:
    """Return the array or the image of a folder, and a sentence where it is one of several.

    bioformats2raw, and what converts by it, numbers the images of a file in one folder.
    """
    node = _opened(path)
    if not hasattr(node, "keys") or "multiscales" in _attributes(node):
        return node, ()
    groups = dict(node.groups())
    images = [name for name, group in groups.items() if "multiscales" in _attributes(group)]
    images.sort(key=lambda name: (len(name), name))
    if len(images) == 1 or (images and "bioformats2raw.layout" in _attributes(node)):
        several = f"it holds {len(images)} images: {images[0]!r} was taken"
        return groups[images[0]], (several,) if len(images) > 1 else ()
    there = [path.name + "/" + name for name in (*images, *sorted(dict(node.arrays())))]
    which = f"; open {' or '.join(there[:MOST_NAMED])}" if there else ""
    raise ValueError(f"{path} holds no OME-Zarr image ('multiscales' is missing){which}")


def _attributes(node: Any) -> dict[str, Any]:
    attributes = dict(node.attrs)
    # 0.5 moved all under "ome"; 0.4 has it at the top.
    inner: dict[str, Any] = attributes.get("ome", attributes)
    return inner


def _voxels(array: Any, path: Path, large: bool) -> NDArray[Any]:
    # A whole block is unpacked even where the array takes only a corner of it.
    block = getattr(array, "shards", None) or array.chunks
    voxels = max(math.prod(array.shape), math.prod(block))
    check_size(path, voxels * np.dtype(array.dtype).itemsize, stored_size(path), large=large)
    return np.asarray(array[...])


def _finest(node: Any, path: Path, large: bool) -> FileData:
    array, found = _described(node, path)
    try:
        voxels = _voxels(array, path, large)
    except TooLargeError:
        raise
    except (KeyError, OSError, ValueError, RuntimeError) as error:
        raise ValueError(f"the finest level of {path} cannot be read: {error}") from error
    return replace(found, volume=voxels)


def _described(node: Any, path: Path) -> tuple[Any, FileData]:
    """Return the finest level's array, and what is said of it: data without a volume."""
    scales = _attributes(node).get("multiscales")
    if not scales:
        raise ValueError(f"{path} holds no OME-Zarr image ('multiscales' is missing)")
    # The standard sorts them from fine to coarse.
    level = scales[0]["datasets"][0]
    try:
        array = node[level["path"]]
    except (KeyError, OSError, ValueError, RuntimeError) as error:
        raise ValueError(f"the finest level of {path} cannot be read: {error}") from error
    axes = _axes(scales[0], array.ndim, path)
    factors, moves, said = np.ones(array.ndim), np.zeros(array.ndim), set()
    # Both the level and the whole image may scale and move, one after the other.
    for step in (
        *level.get("coordinateTransformations", []),
        *scales[0].get("coordinateTransformations", []),
    ):
        said.add(kind := step.get("type"))
        if kind == "scale":
            by = np.asarray(step["scale"], dtype=float)
            factors, moves = factors * by, moves * by
        elif kind == "translation":
            moves = moves + np.asarray(step["translation"], dtype=float)
    assumed = [] if "scale" in said else [NO_VOXEL_SIZE]
    sides, origin = dict.fromkeys(SPACE, 1.0), dict.fromkeys(SPACE, 0.0)
    for axis, factor, move in zip(axes, factors, moves, strict=True):
        if axis["name"] in SPACE:
            if axis.get("unit") is None and "scale" in said and NO_UNIT not in assumed:
                assumed.append(NO_UNIT)
            unit = in_millimetres(axis.get("unit"), "mm", assumed)
            sides[axis["name"]], origin[axis["name"]] = float(factor) * unit, float(move) * unit
    letters = "".join(axis["name"] for axis in axes)
    spacing = voxel_size([sides[axis] for axis in SPACE], path)
    place = None
    if "translation" in said:
        # The format names no side of a body: x, y and z are those of the scanner, as in ITK.
        place = np.eye(4)
        place[:3, :3], place[:3, 3] = np.eye(3)[::-1], [origin[axis] for axis in "xyz"]
    said_of = FileData(None, letters, spacing, None, tuple(assumed), checked_place(place, path))
    return array, said_of


def _axes(scale: dict[str, Any], count: int, path: Path) -> list[dict[str, str]]:
    # Version 0.3 has bare names, those before none: time, channel, z, y, x then, from the end.
    named = [a if isinstance(a, dict) else {"name": a} for a in scale.get("axes", [])]
    named = named or [{"name": axis} for axis in "tczyx"[-count:]]
    letters = [axis["name"] for axis in named]
    if len(named) != count or len(set(letters)) != count or any(len(a) != 1 for a in letters):
        raise ValueError(f"{path} must name its {count} axes by one letter each, got {letters}")
    return named


def _labels(node: Any, path: Path, large: bool) -> NDArray[Any] | None:
    names = _label_names(node)
    if not names:
        return None
    found = _finest(node["labels"][names[0]], path, large)
    assert found.volume is not None, "it was read"
    # Labels have no channels.
    first = {a: 0 for a in found.axes if a not in SPACE}
    moments = dict(zip(found.axes, found.volume.shape, strict=True)).get("t", 1)
    each = [found.one_volume(first | ({"t": t} if t else {}), path).volume for t in range(moments)]
    labels = [checked_label_array(one, f"the labels of {path}") for one in each if one is not None]
    return labels[0] if moments == 1 else np.stack(labels)


def _label_names(node: Any) -> list[str]:
    if "labels" not in node:
        return []
    group = node["labels"]
    return _attributes(group).get("labels") or list(group.keys())
