"""The table of objects: facts by ID, completed from the volume where nobody gave them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from numpy.typing import NDArray

from napari_unpack.geometry.boxes import LabelBoxes

if TYPE_CHECKING:
    import pandas as pd


def object_table(
    volume: NDArray[np.generic],
    labels: NDArray[np.uint16],
    boxes: LabelBoxes,
    spacing: NDArray[np.float64],
    given: pd.DataFrame | None = None,
    given_ids: NDArray[np.int64] | None = None,
) -> pd.DataFrame:
    """Make or complete the table of objects.

    Parameters
    ----------
    volume : (Z, Y, X) ndarray
        Density; NaN does not count.
    labels : (Z, Y, X) ndarray of uint16
        Object IDs.
    boxes : LabelBoxes
        Of these labels.
    spacing : (3,) ndarray of float64
        Voxel size in mm, z y x.
    given : DataFrame, optional
        Indexed by ID. Its columns are kept, its rows of other objects dropped.
    given_ids : (M,) ndarray of int64, optional
        By ID, the one people know it by: in the index of `given`, in names, and in a column
        `label` of the table. None where that is the ID itself.

    Returns
    -------
    DataFrame
        Indexed by `id`, one row an object, with at least name, voxels, volume_mm3,
        mean_density, confidence, z, y, x (centre of mass, mm).

    Raises
    ------
    ValueError
        If the given table's index holds an ID twice.
    """
    import pandas as pd

    means, centers = _measure(volume, labels, int(boxes.ids[-1]))
    ids = boxes.ids
    known_by = ids if given_ids is None else given_ids[ids]
    found = pd.DataFrame(
        {
            "name": [f"Object {i}" for i in known_by],
            "voxels": boxes.counts,
            "volume_mm3": boxes.counts * float(np.prod(spacing)),
            "mean_density": means[ids],
            "confidence": np.full(len(ids), np.nan),
            **{axis: centers[ids, k] * spacing[k] for k, axis in enumerate("zyx")},
        },
        index=pd.Index(ids, name="id"),
    )
    if given_ids is not None:
        found.insert(0, "label", known_by)
    if given is None:
        return found
    if not given.index.is_unique:
        raise ValueError("objects must have each ID once in its index")
    known = given.reindex(known_by).set_index(found.index)
    if "name" not in known and "kind" in known:
        found["name"] = [
            f"{str(kind).capitalize()} {i}" if isinstance(kind, str) else f"Object {i}"
            for i, kind in zip(known_by, known["kind"], strict=True)
        ]
    for column in found:
        if column in known:
            found[column] = known[column].where(known[column].notna(), found[column])
    extra = [column for column in known if column not in found]
    return found.join(known[extra])


def _measure(
    volume: NDArray[np.generic], labels: NDArray[np.uint16], top: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return by ID the mean density (top + 1,) and the centre of mass (top + 1, 3) in voxels."""
    numbers = np.zeros((top + 1, 6))
    for z in range(labels.shape[0]):
        plane = np.asarray(volume[z])
        if plane.dtype.kind not in "uif" or plane.dtype.itemsize not in (1, 2, 4, 8):
            plane = plane.astype(np.float64)
        _add_plane(plane.astype(np.float32, copy=False), labels[z], z, numbers)
    with np.errstate(invalid="ignore", divide="ignore"):
        return numbers[:, 4] / numbers[:, 5], numbers[:, 1:4] / numbers[:, :1]


@njit(cache=True, nogil=True)
def _add_plane(plane, labels, z, numbers):  # type: ignore[no-untyped-def]
    for y in range(labels.shape[0]):
        for x in range(labels.shape[1]):
            label = labels[y, x]
            if label == 0:
                continue
            row = numbers[label]
            row[0] += 1
            row[1] += z
            row[2] += y
            row[3] += x
            if np.isfinite(plane[y, x]):
                row[4] += plane[y, x]
                row[5] += 1
