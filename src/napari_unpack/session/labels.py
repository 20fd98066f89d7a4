"""A session's labels and what follows from them: boxes, the table of objects, and their edits."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import triple
from napari_unpack.geometry.boxes import LabelBoxes, label_boxes
from napari_unpack.geometry.grow_labels import grow_labels
from napari_unpack.kernels import njit
from napari_unpack.segmentation.common.adjacency import find_neighbours
from napari_unpack.segmentation.repair import LabelEdit
from napari_unpack.session.validation import checked_whole

if TYPE_CHECKING:
    import pandas as pd


RATIO = "isoperimetric_ratio"
"""The column of surface over volume (1/mm) that segmentation gives, and no session asks for."""


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
        Indexed by ID. Where the index has no name and is not all of the labels, a column `id` of
        whole numbers is taken for the IDs if it has each once and one of them is a label; or else
        `label`, as scikit-image has it. Its other columns are kept, its rows of other objects
        dropped.
    given_ids : (M,) ndarray of int64, optional
        By ID, the one people know it by: in the index of `given`, in names, and in a column
        `label` of the table, unless the given one has another. None where that is the ID itself.

    Returns
    -------
    DataFrame
        Indexed by `id`, one row an object, with at least name, voxels, volume_mm3,
        mean_density, confidence, z, y, x (centre of mass, mm).

    Raises
    ------
    ValueError
        If the given table holds an ID twice or counts its rows from 0, a column's name is not one
        or not its own, or words stand where numbers belong.
    TypeError
        If the given one is no table.
    """
    import pandas as pd

    if given is not None and not isinstance(given, pd.DataFrame):
        raise TypeError(
            f"objects must be a DataFrame with a row for each object, got {type(given).__name__}: "
            "pandas.DataFrame(objects) makes one of columns"
        )

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
    if given.columns.nlevels > 1 or not given.columns.is_unique:
        raise ValueError(
            f"objects must have one name for each column, and each once, got {[*given.columns]}"
        )
    given = _by_id(given, known_by)
    known = _plain_columns(given.reindex(known_by).set_index(found.index))
    if given_ids is not None and not _says_ids(known, known_by):
        del found["label"]
    # Ground truth of simulated bags says kinds and no names.
    if "name" not in known and "kind" in known:
        found["name"] = [
            f"{(isinstance(kind, str) and _with_capital(one_line(kind))) or 'Object'} {i}"
            for i, kind in zip(known_by, known["kind"], strict=True)
        ]
    for column in found:
        if column in known:
            # What is given wins: people and the segmentation may know better.
            given_column = _names(known[column]) if column == "name" else _numbers(known[column])
            found[column] = given_column.where(given_column.notna(), found[column])
    extra = [column for column in known if column not in found]
    return found.join(known[extra])


def _by_id(table: pd.DataFrame, ids: NDArray[np.int64]) -> pd.DataFrame:
    """Return a given table with the IDs of its rows, each once, as its index."""
    # A person's own columns of these names stay where the index is of the objects; that of another
    # session counts its objects, and has the IDs that people know them by in `label`.
    named, known = table.index.name is not None, table.index.isin(ids)
    if set(table.index) != set(ids.tolist()) and not (named and known.any()):
        for column in ("id", "label"):
            if column in table and _may_be_ids(table[column], ids):
                other = (table[column].to_numpy() != table.index.to_numpy()).any()
                if column == "label" and known.all() and other:
                    raise ValueError(
                        "objects must say where its IDs are, got some in its index and others in "
                        "its column 'label': use objects.set_index('label'), or name the index "
                        "'id' if they are there"
                    )
                return table.dropna(subset=[column]).set_index(column)
        if 0 in table.index:
            raise ValueError(
                "objects must have each ID once in its index, or its column 'id' or 'label', got "
                "rows counted from 0, which is no object: use objects.set_index(...), or leave "
                "out the row 0 if it is the background's"
            )
    if not table.index.is_unique:
        raise ValueError("objects must have each ID once in its index, or its column 'id'")
    return table


def _may_be_ids(column: pd.Series, ids: NDArray[np.int64]) -> bool:
    from pandas.api.types import is_bool_dtype, is_numeric_dtype

    # Whole numbers beside missing ones are floats.
    numbers = column.dropna()
    if not is_numeric_dtype(numbers) or is_bool_dtype(numbers) or not (numbers % 1 == 0).all():
        return False
    return bool(numbers.is_unique and numbers.isin(ids).any())


