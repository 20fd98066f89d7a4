"""OME-Zarr (NGFF 0.4 and 0.5) and bare Zarr arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.io.optional import needed
from napari_unpack.io.scan import (
    Spacing,
    checked_label_array,
    checked_spacing,
    checked_volume_array,
)

# To mm. A unit that is not here, or none, counts as mm.
_MM = {"micrometer": 1e-3, "millimeter": 1.0, "centimeter": 10.0, "meter": 1e3, "nanometer": 1e-6}


def read_zarr(path: Path) -> tuple[NDArray[Any], NDArray[Any] | None, Spacing]:
    """Read the finest level of a multiscale image, and its first label image if it has one.

    Parameters
    ----------
    path : Path
        Folder of a Zarr group or array.

    Returns
    -------
    volume : (Z, Y, X) ndarray
    labels : (Z, Y, X) ndarray of int, or None
        None also where the label image has another shape.
    spacing : (float, float, float)
        mm, z y x; 1 where the metadata do not say.

    Raises
    ------
    ValueError
        If it is not a Zarr image of one time point and channel.
    ImportError
        If zarr is missing.
    """
    zarr = needed("zarr", "zarr", "reading OME-Zarr")
    try:
        node = zarr.open(str(path), mode="r")
    except Exception as error:
        # zarr raises many kinds of its own, which moved between its releases.
        raise ValueError(f"{path} is not a readable Zarr image: {error}") from error
    if not hasattr(node, "keys"):
        return checked_volume_array(np.asarray(node[...]), path), None, (1.0, 1.0, 1.0)
    array, spacing = _finest(node, path)
    volume = checked_volume_array(array, path)
    labels = _labels(node, path)
    # Labels of a coarser level cannot be laid over the volume.
    if labels is not None and labels.shape != volume.shape:
        labels = None
    return volume, labels, checked_spacing(spacing, path)


def _attributes(node: Any) -> dict[str, Any]:
    attributes = dict(node.attrs)
    # 0.5 moved all under "ome"; 0.4 has it at the top.
    inner: dict[str, Any] = attributes.get("ome", attributes)
    return inner


def _finest(node: Any, path: Path) -> tuple[NDArray[Any], Spacing]:
    scales = _attributes(node).get("multiscales")
    if not scales:
        raise ValueError(f"{path} holds no OME-Zarr image ('multiscales' is missing)")
    # The standard sorts them from fine to coarse.
    level = scales[0]["datasets"][0]
    try:
        array = np.asarray(node[level["path"]][...])
    except (KeyError, OSError, ValueError, RuntimeError) as error:
        raise ValueError(f"the finest level of {path} cannot be read: {error}") from error
    # Version 0.3 has bare names.
    axes = [a if isinstance(a, dict) else {"name": a} for a in scales[0].get("axes", [])]
    factors = np.ones(array.ndim)
    steps = [*scales[0].get("coordinateTransformations", []), *level["coordinateTransformations"]]
    for step in steps:
        if step.get("type") == "scale":
            # Both the whole image and its level may scale; they multiply.
            factors = factors * np.asarray(step["scale"], dtype=float)
    for i, axis in enumerate(axes):
        factors[i] *= _MM.get(axis.get("unit", ""), 1.0)
    # Time and channel come first, so space is the last three axes.
    return array, (float(factors[-3]), float(factors[-2]), float(factors[-1]))


def _labels(node: Any, path: Path) -> NDArray[Any] | None:
    if "labels" not in node:
        return None
    group = node["labels"]
    names = _attributes(group).get("labels") or list(group.keys())
    if not names:
        return None
    return checked_label_array(_finest(group[names[0]], path)[0], f"the labels of {path}")
