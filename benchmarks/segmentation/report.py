"""From scores of many volumes to tables: methods by metric, and kinds of object by method."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmarks.segmentation.bags import Case
from napari_unpack.segmentation import score, score_objects

METRICS = (
    "f1",
    "f1_75",
    "ap",
    "panoptic_quality",
    "voi_split",
    "voi_merge",
    "voi",
    "adapted_rand",
    "count_error",
    "fragmentation_rate",
    "merge_rate",
    "false_foreground",
)


@dataclass(frozen=True, eq=False)
class Scored:
    """Scores of one method on one volume, with all its settings.

    Parameters
    ----------
    totals : list of dict
        By setting: method, setting, case, `METRICS`, seconds (of processor time).
    objects : pandas.DataFrame
        One row for every true object and setting.
    """

    totals: list[dict[str, float | str]]
    objects: pd.DataFrame


def scored(
    method: str, setting: str, case: Case, found: NDArray[np.integer], seconds: float
) -> Scored:
    """Score one segmentation."""
    if case.ignored is not None:
        found = np.where(case.ignored, 0, found)
    totals = score(case.labels, found)
    row: dict[str, float | str] = {"method": method, "setting": setting, "case": case.name}
    row |= {name: totals[name] for name in METRICS}
    sheets = case.groups.index[case.groups == "sheet"].tolist()
    each = score_objects(case.labels, found, case.spacing, sheets=sheets)
    each["kind"], each["group"] = case.kinds, case.groups
    each["method"], each["setting"], each["case"] = method, setting, case.name
    return Scored([row | {"seconds": seconds}], each)


@dataclass
class Report:
    """Scores of one family of volumes, filled volume by volume."""

    totals: list[dict[str, float | str]] = field(default_factory=list)
    objects: list[pd.DataFrame] = field(default_factory=list)

    def add(self, found: Scored) -> None:
        """Take in the scores of one method on one volume."""
        self.totals.extend(found.totals)
        if len(found.objects):
            self.objects.append(found.objects)

    def first(self, count: int) -> Report:
        """Return the scores of the first so many volumes."""
        wanted = list(dict.fromkeys(row["case"] for row in self.totals))[:count]
        totals = [row for row in self.totals if row["case"] in wanted]
        return Report(totals, [each for each in self.objects if each["case"].iloc[0] in wanted])

    def of(self, methods: Collection[str]) -> Report:
        """Return the scores of some methods."""
        totals = [row for row in self.totals if row["method"] in methods]
        return Report(totals, [each for each in self.objects if each["method"].iloc[0] in methods])

    def best(self) -> dict[str, str]:
        """Return the setting of each method with the best mean F1."""
        totals = pd.DataFrame(self.totals)
        means = totals.groupby(["method", "setting"], sort=False)["f1"].mean()
        methods = totals["method"].drop_duplicates()
        return {str(method): str(means[method].idxmax()) for method in methods}

    def metrics(self) -> pd.DataFrame:
        """Return the mean of every metric by method, each at its best setting."""
        table = self._chosen(pd.DataFrame(self.totals))
        return table.groupby("setting", sort=False)[[*METRICS, "seconds"]].mean()

    def by(self, column: str) -> pd.DataFrame:
        """Return by kind or group how many objects there are, and who matched which share.

        Shares are of objects matched at IoU > 0.5; by group they are of objects detected by the
        50 % bulk, 20 % sheet rule.
        """
        each = self._chosen(pd.concat(self.objects))
        each["hit"] = each["detected"] if column == "group" else each["iou"] > 0.5
        shares = each.pivot_table(index=column, columns="setting", values="hit", sort=False)
        shares = shares[list(self.best().values())]
        first = each[each["setting"] == each["setting"].iloc[0]]
        shares.insert(0, "objects", first.groupby(column).size())
        return shares.sort_values(str(shares.columns[-1]))

    def _chosen(self, table: pd.DataFrame) -> pd.DataFrame:
        return table[table["setting"].isin(self.best().values())].copy()


WHOLE = frozenset({"objects", "volumes"})
"""Columns of whole numbers."""


def markdown(table: pd.DataFrame, title: str) -> str:
    """Return a table as Markdown, numbers with two digits."""
    names = [title, *map(str, table.columns)]
    lines = ["| " + " | ".join(names) + " |", "|" + "---|" * len(names)]
    for name, row in zip(table.index, table.itertuples(index=False), strict=True):
        cells = [
            v if isinstance(v, str) else str(int(v)) if column in WHOLE else f"{v:.2f}"
            for column, v in zip(table.columns, row, strict=True)
        ]
        lines.append("| " + " | ".join([str(name), *cells]) + " |")
    return "\n".join(lines)