def _says_ids(table: pd.DataFrame, ids: NDArray[np.int64]) -> bool:
    """Tell whether the column `label`, where there is one, is of IDs and not a person's own."""
    own = table.get("label")
    return own is None or bool((own.isna() | (own == ids)).all())


def _names(column: pd.Series) -> pd.Series:
    """Return names as text, NaN for blank ones.

    Whole numbers that stood beside missing ones have no fraction.
    """
    return column.map(
        lambda name: (
            str(int(name))
            if isinstance(name, float) and name % 1 == 0
            else one_line(str(name)) or np.nan
        ),
        na_action="ignore",
    ).infer_objects()


def one_line(name: str) -> str:
    """Return a name as tables and sentences have room for it: white space is one space."""
    return " ".join(name.split())


def _with_capital(words: str) -> str:
    """Return words with their first letter raised and the others as they are."""
    return words[:1].upper() + words[1:]


def _numbers(column: pd.Series) -> pd.Series:
    """Return a column of numbers."""
    import pandas as pd

    if pd.api.types.is_numeric_dtype(column.dtype):
        return column
    numbers = pd.to_numeric(column, errors="coerce")
    words = column[numbers.isna() & column.notna()]
    if len(words):
        raise ValueError(
            f"column '{column.name}' of objects must hold numbers, got {words.iloc[0]!r}"
        )
    return numbers


