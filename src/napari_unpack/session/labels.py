"""What a session's labels hold, derived once and followed from edit to edit.

The table of objects: facts by ID, completed from the volume where nobody gave them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from napari_unpack.geometry.boxes import LabelBoxes, label_boxes
from napari_unpack.geometry.grow_labels import grow_labels
from napari_unpack.segmentation.repair import LabelEdit

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


FRINGE = 2
"""Voxels that display labels grow."""

Judge = Callable[[NDArray[np.bool_], NDArray[Any], tuple[int, int, int]], float]


@dataclass(frozen=True, eq=False)
class Edit:
    """One change of the labels, and what it did to the objects; a chain, the latest last.

    Parameters
    ----------
    earlier : Edit, optional
        What was changed before.
    change : LabelEdit
        Voxels.
    boxes : (LabelBoxes, LabelBoxes)
        Of the objects touched, before and after; who is in one only has gone or come.
    facts : (DataFrame, DataFrame)
        Their rows in the table of objects, before and after.
    """

    earlier: Edit | None
    change: LabelEdit
    boxes: tuple[LabelBoxes, LabelBoxes]
    facts: tuple[pd.DataFrame, pd.DataFrame]


@dataclass(eq=False)
class LabelData:
    """Labels and all that follows from them.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of uint16
        Object IDs; never written to.
    boxes : LabelBoxes
    facts : DataFrame
        By ID.
    edit : Edit, optional
        The last change made to them.

    Notes
    -----
    Of the contents before, the arrays are kept: to copy those of a large volume takes a second,
    and the command most often undone is the last.
    """

    labels: NDArray[np.uint16]
    boxes: LabelBoxes
    facts: pd.DataFrame
    edit: Edit | None = None
    _display: NDArray[np.uint16] | None = field(default=None, repr=False)
    _kept: LabelData | None = field(default=None, repr=False)

    @property
    def display(self) -> NDArray[np.uint16]:
        """Labels grown into the fringe around objects, for pictures; (Z, Y, X) uint16."""
        if self._display is None:
            self._display = grow_labels(self.labels, FRINGE)
        return self._display

    def at(self, edit: Edit | None) -> LabelData:
        """Return the contents at another place of the chain of edits; exact both ways."""
        found = self
        back, forth = _way(self.edit, edit)
        arrays = self._arrays_at(edit) if len(back) + len(forth) == 1 else None
        for step in back:
            found = found._moved(step, 1, 0, step.earlier, arrays)
        for step in forth:
            found = found._moved(step, 0, 1, step, arrays)
        return found

    def knows(self, edit: Edit | None) -> bool:
        """Return whether `at` that place copies no volume."""
        return edit is self.edit or self._arrays_at(edit) is not None

    def keep(self, before: LabelData) -> None:
        """Keep the arrays of other contents, and of no others."""
        self._kept, before._kept = before, None

    @property
    def arrays(self) -> tuple[NDArray[np.uint16], ...]:
        """All label arrays that are kept."""
        return (self.labels,) if self._kept is None else (self.labels, self._kept.labels)

    def _arrays_at(
        self, edit: Edit | None
    ) -> tuple[NDArray[np.uint16], NDArray[np.uint16] | None] | None:
        kept = self._kept
        if kept is None or kept.edit is not edit:
            return None
        return kept.labels, kept._display

    def edited(
        self,
        change: LabelEdit,
        volume: NDArray[Any],
        spacing: NDArray[np.float64],
        judge: Judge,
        given_ids: NDArray[np.int64] | None = None,
    ) -> LabelData:
        """Return the contents after a change of voxels; the touched objects are measured anew.

        Parameters
        ----------
        change : LabelEdit
            From these labels.
        volume : (Z, Y, X) ndarray
            Density.
        spacing : (3,) ndarray of float64
            mm.
        judge : callable
            Given mask, density and first voxel of an object's box, returns its confidence.
        given_ids : (N + 1,) ndarray of int64, optional
            By ID, the one people know it by.
        """
        touched = np.array(sorted(change.touched))
        old = _rows(self.boxes, touched)
        labels = change.apply(self.labels).astype(np.uint16, copy=False)
        low = np.array([part.start for part in change.box])
        high = np.array([part.stop for part in change.box])
        if len(old.ids):
            low = np.minimum(low, old.lower.min(axis=0))
            high = np.maximum(high, old.upper.max(axis=0))
        box = tuple(slice(int(a), int(b)) for a, b in zip(low, high, strict=True))
        part = np.where(np.isin(labels[box], touched), labels[box], 0).astype(np.uint16)
        local = label_boxes(part)
        new = LabelBoxes(local.ids, local.lower + low, local.upper + low, local.counts)
        before = self.facts.loc[old.ids]
        after = before.iloc[:0]
        if len(new.ids):
            after = object_table(volume[box], part, local, spacing, None, given_ids)
            for k, axis in enumerate("zyx"):
                after[axis] += low[k] * spacing[k]
            after = _completed(after, before, change, self.facts)
            if self.facts["confidence"].notna().any():
                after["confidence"] = [
                    judge(part[own] == i, volume[box][own], tuple(int(s.start) for s in own))  # type: ignore[arg-type]
                    for i, own in ((int(i), local.slices(int(i))) for i in local.ids)
                ]
        edit = Edit(self.edit, change, (old, new), (before, after))
        return self._moved(edit, 0, 1, edit, (labels, None))

    def _moved(
        self,
        step: Edit,
        source: int,
        target: int,
        edit: Edit | None,
        arrays: tuple[NDArray[np.uint16], NDArray[np.uint16] | None] | None = None,
    ) -> LabelData:
        import pandas as pd

        change = step.change if target else step.change.reverse()
        if arrays is None:
            arrays = change.apply(self.labels).astype(np.uint16, copy=False), None
        labels, display = arrays
        gone, come = step.boxes[source], step.boxes[target]
        kept = ~np.isin(self.boxes.ids, gone.ids)
        ids = np.concatenate([self.boxes.ids[kept], come.ids])
        order = np.argsort(ids)
        boxes = LabelBoxes(
            ids[order],
            *(
                np.concatenate([getattr(self.boxes, name)[kept], getattr(come, name)])[order]
                for name in ("lower", "upper", "counts")
            ),
        )
        rest = self.facts.drop(index=step.facts[source].index)
        rows = [table for table in (rest, step.facts[target]) if len(table)]
        facts = pd.concat(rows).sort_index().rename_axis("id") if rows else rest
        if display is None and self._display is not None:
            display = _regrown(self._display, labels, change.box)
        return LabelData(labels, boxes, facts, edit, display)


def touched_between(before: Edit | None, after: Edit | None) -> frozenset[int]:
    """Return the objects touched by the edits between two places of the chain."""
    back, forth = _way(before, after)
    return frozenset(i for step in (*back, *forth) for i in step.change.touched)


def _way(before: Edit | None, after: Edit | None) -> tuple[list[Edit], list[Edit]]:
    """Return the edits to take back, the latest first, and those to make then."""
    here, there = _chain(before), _chain(after)
    common = sum(1 for a, b in zip(here, there, strict=False) if a is b)
    return here[common:][::-1], there[common:]


def _chain(edit: Edit | None) -> list[Edit]:
    found = []
    while edit is not None:
        found.append(edit)
        edit = edit.earlier
    return found[::-1]


def _rows(boxes: LabelBoxes, ids: NDArray[np.int64]) -> LabelBoxes:
    rows = np.flatnonzero(np.isin(boxes.ids, ids))
    return LabelBoxes(boxes.ids[rows], boxes.lower[rows], boxes.upper[rows], boxes.counts[rows])


def _completed(
    after: pd.DataFrame, before: pd.DataFrame, change: LabelEdit, facts: pd.DataFrame
) -> pd.DataFrame:
    """Return measured rows with what cannot be measured taken from the objects they came from."""
    import pandas as pd

    sources = {}
    for object_id in after.index:
        source = object_id if object_id in before.index else _origin(change, int(object_id))
        if source in before.index:
            sources[object_id] = source
    for column in facts.columns:
        if column in after and column != "name":
            continue
        values = [
            before.at[sources[i], column] if i in sources else after[column].get(i)
            if column in after else None
            for i in after.index
        ]  # fmt: skip
        after[column] = pd.Series(values, after.index, dtype=object).infer_objects()
    for object_id, source in sources.items():
        if source != object_id:
            after.at[object_id, "name"] = f"{before.at[source, 'name']}, part"
    return after[facts.columns.tolist()]


def _origin(change: LabelEdit, object_id: int) -> int:
    """Return the object most of a new one's voxels were taken from, 0 for the background."""
    values, counts = np.unique(change.before[change.after == object_id], return_counts=True)
    return int(values[counts.argmax()]) if len(values) else 0


def _regrown(
    display: NDArray[np.uint16], labels: NDArray[np.uint16], box: tuple[slice, ...]
) -> NDArray[np.uint16]:
    """Return display labels brought up to date where labels have changed."""
    outer, inner, cut = [], [], []
    for part, size in zip(box, labels.shape, strict=True):
        low, high = max(part.start - FRINGE, 0), min(part.stop + FRINGE, size)
        first = max(low - FRINGE, 0)
        outer.append(slice(first, min(high + FRINGE, size)))
        inner.append(slice(low, high))
        cut.append(slice(low - first, high - first))
    grown = display.copy()
    grown[tuple(inner)] = grow_labels(labels[tuple(outer)], FRINGE)[tuple(cut)]
    return grown
