"""How well found labels match true ones: as a whole, object by object, and by class or kind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage
from scipy.sparse import coo_matrix

from napari_unpack.geometry.axes import voxel_size
from napari_unpack.geometry.boxes import bounding_box
from napari_unpack.segmentation.common.validation import checked_labels

# Least precision and recall of a detected object, and of a detected sheet: ALERT's rule.
BULK, SHEET = 0.5, 0.2
# Share of a true object from which a found one counts as covering it; less is a wrong border.
COVERS = 0.05

# Voxels that are counted at a time, in whole planes: each takes 44 bytes meanwhile.
AT_ONCE = 1 << 19


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
        true_objects, found_objects, count_error
            How many there are, and |found - true| / true.
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
    overlaps = Overlaps.of(*_checked(truth, found))
    return {**_objects(overlaps), **_information(overlaps), **_coverage(overlaps)}


def _checked(truth: ArrayLike, found: ArrayLike) -> tuple[NDArray[np.integer], NDArray[np.integer]]:
    """Return two label volumes of one shape, or say what is wrong with them."""
    true, seen = checked_labels(truth, "truth"), checked_labels(found, "found")
    if true.shape != seen.shape:
        raise ValueError(f"truth and found must have one shape, got {true.shape} and {seen.shape}")
    if not true.any():
        raise ValueError("truth must hold at least one object, got background alone")
    return true, seen


@dataclass(frozen=True, eq=False)
class Overlaps:
    """The voxels that labels of two volumes have in common, pair by pair.

    Parameters
    ----------
    true_ids, found_ids : (T,), (F,) ndarray of int64
        Labels that occur, ascending; 0 first, even where it does not occur.
    rows, columns : (P,) ndarray of int64
        Of every pair that occurs: positions in `true_ids` and `found_ids`, in this order.
    voxels : (P,) ndarray of int64
        What the pair has in common.
    """

    true_ids: NDArray[np.int64]
    found_ids: NDArray[np.int64]
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    voxels: NDArray[np.int64]

    @classmethod
    def of(cls, truth: NDArray[np.integer], found: NDArray[np.integer]) -> Overlaps:
        """Count the voxels of every pair of labels.

        Parameters
        ----------
        truth, found : (Z, Y, X) ndarray of int
            0 is background.

        Notes
        -----
        Pairs that do not occur take no memory: two volumes of 60,000 objects have a few times as
        many pairs, and not 3.6 billion.
        """
        step = max(1, AT_ONCE // max(truth[0].size, 1))
        parts = []
        for z in range(0, len(truth), step):
            here, there = truth[z : z + step], found[z : z + step]
            part = cls._summed(here, there, np.ones(here.size, np.int64))
            parts.append((part.true_ids[part.rows], part.found_ids[part.columns], part.voxels))
        return cls._summed(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    @classmethod
    def _summed(
        cls, truth: NDArray[np.integer], found: NDArray[np.integer], voxels: NDArray[np.int64]
    ) -> Overlaps:
        """Add up the voxels of pairs that may occur several times."""
        (true_ids, rows), (found_ids, columns) = _numbered(truth), _numbered(found)
        shape = len(true_ids), len(found_ids)
        table = coo_matrix((voxels, (rows, columns)), shape=shape).tocsr()
        table.sum_duplicates()
        pairs = table.tocoo()
        return cls(
            true_ids, found_ids, pairs.row.astype(np.int64), pairs.col.astype(np.int64), pairs.data
        )

    @property
    def true_voxels(self) -> NDArray[np.int64]:
        """(T,) voxels of each true label."""
        return _sums(self.rows, self.voxels, len(self.true_ids))

    @property
    def found_voxels(self) -> NDArray[np.int64]:
        """(F,) voxels of each found label."""
        return _sums(self.columns, self.voxels, len(self.found_ids))

    @property
    def of_objects(self) -> NDArray[np.bool_]:
        """(P,) whether a pair is of two objects, and not of background."""
        return (self.rows > 0) & (self.columns > 0)

    @property
    def table(self) -> NDArray[np.int64]:
        """(T, F) voxels of every pair, those that do not occur too; for few labels."""
        dense = np.zeros((len(self.true_ids), len(self.found_ids)), np.int64)
        dense[self.rows, self.columns] = self.voxels
        return dense

    def iou(self) -> NDArray[np.float64]:
        """Return (P,) intersections over unions; of all pairs, background among them."""
        union = self.true_voxels[self.rows] + self.found_voxels[self.columns] - self.voxels
        return np.asarray(self.voxels / union)


def _numbered(labels: NDArray[np.integer]) -> tuple[NDArray[np.int64], NDArray[np.integer]]:
    """Return the labels that occur, 0 first in any case, and every voxel's position among them."""
    flat = labels.reshape(-1)
    # A table by label is quicker than sorting, but IDs may be up to 2^63.
    if int(flat.max(initial=0)) < 1 << 20:
        held = np.bincount(flat, minlength=1) > 0
        held[0] = True
        return np.flatnonzero(held), (np.cumsum(held) - 1)[flat]
    # A zero of their own type: of uint64 and int64 numpy makes floats, which round large IDs.
    ids, positions = np.unique(np.append(flat, flat.dtype.type(0)), return_inverse=True)
    return ids.astype(np.int64), positions[:-1]


