"""How well found labels match true ones: as a whole, object by object, and by class or kind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage
from scipy.sparse import coo_matrix

from napari_unpack.segmentation.common.validation import checked_labels, checked_spacing

# Least precision and recall of a detected object, and of a detected sheet: ALERT's rule.
BULK, SHEET = 0.5, 0.2
# Share of a true object from which a found one counts as covering it; less is a wrong border.
COVERS = 0.05


def score(truth: ArrayLike, found: ArrayLike) -> dict[str, float]:
    """Compare a segmentation with the truth.

    Parameters
    ----------
    truth, found : (Z, Y, X) array_like of int
        Label volumes of one shape, 0 is background. Labels need not correspond.

    Returns
    -------
    dict of str to float
        f1, precision, recall
            Of objects matched at IoU > 0.5.
        f1_75, ap
            F1 at IoU > 0.75; mean of TP / (TP + FP + FN) over IoU thresholds 0.5, 0.55 .. 0.95.
        mean_iou
            Mean IoU of the matched objects; panoptic_quality is mean_iou * f1.
        voi_split, voi_merge, voi
            H(found | truth), H(truth | found) and their sum, bits.
        adapted_rand
            1 - 2PR / (P + R) over pairs of voxels (SNEMI3D).
        oversegmentation, undersegmentation
            Mean number of found objects covering at least 5 % of a true one; mean number of
            true objects covered to at least 5 % by a found one.
        fragmentation_rate, merge_rate
            Share of true objects that more than one found object covers to at least 5 %; share
            of true objects that lie to at least 5 % in a found one that does so for another.
        count_error
            |found - true| / true, of objects.
        false_foreground, missed_foreground
            Found voxels outside the truth, over all found voxels; and the reverse.

    Raises
    ------
    ValueError
        If the shapes differ or the truth has no object.

    Notes
    -----
    VOI and adapted Rand are taken inside the truth's foreground, where
    unlabelled found voxels count as one more segment; IoU counts all voxels of both. Matches
    above IoU 0.5 are unique, so no assignment problem has to be solved.
    """
    table = contingency(*_checked(truth, found))
    return {**_objects(table), **_information(table), **_coverage(table)}


def _checked(truth: ArrayLike, found: ArrayLike) -> tuple[NDArray[np.integer], NDArray[np.integer]]:
    """Return two label volumes of one shape, or say what is wrong with them."""
    true, seen = checked_labels(truth, "truth"), checked_labels(found, "found")
    if true.shape != seen.shape:
        raise ValueError(f"truth and found must have one shape, got {true.shape} and {seen.shape}")
    if not true.any():
        raise ValueError("truth must hold at least one object, got background alone")
    return true, seen


def contingency(truth: NDArray[np.integer], found: NDArray[np.integer]) -> NDArray[np.int64]:
    """Count the voxels of every pair of labels; row and column 0 are background.

    Parameters
    ----------
    truth, found : (Z, Y, X) ndarray of int
        0 is background.
    """
    rows, columns = (_small(labels.reshape(-1)) for labels in (truth, found))
    table = coo_matrix((np.ones(len(rows), np.int64), (rows, columns))).toarray()
    held = table.any(axis=1), table.any(axis=0)
    for names in held:
        # Background has a row and a column even where it does not occur.
        names[0] = True
    # Selected columns lie in another order in memory, in which sums would be rounded differently.
    return np.ascontiguousarray(table[held[0]][:, held[1]])


def _small(labels: NDArray[np.integer]) -> NDArray[np.integer]:
    """Return labels small enough for a dense table of pairs; larger ones are numbered anew."""
    # Two tables of 2048 labels have a pair for each of four million cells.
    if int(labels.max()) < 2048:
        return labels
    return np.asarray(np.unique(np.append(labels, 0), return_inverse=True)[1][:-1])


def iou_table(table: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the IoU of every true (row) and found (column) object, without background."""
    union = table.sum(1)[1:, None] + table.sum(0)[None, 1:] - table[1:, 1:]
    return table[1:, 1:] / np.maximum(union, 1)


def _objects(table: NDArray[np.int64]) -> dict[str, float]:
    iou = iou_table(table)
    true, found = iou.shape
    best = iou.max(axis=1, initial=0.0)
    matched = best[best > 0.5]
    hits = {t: int((best > t).sum()) for t in np.arange(50, 100, 5) / 100}
    f1 = {t: 2 * n / (true + found) for t, n in hits.items()}
    mean_iou = float(matched.mean()) if len(matched) else 0.0
    return {
        "f1": f1[0.5],
        "f1_75": f1[0.75],
        "precision": hits[0.5] / found if found else 0.0,
        "recall": hits[0.5] / true,
        "ap": float(np.mean([n / (true + found - n) for n in hits.values()])),
        "mean_iou": mean_iou,
        "panoptic_quality": mean_iou * f1[0.5],
        "true_objects": float(true),
        "found_objects": float(found),
        "count_error": abs(found - true) / true,
    }


def _information(table: NDArray[np.int64]) -> dict[str, float]:
    # Background of the truth is left out: found voxels there are counted apart.
    inside = table[1:].astype(np.float64)
    joint = inside / inside.sum()
    rows, columns = joint.sum(1), joint.sum(0)
    split = _entropy(joint) - _entropy(rows)
    merge = _entropy(joint) - _entropy(columns)
    agree = (joint**2).sum()
    precision, recall = agree / (columns**2).sum(), agree / (rows**2).sum()
    return {
        "voi_split": split,
        "voi_merge": merge,
        "voi": split + merge,
        "adapted_rand": float(1 - 2 * precision * recall / (precision + recall)),
    }


def _entropy(p: NDArray[np.float64]) -> float:
    positive = p[p > 0]
    return float(-(positive * np.log2(positive)).sum())


def _coverage(table: NDArray[np.int64]) -> dict[str, float]:
    share = table[1:, 1:] / table.sum(1)[1:, None]
    covers = share >= COVERS
    found, true = table[:, 1:].sum(), table[1:].sum()
    used = covers.any(axis=0)
    shared = covers & (covers.sum(0) > 1)
    return {
        "fragmentation_rate": float((covers.sum(1) > 1).mean()),
        "merge_rate": float(shared.any(axis=1).mean()),
        "oversegmentation": float(covers.sum(1).mean()),
        "undersegmentation": float(covers.sum(0)[used].mean()) if used.any() else 0.0,
        "false_foreground": float(table[0, 1:].sum() / found) if found else 0.0,
        "missed_foreground": float(table[1:, 0].sum() / true),
    }


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
    The rule of detection is that of the ALERT segmentation challenge. Surface distances are taken
    both ways between boundary voxels: their mean, and the larger of the two 95 % quantiles.
    """
    true, seen = _checked(truth, found)
    size = checked_spacing(spacing)
    table = contingency(true, seen)
    ids, names = _present(true), _present(seen)
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
    covers = recall >= COVERS
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
