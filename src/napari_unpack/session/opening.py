"""An object opened: its contents, or the parts of different density in it, as a bag of its own."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

LEAST_SHARE = 0.004
"""Parts smaller than this share of the object are added to what is around them."""

MOST_PARTS = 40


def opened(session: Any, object_id: int) -> Any:
    """Return a session of what is inside an object.

    Parameters
    ----------
    session : Session
        Whose object; it is not changed.
    object_id : int
        A container with contents of its own (column `parent` of `session.objects`), or any
        object made of parts that differ in density.

    Returns
    -------
    Session
        On the object's box, everything else in it air, with the parts as its objects.

    Raises
    ------
    ValueError
        If it is of one piece.

    Notes
    -----
    notes: readings 14. A closed container and what fills it are one object, so its contents
    are found here by density: three classes by the thresholds of Otsu's method for several
    classes, connected, the smallest given to their neighbours.
    """
    window = session.boxes.slices(object_id, margin=2)
    labels = np.asarray(session.labels[window])
    family = _family(session.objects, object_id)
    inside = np.isin(labels, list(family))
    volume = np.asarray(session.volume[window])
    parts = np.where(inside, labels, 0)
    if len(np.unique(parts[inside])) < 2:
        parts = parts_by_density(volume, inside)
    names = session.objects["name"]
    ids = [int(i) for i in np.unique(parts) if i]
    if len(ids) < 2:
        raise ValueError(
            f"{names[object_id]} cannot be opened: all of it has nearly the same density, and no "
            "object is known to lie in it"
        )
    import pandas as pd

    from napari_unpack.session.session import Session

    outer = str(names[object_id])
    known = {i: str(names[i]) for i in family}
    if set(ids) <= family:
        told = [known[i] for i in ids]
    else:
        told = [f"{outer}, part {k}" for k in range(1, len(ids) + 1)]
    shown = np.where(inside, volume, np.zeros((), volume.dtype))
    table = pd.DataFrame({"name": told}, index=pd.Index(ids, name="id"))
    inner = Session(shown, parts, session.spacing, table)
    inner.transfer_function = (
        session.study(object_id).transfer_function or session.transfer_function
    )
    inner.history.clear()
    return inner


def parts_by_density(volume: NDArray[Any], inside: NDArray[np.bool_]) -> NDArray[np.uint16]:
    """Split an object where its density jumps.

    Parameters
    ----------
    volume : (Z, Y, X) ndarray
        Density.
    inside : (Z, Y, X) ndarray of bool
        The object.

    Returns
    -------
    (Z, Y, X) ndarray of uint16
        Parts, the largest 1; 0 outside. All 1 where nothing differs.
    """
    from scipy import ndimage
    from skimage.filters import threshold_multiotsu

    whole = inside.astype(np.uint16)
    known = np.asarray(volume, np.float32)[inside & np.isfinite(volume)]
    if not known.size:
        return whole
    # What is not the object's counts as its commonest density: its own edge is no jump.
    smooth = ndimage.median_filter(np.where(inside, volume, np.median(known)).astype(np.float32), 3)
    values = smooth[inside]
    values = values[np.isfinite(values)]
    spread = np.clip(values, *np.percentile(values, [0.5, 99.5]))
    kinds = min(3, len(np.unique(spread)))
    if kinds < 2:
        return whole
    cuts = threshold_multiotsu(spread, classes=kinds)
    classes = np.digitize(smooth, cuts)
    least = max(16, round(LEAST_SHARE * inside.sum()))
    seeds = np.zeros(inside.shape, np.int32)
    found: list[tuple[int, NDArray[np.bool_]]] = []
    for level in range(len(cuts) + 1):
        pieces, _ = ndimage.label(inside & (classes == level))
        sizes = np.bincount(pieces.ravel())
        found += [(int(sizes[k]), pieces == k) for k in range(1, len(sizes)) if sizes[k] >= least]
    for k, (_, piece) in enumerate(sorted(found, key=lambda one: -one[0])[:MOST_PARTS], start=1):
        seeds[piece] = k
    if not seeds.any():
        return whole
    nearest = ndimage.distance_transform_edt(
        seeds == 0, return_distances=False, return_indices=True
    )
    parts: NDArray[np.uint16] = np.where(inside, seeds[tuple(nearest)], 0).astype(np.uint16)
    return parts


def _family(objects: Any, object_id: int) -> set[int]:
    """Return an object and all that lies in it, by the column `parent`."""
    family = {object_id}
    if "parent" in objects:
        while True:
            grown = family | {int(i) for i in objects.index[objects["parent"].isin(family)]}
            if grown == family:
                break
            family = grown
    return family
