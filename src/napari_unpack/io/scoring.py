"""A score as text for people: what each number says, and tables by kind of object."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from napari_unpack.file_sizes import check_plain_file
from napari_unpack.read_errors import read_errors_told
from napari_unpack.segmentation import score, score_by, score_objects

MEANINGS = {
    "f1": "objects matched at IoU > 0.5",
    "f1_75": "at IoU > 0.75",
    "precision": "share of found objects that match",
    "recall": "share of true objects that match",
    "ap": "mean over IoU 0.5, 0.55 .. 0.95",
    "mean_iou": "of matched objects",
    "panoptic_quality": "mean IoU times F1",
    "true_objects": "",
    "found_objects": "",
    "count_error": "|found - true| / true",
    "voi_split": "bits lost by splitting",
    "voi_merge": "bits lost by merging",
    "voi": "their sum",
    "adapted_rand": "error over pairs of voxels",
    "oversegmentation": "found objects a true one lies in",
    "undersegmentation": "true objects in a found one",
    "fragmentation_rate": "share of true objects in pieces",
    "merge_rate": "share of true objects run into others",
    "false_foreground": "found voxels outside the truth",
    "missed_foreground": "true voxels not found",
}


def score_report(
    truth: NDArray[Any],
    found: NDArray[Any],
    spacing: tuple[float, float, float] = (1.0, 1.0, 1.0),
    objects: Path | None = None,
    by: str = "kind",
    boundary: bool = False,
) -> str:
    """Write a score down for reading.

    Parameters
    ----------
    truth, found : (Z, Y, X) ndarray of int
        Object IDs, 0 background.
    spacing : (float, float, float) of mm, z y x
    objects : Path, optional
        A .csv with a column id and one named `by`: adds a table by group. Where the column
        names sheets ("sheet"), they are held to the sheets' rule.
    by : str
        That column.
    boundary : bool
        Whether boundary distances stand in that table.

    Raises
    ------
    ValueError
        If the labels cannot be compared or the table lacks a column.
    """
    totals = score(truth, found)
    # A number that is new to `score` is printed without a meaning rather than left out.
    words = {**dict.fromkeys(totals, ""), **MEANINGS}
    lines = [f"{name:<20}{totals[name]:>8.4f}  {words[name]}".rstrip() for name in words]
    if objects is None and not boundary:
        return "\n".join(lines)
    groups = {} if objects is None else _groups(objects, by)
    sheets = [i for i, group in groups.items() if group == "sheet"]
    each = score_objects(truth, found, spacing, boundary, sheets)
    summary = score_by(each, groups)
    if objects is None:
        # Without a table there are no kinds to tell apart.
        summary = summary.loc[["all"]]
    return "\n".join([*lines, "", table_text(summary)])


def table_text(summary: pd.DataFrame) -> str:
    """Return a table of `score_by` in columns, shares as percentages."""
    shares = ("found", "found_75", "detected", "fragmented", "merged")
    shown = summary.reset_index()
    for column in shown.columns:
        if column in shares:
            shown[column] = [f"{share:.0%}" for share in shown[column]]
        elif shown[column].dtype.kind == "f":
            shown[column] = [f"{value:.2f}" for value in shown[column]]
    return shown.to_string(index=False)


def _groups(path: Path, by: str) -> dict[int, str]:
    with read_errors_told(path, "a table (.csv)"):
        check_plain_file(path)
        table = pd.read_csv(path)
    for column in ("id", by):
        if column not in table.columns:
            raise ValueError(
                f"{path} must have a column {column!r}, its columns are {', '.join(table.columns)}"
            )
    ids = pd.to_numeric(table["id"], errors="coerce")
    if not np.isfinite(ids).all() or (ids % 1 != 0).any():
        raise ValueError(f"{path} must have a whole number in every row of its column 'id'")
    named = table[by].notna()
    return {int(i): str(group) for i, group in zip(ids[named], table[by][named], strict=True)}