def _plain_columns(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table without types of pandas' own: names change, and files hold plain values."""
    import pandas as pd

    plain = {}
    for name in table:
        column = table[name]
        if pd.api.types.is_extension_array_dtype(column.dtype):
            number = pd.api.types.is_numeric_dtype(column.dtype)
            missing = column.isna()
            column = column.astype(object).where(~missing, np.nan if number else None)
            column = (
                column.astype(np.float64) if number and missing.any() else column.infer_objects()
            )
        plain[name] = column
    return pd.DataFrame(plain, index=table.index)


def _measure(
    volume: NDArray[np.generic], labels: NDArray[np.uint16], top: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return by ID the mean density (top + 1,) and the centre of mass (top + 1, 3) in voxels."""
    # By ID: voxels, sums of z, y, x, sum of finite densities, and how many those are.
    numbers = np.zeros((top + 1, 6))
    # Single precision where it holds every number: one far from 0 would be rounded by thousands.
    dtype = np.float32 if np.can_cast(volume.dtype, np.float32) else np.float64
    # Plane by plane: the whole scan as such numbers would be a second one in memory.
    for z in range(labels.shape[0]):
        _add_plane(np.asarray(volume[z]).astype(dtype, copy=False), labels[z], z, numbers)
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


# Voxels that display labels grow: the fringe of partial volume around an object.
FRINGE = 2

Confidence = Callable[[NDArray[np.bool_], tuple[slice, slice, slice]], float]
"""Given an object's mask in its box, and that in the volume, how sure it is one object."""


@dataclass(frozen=True, eq=False)
class Rating:
    """By what all confidences of a table are; compared as objects.

    Parameters
    ----------
    oracle : callable, optional
        Returns the confidence of a `segmentation.Region`; None is the one that ships.
    """

    oracle: Callable[[Any], float] | None


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
        Of the objects touched, before and after; what is in one only has gone or come.
    facts : (DataFrame, DataFrame)
        Their rows in the table of objects, before and after.
    rating : Rating, optional
        Of these rows.
    """

    earlier: Edit | None
    change: LabelEdit
    boxes: tuple[LabelBoxes, LabelBoxes]
    facts: tuple[pd.DataFrame, pd.DataFrame]
    rating: Rating | None = None


@dataclass(frozen=True, eq=False)
class LabelData:
    """Labels and all that follows from them; an edit makes new ones.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of uint16
        Object IDs; never written to.
    boxes : LabelBoxes
    facts : DataFrame
        By ID.
    given_ids : (N + 1,) ndarray of int64, optional
        By ID, the one people know it by; None where that is the ID itself. It only grows, so
        that an edit taken back and made again names its objects alike.
    largest_id : int
        Of these labels and those before. Tables by ID never shrink: a worker may still cast
        labels that have been edited since.
    most_objects : int
        Of these labels and those before; slots are planned for up to so many.
    edit : Edit, optional
        The last change made to them.
    revision : int
        Counts the changes, undone ones too: no two labels of a session share one.
    previous : LabelData, optional
        Those of the revision before. To copy the arrays of a large volume takes a second, and
        the command most often undone is the last.
    rating : Rating, optional
        Of the confidences; None where they are as they were given.
    """

    labels: NDArray[np.uint16]
    boxes: LabelBoxes
    facts: pd.DataFrame
    given_ids: NDArray[np.int64] | None = None
    largest_id: int = 0
    most_objects: int = 0
    edit: Edit | None = None
    revision: int = 0
    previous: LabelData | None = field(default=None, repr=False)
    rating: Rating | None = None
    _display: NDArray[np.uint16] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        """Let largest_id and most_objects hold for these labels too."""
        object.__setattr__(
            self, "largest_id", max(self.largest_id, *self.boxes.ids[-1:].tolist(), 0)
        )
        object.__setattr__(self, "most_objects", max(self.most_objects, len(self.boxes.ids)))

    @cached_property
    def ids(self) -> tuple[int, ...]:
        """Every object, ascending."""
        return tuple(int(i) for i in self.boxes.ids)

    @cached_property
    def known(self) -> frozenset[int]:
        """Every object."""
        return frozenset(self.ids)

    @property
    def display(self) -> NDArray[np.uint16]:
        """Labels grown into the fringe around objects, for pictures; (Z, Y, X) uint16."""
        if self._display is None:
            # The one thing worked out late: it takes a second, and much needs no picture.
            object.__setattr__(self, "_display", grow_labels(self.labels, FRINGE))
        assert self._display is not None
        return self._display

    def label_of(self, object_id: int) -> int:
        """Return the ID people know an object by; of one that is gone, the one it had.

        Raises
        ------
        TypeError
            If it is no whole number.
        ValueError
            If it is negative, or larger than that of every object there was.
        """
        object_id = checked_whole(object_id, "object_id")
        if object_id > self.largest_id:
            raise ValueError(f"object_id must be an object of this session, got {object_id}")
        return object_id if self.given_ids is None else int(self.given_ids[object_id])

    @property
    def unrated(self) -> tuple[int, ...]:
        """Objects that `rating` is still to be asked for; none where confidences were given."""
        if self.rating is None:
            return ()
        return tuple(int(i) for i in self.facts.index[self.facts["confidence"].isna()])

    def visible(self, ids: Iterable[int]) -> NDArray[np.bool_]:
        """Return the (largest_id + 1,) table that is True for some objects."""
        table = np.zeros(self.largest_id + 1, dtype=np.bool_)
        table[list(ids)] = True
        return table

    def at(self, edit: Edit | None) -> LabelData:
        """Return the labels at another place of the chain of edits; exact both ways."""
        found, way = self, _way(self.edit, edit)
        # Several steps away it would stand for the labels of every step between, too.
        kept = self.previous if self.knows(edit) and len(way) == 1 else None
        for step, forth in way:
            found = found._moved(step, forth, kept)
        return found

    def seen_from(self, now: LabelData) -> LabelData:
        """Return these labels, worked out beforehand, with what was told of objects since.

        Parameters
        ----------
        now : LabelData
            Of the revision that they were worked out from.
        """
        for step, forth in _way(now.edit, self.edit):
            now = replace(now, facts=now.facts_after(step, forth))
        return replace(self, facts=now.facts)

    def knows(self, edit: Edit | None) -> bool:
        """Return whether `at` that place copies no volume."""
        return edit is self.edit or (self.previous is not None and self.previous.edit is edit)

    def after(self, previous: LabelData) -> LabelData:
        """Return these labels with those before kept, and of them no earlier ones."""
        return replace(self, previous=replace(previous, previous=None))

    def edited(
        self,
        change: LabelEdit,
        volume: NDArray[Any],
        spacing: NDArray[np.float64],
        confidence: Confidence,
        given_ids: NDArray[np.int64] | None = None,
    ) -> LabelData:
        """Return the labels after a change of voxels; the touched objects are measured anew.

        Parameters
        ----------
        change : LabelEdit
            From these labels.
        volume : (Z, Y, X) ndarray
            Density.
        spacing : (3,) ndarray of float64
            mm.
        confidence : callable
            Given an object's mask in its box, and that in the volume, returns its confidence.
        given_ids : (N + 1,) ndarray of int64, optional
            By ID, the one people know it by, the new objects included.
        """
        touched = np.array(sorted(change.touched))
        old = _rows(self.boxes, touched)
        labels = change.apply(self.labels).astype(np.uint16, copy=False)
        # The whole of every object touched, not only what changed: it is measured anew as a whole.
        low = np.array([part.start for part in change.box])
        high = np.array([part.stop for part in change.box])
        if len(old.ids):
            low = np.minimum(low, old.lower.min(axis=0))
            high = np.maximum(high, old.upper.max(axis=0))
        box = tuple(slice(int(a), int(b)) for a, b in zip(low, high, strict=True))
        # Others that reach into the box are cut off there, and would be measured wrong.
        part = np.where(np.isin(labels[box], touched), labels[box], 0).astype(np.uint16)
        local = label_boxes(part)
        new = LabelBoxes(local.ids, local.lower + low, local.upper + low, local.counts)
        before = self.facts.loc[old.ids]
        after = before.iloc[:0]
        if len(new.ids):
            after = object_table(volume[box], part, local, spacing, None, given_ids)
            for k, axis in enumerate("zyx"):
                after[axis] += low[k] * spacing[k]
            if RATIO in self.facts:
                # Of an object that is no more what it was, the one measured before is wrong.
                surface = find_neighbours(part.astype(np.int32), triple(spacing)).surface
                after[RATIO] = surface[new.ids] / after["volume_mm3"]
            known_by = None if self.given_ids is None else self.given_ids[self.boxes.ids]
            if known_by is not None and not _says_ids(self.facts, known_by):
                del after["label"]
            after = _completed(after, before, change, self.facts)
            # Where none is known, a column with a few numbers would seem to rate the others.
            if self.facts["confidence"].notna().any():
                after["confidence"] = [
                    confidence(part[local.slices(i)] == i, new.slices(i)) for i in new.ids.tolist()
                ]
        edit = Edit(self.edit, change, (old, new), (before, after), self.rating)
        named = self if given_ids is None else replace(self, given_ids=given_ids)
        return named._moved(edit, True, None, labels)

    def rescored(self, scores: Mapping[int, float], rating: Rating | None) -> LabelData:
        """Return them with another confidence of every object; NaN where none is given.

        Parameters
        ----------
        scores : mapping of int to float
        rating : Rating, optional
            What gave them.
        """
        found = [float(scores.get(i, float("nan"))) for i in self.ids]
        return replace(self, facts=self.facts.assign(confidence=found), rating=rating)

    def renamed(self, names: Mapping[int, str]) -> LabelData:
        """Return them with other names that objects came with."""
        column = self.facts["name"].copy()
        column.loc[list(names)] = list(names.values())
        return replace(self, facts=self.facts.assign(name=column))

    def facts_after(self, step: Edit, forth: bool = True) -> pd.DataFrame:
        """Return the table of objects after an edit of these labels.

        Parameters
        ----------
        step : Edit
        forth : bool
            False where it is taken back.
        """
        gone, come = step.facts if forth else step.facts[::-1]
        # Another model's confidence would stand beside this one's: it is asked for again.
        if step.rating is not self.rating:
            come = come.assign(confidence=np.nan)
        found = _exchanged(self.facts, gone, come)
        # A new object without a value had made whole numbers floats: undo brings back what was.
        # Scores are those of now.
        return found if forth else found.astype(come.dtypes.drop("confidence").to_dict())

    def _moved(
        self,
        step: Edit,
        forth: bool,
        kept: LabelData | None,
        labels: NDArray[np.uint16] | None = None,
    ) -> LabelData:
        change = step.change if forth else step.change.reverse()
        display = None
        if kept is not None:
            # The very arrays of then: nothing is copied.
            labels, display = kept.labels, kept._display
        elif labels is None:
            labels = change.apply(self.labels).astype(np.uint16, copy=False)
        gone, come = step.boxes if forth else step.boxes[::-1]
        stay = ~np.isin(self.boxes.ids, gone.ids)
        ids = np.concatenate([self.boxes.ids[stay], come.ids])
        order = np.argsort(ids)
        boxes = LabelBoxes(
            ids[order],
            *(
                np.concatenate([getattr(self.boxes, name)[stay], getattr(come, name)])[order]
                for name in ("lower", "upper", "counts")
            ),
        )
        if display is None and self._display is not None:
            # Growing all labels takes a second for a large volume.
            display = _regrown(self._display, labels, change.box)
        return replace(
            self,
            labels=labels,
            boxes=boxes,
            facts=self.facts_after(step, forth),
            edit=step if forth else step.earlier,
            revision=self.revision + 1,
            previous=None,
            _display=display,
        )


def _exchanged(facts: pd.DataFrame, gone: pd.DataFrame, come: pd.DataFrame) -> pd.DataFrame:
    """Return a table with some rows exchanged for others."""
    import pandas as pd

    rest = facts.drop(index=gone.index)
    # IDs of 64 bits beside missing ones stay whole, which they would not as floats.
    large = [
        name
        for name, column in facts.items()
        if column.dtype.kind in "iu" and come[name].hasnans and column.abs().max() > 2**53
    ]
    rest = rest.astype(dict.fromkeys(large, object))
    # Empty tables would turn whole numbers of the others into floats.
    rows = [table for table in (rest, come) if len(table)]
    return pd.concat(rows).sort_index().rename_axis("id") if rows else rest


def touched_between(before: Edit | None, after: Edit | None) -> frozenset[int]:
    """Return the objects touched by the edits between two places of the chain.

    Parameters
    ----------
    before, after : Edit, optional
        The places; None is the labels as they were given.
    """
    return frozenset(i for step, _ in _way(before, after) for i in step.change.touched)


def _way(before: Edit | None, after: Edit | None) -> list[tuple[Edit, bool]]:
    """Return the edits to take back (False), the latest first, and those to make then (True)."""
    here, there = _chain(before), _chain(after)
    # Edits are compared as objects: two that do the same are two.
    common = sum(1 for a, b in zip(here, there, strict=False) if a is b)
    back, forth = here[common:][::-1], there[common:]
    return [*((step, False) for step in back), *((step, True) for step in forth)]


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
        source = object_id if object_id in before.index else origin_of(change, int(object_id))
        if source in before.index:
            sources[object_id] = source
    for column in facts.columns:
        # Measured already; a name is inherited, as what was given is.
        if column in after and column != "name":
            continue
        # Nothing among numbers: with None in it a column could not be reckoned with any more.
        nothing = np.nan if pd.api.types.is_numeric_dtype(facts[column].dtype) else None
        values = [
            before.at[sources[i], column] if i in sources else after[column].get(i)
            if column in after else nothing
            for i in after.index
        ]  # fmt: skip
        after[column] = pd.Series(values, after.index, dtype=object).infer_objects()
    for object_id, source in sources.items():
        if source != object_id:
            after.at[object_id, "name"] = f"{before.at[source, 'name']}, part"
    return after[facts.columns.tolist()]


def origin_of(change: LabelEdit, object_id: int) -> int:
    """Return the object most of a new one's voxels were taken from, 0 for the background.

    Parameters
    ----------
    change : LabelEdit
    object_id : int
    """
    values, counts = np.unique(change.before[change.after == object_id], return_counts=True)
    return int(values[counts.argmax()]) if len(values) else 0


def _regrown(
    display: NDArray[np.uint16], labels: NDArray[np.uint16], box: tuple[slice, ...]
) -> NDArray[np.uint16]:
    """Return display labels brought up to date where labels have changed."""
    outer, inner, cut = [], [], []
    for part, size in zip(box, labels.shape, strict=True):
        # Growth reaches one fringe beyond a change, and depends on labels one fringe further.
        low, high = max(part.start - FRINGE, 0), min(part.stop + FRINGE, size)
        first = max(low - FRINGE, 0)
        outer.append(slice(first, min(high + FRINGE, size)))
        inner.append(slice(low, high))
        cut.append(slice(low - first, high - first))
    grown = display.copy()
    grown[tuple(inner)] = grow_labels(labels[tuple(outer)], FRINGE)[tuple(cut)]
    return grown