def _sums(keys: NDArray[np.int64], values: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    # As floats on the way, which hold whole numbers of voxels up to 2^53.
    return np.bincount(keys, values, count).astype(np.int64)


def _objects(overlaps: Overlaps) -> dict[str, float]:
    true, found = len(overlaps.true_ids) - 1, len(overlaps.found_ids) - 1
    best, kept = np.zeros(true + 1), overlaps.of_objects
    np.maximum.at(best, overlaps.rows[kept], overlaps.iou()[kept])
    best = best[1:]
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


def _information(overlaps: Overlaps) -> dict[str, float]:
    # Background of the truth is left out: found voxels there are counted apart.
    inside = overlaps.rows > 0
    joint = overlaps.voxels[inside] / overlaps.voxels[inside].sum()
    rows = np.asarray(np.bincount(overlaps.rows[inside], joint), np.float64)
    columns = np.asarray(np.bincount(overlaps.columns[inside], joint), np.float64)
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


def _coverage(overlaps: Overlaps) -> dict[str, float]:
    rows, columns = overlaps.rows, overlaps.columns
    share = overlaps.voxels / overlaps.true_voxels[rows]
    covers = overlaps.of_objects & (share >= COVERS)
    by_true = np.bincount(rows[covers], minlength=len(overlaps.true_ids))[1:]
    by_found = np.bincount(columns[covers], minlength=len(overlaps.found_ids))
    shared = np.unique(rows[covers & (by_found[columns] > 1)])
    used = by_found > 0
    found, true = overlaps.voxels[columns > 0].sum(), overlaps.voxels[rows > 0].sum()
    false = overlaps.voxels[(rows == 0) & (columns > 0)].sum()
    missed = overlaps.voxels[(rows > 0) & (columns == 0)].sum()
    return {
        "fragmentation_rate": float((by_true > 1).mean()),
        "merge_rate": len(shared) / len(by_true),
        "oversegmentation": float(by_true.mean()),
        "undersegmentation": float(by_found[used].mean()) if used.any() else 0.0,
        "false_foreground": float(false / found) if found else 0.0,
        "missed_foreground": float(missed / true),
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
    size = voxel_size(spacing)
    overlaps = Overlaps.of(true, seen)
    ids, kept = overlaps.true_ids[1:], overlaps.of_objects
    rows, columns, iou = overlaps.rows[kept], overlaps.columns[kept], overlaps.iou()[kept]
    recall = overlaps.voxels[kept] / overlaps.true_voxels[rows]
    precision = overlaps.voxels[kept] / overlaps.found_voxels[columns]
    # The best pair of every true object: sorted by IoU, the last written stays.
    best = np.full(len(overlaps.true_ids), -1)
    order = np.lexsort((-columns, iou))
    best[rows[order]] = order
    best = best[1:]
    hit = best >= 0

    def of_best(values: NDArray[Any]) -> NDArray[Any]:
        # An object without a match has -1 there, which may be no element at all.
        return np.where(hit, np.append(values, values.dtype.type(0))[best], 0)

    covers = recall >= COVERS
    by_found = np.bincount(columns[covers], minlength=len(overlaps.found_ids))
    least = np.where(np.isin(overlaps.true_ids, list(sheets)), SHEET, BULK)[rows]
    detecting = (precision >= least) & (recall >= least)
    result = pd.DataFrame({"voxels": overlaps.true_voxels[1:]}, index=pd.Index(ids, name="id"))
    result["match"] = of_best(overlaps.found_ids[columns])
    result["iou"] = of_best(iou)
    result["precision"] = of_best(precision)
    result["recall"] = of_best(recall)
    result["pieces"] = np.bincount(rows[covers], minlength=len(ids) + 1)[1:]
    result["shares_match"] = hit & (of_best(by_found[columns] - covers) > 0)
    result["detected"] = np.isin(np.arange(1, len(ids) + 1), rows[detecting])
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
        The group of each ID, "unknown" where it is missing. A Series as long as the table is taken
        row by row, unless both have the same IDs, each once.

    Returns
    -------
    pandas.DataFrame
        Indexed by group, the last row is `all`: objects, found (share matched at IoU > 0.5),
        found_75, detected (share), mean_iou (0 where there is no match), fragmented (share in
        more than one piece), merged (share whose match covers another object too), and where the
        table has them surface_mm and hausdorff95_mm (means of the matched).

    Raises
    ------
    TypeError
        If the groups are neither, such as a whole table.
    """
    if not isinstance(groups, Mapping | pd.Series):
        raise TypeError(
            "groups must be a mapping from ID to group or a Series, such as one column of a table, "
            f"got {type(groups).__name__}"
        )
    if isinstance(groups, pd.Series) and len(groups) == len(objects):
        ids = objects.index
        known = ids.is_unique and groups.index.is_unique and ids.isin(groups.index).all()
        # However either is sorted.
        keys = pd.Series((groups.reindex(ids) if known else groups).to_numpy())
    else:
        keys = pd.Series([groups.get(i) for i in objects.index], dtype=object)
        keys = keys.map(str, na_action="ignore")
    # Without a name they would count in the last row and in no group.
    keys = keys.astype(object).where(keys.notna(), "unknown")
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
    parts = facts.groupby(keys.to_numpy()).agg(how)
    total = facts.groupby(np.full(len(facts), "all")).agg(how)
    return pd.concat([parts, total]).rename_axis("group")


def _distances(
    one: NDArray[np.bool_], other: NDArray[np.bool_], spacing: tuple[float, float, float]
) -> tuple[float, float]:
    """Return the mean and the 95 % Hausdorff distance of two masks' boundaries, mm."""
    if not other.any():
        return np.nan, np.nan
    box = bounding_box(one | other)
    rims = [_rim(mask[box]) for mask in (one, other)]
    ways = []
    for here, there in (rims, rims[::-1]):
        away = ndimage.distance_transform_edt(~there, sampling=spacing)
        ways.append(away[here])
    largest = max(float(np.quantile(way, 0.95)) for way in ways)
    return float(np.concatenate(ways).mean()), largest


def _rim(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return mask & ~ndimage.binary_erosion(mask)
