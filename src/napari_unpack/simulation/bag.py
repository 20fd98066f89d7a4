"""A simulated bag with its ground truth."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from napari_unpack.geometry.axes import checked_spacing, is_integer, triple
from napari_unpack.simulation.packing import Packing, Record
from napari_unpack.simulation.planning import plan, trifle
from napari_unpack.simulation.projection import ProjectionScanner
from napari_unpack.simulation.scanner import Scanner
from napari_unpack.simulation.shell import Shell
from napari_unpack.tasks import Progress, no_progress

SMALLEST_SHAPE = 24
"""Voxels of the shortest edge: in less, shell and margins leave no room for things."""

MOST_OBJECTS = 2000
"""Far below `nestling.WALL`, the label that means no room."""

VAIN_TRIES = 5
"""Small things that find no place before the bag counts as full."""


@dataclass(frozen=True, eq=False)
class Bag:
    """A scanned bag and what is known to be in it.

    Parameters
    ----------
    volume : (Z, Y, X) ndarray of uint16
        CT number + 1000, clipped to [0, 32000].
    labels : (Z, Y, X) ndarray of uint16
        Object IDs from 1, 0 background, which the bag's own shell is. An object's hollow
        belongs to it where it is closed.
    spacing : (float, float, float) of mm, z y x
    objects : pandas.DataFrame
        One row an object, indexed by `id`: name, kind, material (what it mostly is), parent
        (ID of the object that it lies in, 0 for none), depth (how many objects it lies in),
        voxels, mass_g.
    """

    volume: NDArray[np.uint16]
    labels: NDArray[np.uint16]
    spacing: tuple[float, float, float]
    objects: pd.DataFrame


def simulate_bag(
    seed: int = 0,
    shape: Sequence[int] = (160, 176, 256),
    count: int = 30,
    spacing: Sequence[float] = (1.0, 1.0, 1.0),
    progress: Progress | None = None,
    scanner: Scanner | ProjectionScanner | None = None,
    table: bool = False,
    fidelity: str = "image",
) -> Bag:
    """Pack a bag and scan it.

    Parameters
    ----------
    seed : int
        The same seed gives the same bag.
    shape : (int, int, int)
        Of the volume, z y x, at least 24 each. Sizes of objects follow it. Things fall along
        +y, so -y is up.
    count : int
        How many objects, those inside others included. If so many find no room there are
        fewer, as the table of objects tells.
    spacing : (float, float, float) of mm, z y x
    progress : callable, optional
        Called with a fraction in [0, 1] and a text; raising inside it cancels.
    scanner : Scanner, optional
        How it is scanned; by default `Scanner()` or `ProjectionScanner()`, as `fidelity` says.
    table : bool
        Whether the bag lies on a table, which is background.
    fidelity : {"image", "projection"}
        Whether blur, noise and streaks are added to the picture, in seconds, or come of
        photons counted along rays, which takes several times as long. A scanner given decides.

    Raises
    ------
    ValueError
        If an argument is not as described, which the sentence names, or no object finds room.

    Notes
    -----
    Objects are modelled from signed distances and
    fall one after another on a height field, so that no two overlap and each rests on another
    or on the bag's floor. Time is about linear in the voxels.
    """
    size, mm = _checked(seed, shape, count, spacing)
    if fidelity not in ("image", "projection"):
        raise ValueError(f"fidelity must be 'image' or 'projection', got {fidelity!r}")
    # One generator for the whole bag: a draw added anywhere changes every bag of every seed.
    rng = np.random.default_rng(seed)
    report = progress or no_progress
    report(0.0, "Choosing what to pack")
    shell = Shell.around(size, table)
    packing = Packing.empty(size, shell.room(size), mm)
    orders = plan(rng, int(count), size, mm)
    for done, order in enumerate(orders):
        report(0.05 + 0.75 * done / len(orders), f"Packing: {order.kind.name}")
        packing.add(order, rng)
    # The plan counted on contents that may have found no room, so small things make up for them.
    in_vain = 0
    while len(packing.records) < count and in_vain < VAIN_TRIES:
        in_vain += not packing.add(trifle(rng, size, mm), rng)
    if not packing.records:
        raise ValueError(
            f"no object found room: shape {size} of voxels of {triple(mm)} mm is too small for any"
        )
    # Densities are added up, and the room kept things out of the fabric.
    report(0.8, "Scanning the bag")
    shell.paint(packing.density)
    chosen = scanner or (ProjectionScanner() if fidelity == "projection" else Scanner())
    voxel = triple(mm)
    volume = chosen.scan(packing.density, rng, voxel)
    report(1.0, "The bag is packed")
    # Only now: the walls kept things in the room while they nestled.
    labels = packing.opened()
    return Bag(volume, labels, voxel, _table(packing.records, labels))


def _table(records: list[Record], labels: NDArray[np.uint16]) -> pd.DataFrame:
    voxels = np.bincount(labels.ravel(), minlength=len(records) + 1)[1:]
    # Containers stand before their contents, so a parent's depth is known when it is needed.
    depth = [0]
    for record in records:
        depth.append(depth[record.parent] + 1 if record.parent else 0)
    total, seen = Counter(record.name for record in records), Counter[str]()
    names = []
    for record in records:
        seen[record.name] += 1
        number = f" {seen[record.name]}" if total[record.name] > 1 else ""
        names.append(record.name.capitalize() + number)
    return pd.DataFrame(
        {
            "name": names,
            "kind": [record.kind for record in records],
            "material": [record.material for record in records],
            "parent": np.array([record.parent for record in records], np.int64),
            "depth": np.array(depth[1:], np.int64),
            "voxels": voxels.astype(np.int64),
            "mass_g": [round(record.mass_g, 2) for record in records],
        },
        index=pd.RangeIndex(1, len(records) + 1, name="id"),
    )


def _checked(
    seed: int, shape: Sequence[int], count: int, spacing: Sequence[float]
) -> tuple[tuple[int, int, int], NDArray[np.float64]]:
    # True is an int to Python, but as a seed it is a slip.
    if not is_integer(seed) or seed < 0:
        raise ValueError(f"seed must be a whole number of 0 or more, got {seed!r}")
    size = np.asarray(shape)
    if size.shape != (3,) or size.dtype.kind not in "iu" or (size < SMALLEST_SHAPE).any():
        raise ValueError(
            f"shape must be three whole numbers (z, y, x) of {SMALLEST_SHAPE} or more, "
            f"got {shape!r}"
        )
    if not is_integer(count):
        raise ValueError(f"count must be a whole number, got {count!r}")
    if not 1 <= count <= MOST_OBJECTS:
        raise ValueError(f"count must be from 1 to {MOST_OBJECTS}, got {count!r}")
    return (int(size[0]), int(size[1]), int(size[2])), checked_spacing(spacing)
