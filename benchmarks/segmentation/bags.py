"""The volumes with known objects that segmentations are measured on."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmarks.second_generator import second_bag
from napari_unpack.simulation import simulate_bag

HELD_OUT = 9001
"""First of the seeds that nobody may tune anything on."""

STORED = {
    "dense": ("dense_a", "dense_b"),
    "pelvis": ("pelvis_a", "pelvis_b"),
    "cells": ("cells",),
}
"""Volumes in files: bags of a public simulator of scanners with two energies, metals up to 60 mm
among them; broken pelves, scanned; and nuclei under a microscope (PlantSeg)."""

LIQUIDS = frozenset({"water", "ethanol", "cosmetic"})
METALS = frozenset({"steel", "steel sheet", "brass", "aluminium", "copper strands"})
SHEETS = frozenset({"sweater", "trousers", "scarf", "belt"})


@dataclass(frozen=True, eq=False)
class Case:
    """One volume and its truth.

    Parameters
    ----------
    name : str
        Family and seed.
    volume : (Z, Y, X) ndarray
        Density.
    labels : (Z, Y, X) ndarray of int
        True object IDs.
    spacing : (float, float, float)
        mm, z y x.
    kinds, groups : pandas.Series
        By ID: kind of object; bulk, sheet, liquid or metal.
    ignored : (Z, Y, X) ndarray of bool, optional
        What is neither an object nor nothing, such as a tray: what is found there does not count.
    """

    name: str
    volume: NDArray[Any]
    labels: NDArray[np.integer[Any]]
    spacing: tuple[float, float, float]
    kinds: pd.Series
    groups: pd.Series
    ignored: NDArray[np.bool_] | None = None


def cases(family: str, count: int, first: int = HELD_OUT) -> Iterator[Case]:
    """Yield the volumes of a family.

    Parameters
    ----------
    family : {"first", "second", "projection"} or one of `STORED`
        The package's own generator; the second, which shares no code with it; the first scanned
        by rays; and volumes in files.
    count : int
        How many volumes.
    first : int
        Seed of the first; of those in files its place.

    Raises
    ------
    FileNotFoundError
        If the files are not here.
    """
    if family in STORED:
        for name in STORED[family][first : first + count]:
            yield _stored(name)
        return
    for seed in range(first, first + count):
        if family == "second":
            second = second_bag(seed)
            kinds, groups = second.objects.kind, second.objects.group
            yield Case(
                f"second {seed}", second.volume, second.labels, second.spacing, kinds, groups
            )
            continue
        bag = _scanned_by_rays(seed) if family == "projection" else simulate_bag(seed=seed)
        table = bag.objects
        yield Case(
            f"{family} {seed}", bag.volume, bag.labels, bag.spacing, table.kind, groups_of(table)
        )


def groups_of(objects: pd.DataFrame) -> pd.Series:
    """Return bulk, sheet, liquid or metal of each object that the first generator made."""
    group = pd.Series("bulk", index=objects.index)
    group[objects.material.isin(LIQUIDS)] = "liquid"
    group[objects.material.isin(METALS)] = "metal"
    group[objects.kind.isin(SHEETS)] = "sheet"
    return group


def _scanned_by_rays(seed: int) -> Any:
    return simulate_bag(seed=seed, shape=(96, 160, 160), count=22, fidelity="projection")


def _stored(name: str) -> Case:
    path = Path(os.environ.get("UNPACK_DATA", "data")) / f"{name}.npz"
    if not path.exists():
        raise FileNotFoundError(
            f"no {path}: set UNPACK_DATA to a folder that has {path.name} (volume, labels, "
            "spacing, and ignore where there is what does not count)"
        )
    with np.load(path) as data:
        labels = np.asarray(data["labels"])
        ids = np.unique(labels)[1:]
        z, y, x = (float(v) for v in data["spacing"])
        ignored = np.asarray(data["ignore"]) > 0 if "ignore" in data.files else None
        kinds = pd.Series(name.partition("_")[0], index=ids)
        bulk = pd.Series("bulk", index=ids)
        return Case(name, np.asarray(data["volume"]), labels, (z, y, x), kinds, bulk, ignored)
