"""How well each true object was found, and tables of that by class or kind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from napari_unpack.segmentation.checks import checked_labels, checked_spacing
from napari_unpack.segmentation.evaluation import contingency

BULK, SHEET = 0.5, 0.2
"""The least precision and recall of a detected object, and of a detected sheet."""


def score_objects(
    truth: ArrayLike,
    found: ArrayLike,
    spacing: Sequence[float] = (1.0, 1.0, 1.0),
    boundary: bool = False,
    sheets: Sequence[int] = (),
) -> pd.DataFrame:
    """Compare every true object with what was found in its place.

    Parameters
    ----------
    truth, found : (Z, Y, X) array_like of int
        Label volumes of one shape, 0 is background.
    spacing : (3,) sequence of float
        Voxel size z y x, mm; of the boundary's distances only.
    boundary : bool
        Whether the distances between boundaries are measured too.
    sheets : sequence of int
        True IDs held to the sheets' rule of detection.

    Returns
    -------
    pandas.DataFrame
        One row a true object, indexed by its `id`: voxels, match (found ID of the largest IoU, 0
        for none), iou, precision (of the match, inside the object), recall (of the object, inside
        the match), pieces (found objects that cover at least 5 % of it), shares_match (whether
        the match covers at least 5 % of another true object), detected (some found object has
        precision and recall of at least 0.5, for sheets 0.2); with `boundary` also
        surface_mm and hausdorff95_mm, NaN where there is no match.

    Raises
    ------
    ValueError
        If the shapes differ, or the truth has no object.

    Notes
    -----
    notes 3.7 of the design; the rule of detection is ALERT's. Surface distances are taken both
    ways between boundary voxels: their mean, and the larger of the two 95 % quantiles.
    """
    true, seen = checked_labels(truth, "truth"), checked_labels(found, "found")
    size = checked_spacing(spacing)
    if true.shape != seen.shape:
        raise ValueError(f"truth and found must have one shape, got {true.shape} and {seen.shape}")
    table = contingency(true, seen)
    ids, names = _present(true), _present(seen)
    if not len(ids):
        raise ValueError("truth must hold at least one object, got background alone")
    common = table[1:, 1:].astype(np.float64)
    rows, columns = table.sum(1)[1:], table.sum(0)[1:].astype(np.float64)
    if not len(names):
        # One empty object stands for nothing found.
        names, columns, common = np.zeros(1, np.int64), np.zeros(1), np.zeros((len(ids), 1))
    recall, precision = common / rows[:, None], common / np.maximum(columns, 1)
    iou = common / np.maximum(rows[:, None] + columns - common, 1)
    least = np.where(np.isin(ids, list(sheets)), SHEET, BULK)[:, None]
    result = pd.DataFrame({"voxels": rows}, index=pd.Index(ids, name="id"))
    best = iou.argmax(axis=1)
    every = np.arange(len(ids))
    hit = iou[every, best] > 0
    result["match"] = np.where(hit, names[best], 0)
    result["iou"] = iou[every, best]
    result["precision"] = precision[every, best]
    result["recall"] = recall[every, best]
    covers = recall >= 0.05
    result["pieces"] = covers.sum(1)
    others = covers.sum(0)[best] - covers[every, best]
    result["shares_match"] = hit & (others > 0)
    result["detected"] = ((precision >= least) & (recall >= least)).any(1)
    if boundary:
        distances = [
            _distances(true == i, (seen == m) & (m > 0), size) for i, m in result["match"].items()
        ]
        result[["surface_mm", "hausdorff95_mm"]] = np.array(distances)
    return result


def score_by(objects: pd.DataFrame, groups: Mapping[int, Any] | pd.Series) -> pd.DataFrame:
    """Summarise a table of objects by class or kind.

    Parameters
    ----------
    objects : pandas.DataFrame
        As `score_objects` returns it; tables of several bags may be concatenated.
    groups : mapping of int to str, or pandas.Series
        The group of each ID; a Series as long as the table is taken row by row.

    Returns
    -------
    pandas.DataFrame
        Indexed by group, the last row is `all`: objects, found (share matched at IoU > 0.5),
        found_75, detected (share), mean_iou (0 where there is no match), fragmented (share in
        more than one piece), merged (share whose match covers another object too), and where the
        table has them surface_mm and hausdorff95_mm (means of the matched).
    """
    if isinstance(groups, pd.Series) and len(groups) == len(objects):
        keys = groups.to_numpy()
    else:
        keys = np.array([str(groups.get(i, "unknown")) for i in objects.index])
    facts = pd.DataFrame(
        {
            "objects": 1,
            "found": objects["iou"].to_numpy() > 0.5,
            "found_75": objects["iou"].to_numpy() > 0.75,
            "detected": objects["detected"].to_numpy(bool),
            "mean_iou": objects["iou"].to_numpy(),
            "fragmented": objects["pieces"].to_numpy() > 1,
            "merged": objects["shares_match"].to_numpy(bool),
        }
    )
    for name in ("surface_mm", "hausdorff95_mm"):
        if name in objects:
            facts[name] = objects[name].to_numpy()
    how = {name: "sum" if name == "objects" else "mean" for name in facts}
    parts = facts.groupby(keys).agg(how)
    total = facts.groupby(np.full(len(facts), "all")).agg(how)
    return pd.concat([parts, total]).rename_axis("group")


def _present(labels: NDArray[np.integer]) -> NDArray[np.int64]:
    ids = np.unique(labels)
    return np.asarray(ids[ids > 0], np.int64)


def _distances(
    one: NDArray[np.bool_], other: NDArray[np.bool_], spacing: tuple[float, float, float]
) -> tuple[float, float]:
    """Return the mean and the 95 % Hausdorff distance of two masks' boundaries, mm."""
    if not other.any():
        return np.nan, np.nan
    spots = np.nonzero(one | other)
    box = tuple(slice(int(axis.min()), int(axis.max()) + 1) for axis in spots)
    rims = [_rim(mask[box]) for mask in (one, other)]
    ways = []
    for here, there in (rims, rims[::-1]):
        away = ndimage.distance_transform_edt(~there, sampling=spacing)
        ways.append(away[here])
    largest = max(float(np.quantile(way, 0.95)) for way in ways)
    return float(np.concatenate(ways).mean()), largest


def _rim(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return mask & ~ndimage.binary_erosion(mask)
