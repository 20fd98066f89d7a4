"""What the segmentation is to reach, family by family, and the table that says how far it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from benchmarks.segmentation.report import Report

LEAST_F1 = 0.75
"""No single volume of a simulated family is to lie below."""


@dataclass(frozen=True)
class Family:
    """A family of volumes.

    Parameters
    ----------
    title : str
    count : int
        Volumes.
    compared : int
        Of them, on how many peers are measured: on large ones that takes minutes.
    f1, voi : float, optional
        Their means are to be at least and at most so much; bits.
    metal : float, optional
        Share of the metal that is to be found.
    least_iou : float, optional
        Every object is to overlap with what it was found as so much.
    excused : str, optional
        A kind of object that need not be found.
    """

    title: str
    count: int
    compared: int = 1
    f1: float | None = None
    voi: float | None = None
    metal: float | None = None
    least_iou: float | None = None
    excused: str = ""


FAMILIES = {
    "first": Family("Bags of the package's generator", 20, f1=0.92, voi=0.25, excused="coin"),
    "second": Family("Bags of the second generator", 20, f1=0.92, voi=0.30),
    "projection": Family("Bags scanned by rays", 20, f1=0.85, voi=0.30, metal=0.7, excused="coin"),
    "dense": Family("Bags of a public simulator", 2, compared=0, f1=0.85, voi=0.35),
    "pelvis": Family("Broken pelves", 2, compared=0, least_iou=0.7),
    "cells": Family("Nuclei", 1, f1=0.85),
}


def against_goals(reports: dict[str, Report], method: str) -> pd.DataFrame:
    """Return what a method reaches in every family, beside the goals.

    Parameters
    ----------
    reports : dict of str to Report
        By family.
    method : str
    """
    rows = {}
    for name, report in reports.items():
        family, totals = FAMILIES[name], pd.DataFrame(report.totals)
        totals = totals[totals["method"] == method]
        if not len(totals):
            continue
        each = pd.concat(report.objects)
        each = each[each["method"] == method]
        metal = each[each["group"] == "metal"]
        reached = {
            "volumes": len(totals),
            "F1": _beside(totals["f1"].mean(), family.f1),
            "F1, coins excused": (
                f"{_excusing(family.excused, totals, each).mean():.2f}" if family.excused else ""
            ),
            "VOI": _beside(totals["voi"].mean(), family.voi, most=True),
            "lowest F1": _beside(totals["f1"].min(), LEAST_F1 if family.f1 else None),
            "metal found": _beside(metal["detected"].mean(), family.metal) if len(metal) else "",
            "lowest IoU": _beside(each["iou"].min(), family.least_iou) if family.least_iou else "",
            "seconds": f"{totals['seconds'].mean():.1f}",
        }
        rows[family.title] = reached
    return pd.DataFrame.from_dict(rows, orient="index")


def _excusing(kind: str, totals: pd.DataFrame, each: pd.DataFrame) -> pd.Series:
    """Return the F1 of every volume as if a kind of object that was not found were not there."""
    matched = each["iou"] > 0.5
    hits = matched.groupby(each["case"]).sum()
    missed = (~matched & (each["kind"] == kind)).groupby(each["case"]).sum()
    f1 = totals.set_index("case")["f1"]
    # 2 hits / (true + found), from which those that were missed go.
    return (2 * hits / (2 * hits / f1 - missed)).where(f1 > 0, 0.0)


def _beside(value: float, goal: float | None, most: bool = False) -> str:
    if goal is None or np.isnan(value):
        return f"{value:.2f}"
    # As the table shows it: nobody sees the third digit.
    shown = round(float(value), 2)
    met = shown <= goal if most else shown >= goal
    return f"{shown:.2f} (goal {goal:.2f}{'' if met else ', missed'})"


def ablations(reports: dict[str, Report], method: str) -> pd.DataFrame:
    """Return by how much F1 and VOI change where one stage is taken out, by family.

    Parameters
    ----------
    reports : dict of str to Report
        By family.
    method : str
        The whole one.
    """
    columns = {}
    for name, report in reports.items():
        totals = pd.DataFrame(report.totals)
        means = totals.groupby("method", sort=False)[["f1", "voi", "seconds"]].mean()
        less = means[means.index.str.startswith("without ")] - means.loc[method]
        columns[FAMILIES[name].title] = [
            f"{row.f1:+.3f} / {row.voi:+.3f}" for row in less.itertuples()
        ]
        names = less.index.str.removeprefix("without ")
    return pd.DataFrame(columns, index=names) if columns else pd.DataFrame()
