"""The objects of a session as a Qt table model."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, TypeAlias

import numpy as np
from qtpy.QtCore import QAbstractTableModel, QModelIndex, QPersistentModelIndex, Qt
from qtpy.QtGui import QColor, QFont

from napari_unpack.session.errors import percent
from napari_unpack.widgets import notifications

Index: TypeAlias = QModelIndex | QPersistentModelIndex
SORT = Qt.ItemDataRole.UserRole
ID = Qt.ItemDataRole.UserRole + 1
STATE = Qt.ItemDataRole.UserRole + 2

Rgb = tuple[float, float, float]
_CELL = Qt.ItemFlag.ItemIsEnabled | Qt.ItemFlag.ItemIsSelectable
_NAMED = _CELL | Qt.ItemFlag.ItemIsEditable
_NO_COLOR: Rgb = (0.5, 0.5, 0.5)

STATE_WORDS = {
    "PACKED": "packed",
    "FLYING_OUT": "flying",
    "UNPACKED": "out",
    "FLYING_BACK": "flying",
    "INSPECTED": "alone",
    "HIDDEN": "hidden",
}


FREE, TOGETHER, FIRST = "free", "group", "first"
MARKS = {
    FREE: "Nothing blocks this object: it can be unpacked now.",
    TOGETHER: "Free together with those that hold it: they leave as one.",
    FIRST: "Must leave before the object that is to be revealed.",
}
"""What may be said of a packed object, and what it means."""


class Column(IntEnum):
    """The columns, left to right."""

    EYE = 0
    SWATCH = 1
    NAME = 2
    STATE = 3
    VOLUME = 4
    SIZE = 5
    DENSITY = 6
    CONFIDENCE = 7


TITLES = {
    Column.EYE: ("", "Shown or hidden: click an eye to change it."),
    Column.SWATCH: ("", "The object's hue in this view: click one to see that object alone."),
    Column.NAME: ("Name", "Double-click to rename."),
    Column.STATE: ("State", "Where the object is now."),
    Column.VOLUME: ("cm³", "Volume in cubic centimetres."),
    Column.SIZE: ("Size, mm", "Edges of the object's upright box, longest first, in mm."),
    Column.DENSITY: ("Density", "Mean density in the volume's own values."),
    Column.CONFIDENCE: ("Sure", "How sure the segmentation is that this is one whole object."),
}


@dataclass(frozen=True)
class _Facts:
    """What never changes about an object; `label` is the ID people know; cm³, mm."""

    id: int
    label: int
    volume: float
    edges: tuple[float, float, float]
    density: float
    confidence: float


@dataclass(frozen=True)
class _Live:
    """What may change about an object at any moment."""

    name: str
    state: str
    hue: float | None
    color: Rgb
    mark: str
    good: bool = False

    @property
    def words(self) -> str:
        return self.mark if self.mark and self.state == "PACKED" else STATE_WORDS[self.state]


class ObjectModel(QAbstractTableModel):
    """One row an object; `refresh` takes over states, hues and names from the session."""

    def __init__(self, parent: Any = None) -> None:
        super().__init__(parent)
        self._session: Any = None
        self._facts: list[_Facts] = []
        self._rows: dict[int, int] = {}
        self._live: list[_Live] = []
        self._tiny = False
        self._keys: dict[int, tuple[list[_Live], list[Any]]] = {}
        self._free: frozenset[int] = frozenset()
        self._first: frozenset[int] = frozenset()

    def load(self, session: Any) -> None:
        """Show the objects of a session, or nothing for None.

        Parameters
        ----------
        session : napari_unpack.Session or None
        """
        self.beginResetModel()
        self._session = session
        self._facts = [] if session is None else _facts_of(session)
        self._rows = {facts.id: row for row, facts in enumerate(self._facts)}
        self._free = self._first = frozenset()
        self._live = self._look()
        self._tiny = bool(self._facts) and max(f.volume for f in self._facts) < 1.0
        self.endResetModel()

    def refresh(
        self, free: Iterable[int] | None = None, first: Iterable[int] | None = None
    ) -> None:
        """Read states, hues and names anew; tell the view of the rows that changed only.

        Parameters
        ----------
        free : iterable of int, optional
            The objects that nothing blocks now, where that is known.
        first : iterable of int, optional
            Those that must leave before the one to be revealed.
        """
        if free is not None:
            self._free = frozenset(free)
        if first is not None:
            self._first = frozenset(first)
        before, self._live = self._live, self._look()
        columns = {"color": (Column.SWATCH, Column.SWATCH), "rest": (Column.EYE, Column.STATE)}
        for row, (old, new) in enumerate(zip(before, self._live, strict=True)):
            if old != new:
                only_color = (old.state, old.name, old.mark) == (new.state, new.name, new.mark)
                left, right = columns["color" if only_color else "rest"]
                if old.good != new.good:
                    left, right = Column.EYE, Column.STATE
                self.dataChanged.emit(self.index(row, left), self.index(row, right))

    def _look(self) -> list[_Live]:
        if self._session is None:
            return []
        states, hues = self._session.states, self._session.hues
        names = self._session.objects["name"].to_dict()
        colors = _colors(hues, self._session.tint_mode)
        good = self._session.examples
        groups = self._session.unpackable_groups()
        together = {i for group in groups if len(group) > 1 for i in group}

        def mark(object_id: int) -> str:
            if object_id in self._first:
                return FIRST
            if object_id not in self._free:
                return ""
            return TOGETHER if object_id in together else FREE

        return [
            _Live(
                str(names.get(f.id, "")),
                str(states[f.id].name) if f.id in states else "HIDDEN",
                float(hues[f.id]) % 1.0 if f.id in hues else None,
                colors.get(f.id, _NO_COLOR),
                mark(f.id),
                f.id in good,
            )
            for f in self._facts
        ]

    @property
    def knows_confidence(self) -> bool:
        """Whether the confidence of any object is known."""
        return any(not np.isnan(facts.confidence) for facts in self._facts)

    def sort_keys(self, column: int) -> list[Any]:
        """Return what every row sorts by in a column; kept until something changes.

        Qt compares some ten thousand pairs to sort a thousand rows: each must be a glance.
        """
        kept = self._keys.get(column)
        if kept is None or kept[0] is not self._live:
            rows = zip(self._facts, self._live, strict=True)
            kept = self._keys[column] = (
                self._live,
                [_sort_key(facts, live, Column(column)) for facts, live in rows],
            )
        return kept[1]

    def row_of(self, object_id: int) -> int | None:
        """Return the row of an object, or None."""
        return self._rows.get(object_id)

    def id_at(self, row: int) -> int:
        """Return the object's ID in a row."""
        return self._facts[row].id

    def rowCount(self, parent: Index | None = None) -> int:
        """Return the number of objects."""
        return 0 if parent is not None and parent.isValid() else len(self._facts)

    def columnCount(self, parent: Index | None = None) -> int:
        """Return the number of columns."""
        return 0 if parent is not None and parent.isValid() else len(Column)

    def headerData(self, section: int, orientation: Any, role: int = 0) -> Any:
        """Return a column's title or its tooltip."""
        if orientation != Qt.Orientation.Horizontal:
            return None
        title, tip = TITLES[Column(section)]
        if section == Column.VOLUME and self._tiny:
            title, tip = "mm³", "Volume in cubic millimetres."
        if role == Qt.ItemDataRole.DisplayRole:
            return title
        if role == Qt.ItemDataRole.ToolTipRole:
            return tip
        if role == Qt.ItemDataRole.TextAlignmentRole:
            return _alignment(Column(section))
        return None

    def flags(self, index: Index) -> Any:
        """Tell what a cell can do: all are selectable, names are editable."""
        if not index.isValid():
            return Qt.ItemFlag.NoItemFlags
        return _NAMED if index.column() == Column.NAME else _CELL

    def data(self, index: Index, role: int = 0) -> Any:
        """Return what a cell shows, sorts by, or is coloured with."""
        if not index.isValid() or self._session is None:
            return None
        row, column = index.row(), Column(index.column())
        facts, live = self._facts[row], self._live[row]
        if role in (Qt.ItemDataRole.DisplayRole, Qt.ItemDataRole.EditRole):
            if column == Column.VOLUME:
                return _amount(facts.volume * (1000 if self._tiny else 1))
            shown = _text(facts, live, column)
            marked = live.good and column == Column.NAME and role == Qt.ItemDataRole.DisplayRole
            return f"{shown} ✓" if marked else shown
        if role == Qt.ItemDataRole.FontRole and column == Column.STATE and live.words in MARKS:
            return _bold()
        if role == SORT:
            return _sort_key(facts, live, column)
        if role == ID:
            return facts.id
        if role == STATE:
            return live.state
        if role == Qt.ItemDataRole.DecorationRole and column == Column.SWATCH:
            return QColor.fromRgbF(*live.color)
        if role == Qt.ItemDataRole.TextAlignmentRole:
            return _alignment(column)
        if role == Qt.ItemDataRole.ToolTipRole:
            return _tip(facts, live, column)
        return None

    def setData(self, index: Index, value: Any, role: int = 2) -> bool:
        """Rename an object."""
        name = str(value).strip()
        if index.column() != Column.NAME or not name or self._session is None:
            return False
        with notifications.spoken():
            self._session.rename(self.id_at(index.row()), name)
            self.refresh()
            return True
        return False


def _bold() -> QFont:
    font = QFont()
    font.setBold(True)
    return font


def _colors(hues: Mapping[int, float], mode: Any) -> dict[int, Rgb]:
    """Return the tints as they are multiplied onto the picture."""
    if not hues:
        return {}
    from napari_unpack.appearance import tints_of

    tints = tints_of(hues, max(hues), mode=mode)
    return {i: (float(tints[i, 0]), float(tints[i, 1]), float(tints[i, 2])) for i in hues}


def _text(facts: _Facts, live: _Live, column: Column) -> str:
    if column == Column.NAME:
        return live.name
    if column == Column.STATE:
        return live.words
    if column == Column.SIZE:
        return " × ".join(f"{edge:.0f}" for edge in facts.edges)
    if column == Column.DENSITY:
        return f"{facts.density:.0f}" if abs(facts.density) >= 10 else f"{facts.density:.2g}"
    if column == Column.CONFIDENCE:
        return "–" if np.isnan(facts.confidence) else percent(facts.confidence)
    return ""


def _amount(volume: float) -> str:
    return f"{volume:.1f}" if volume < 100 else f"{volume:.0f}"


def _sort_key(facts: _Facts, live: _Live, column: Column) -> Any:
    match column:
        case Column.EYE:
            return live.state == "HIDDEN"
        case Column.SWATCH:
            return -1.0 if live.hue is None else live.hue
        case Column.NAME:
            return _natural(live.name)
        case Column.STATE:
            return live.words
        case Column.VOLUME:
            return facts.volume
        case Column.SIZE:
            return facts.edges[0]
        case Column.DENSITY:
            return facts.density
    return -1.0 if np.isnan(facts.confidence) else facts.confidence


def _tip(facts: _Facts, live: _Live, column: Column) -> str:
    if column == Column.STATE and live.words in MARKS:
        return "Nothing blocks this object: it can be unpacked now."
    if column in (Column.EYE, Column.SWATCH):
        return TITLES[column][1]
    told = [
        f"{live.name}, object {facts.label}, {live.words}",
        f"{_amount(facts.volume)} cm³, {_text(facts, live, Column.SIZE)} mm",
        f"density {_text(facts, live, Column.DENSITY)}",
    ]
    if not np.isnan(facts.confidence):
        told.append(f"{percent(facts.confidence)} sure that this is one whole object")
    if live.good:
        told.append("marked good: an example to train the confidence on")
    return "\n".join(told)


def _natural(name: str) -> str:
    """Make names sort as people count: object 2 before object 10."""
    return re.sub(r"\d+", lambda digits: digits.group().zfill(12), name.casefold())


def _alignment(column: Column) -> Any:
    numbers = column in (Column.VOLUME, Column.SIZE, Column.DENSITY, Column.CONFIDENCE)
    side = Qt.AlignmentFlag.AlignRight if numbers else Qt.AlignmentFlag.AlignLeft
    return side | Qt.AlignmentFlag.AlignVCenter


def _facts_of(session: Any) -> list[_Facts]:
    objects, boxes = session.objects, session.boxes
    edges = -np.sort(-(boxes.upper - boxes.lower) * np.asarray(session.spacing), axis=1)
    by_id = dict(zip((int(i) for i in boxes.ids), edges, strict=True))
    return [
        _Facts(
            id=int(object_id),
            label=int(session.label_of(int(object_id))),
            volume=float(record.volume_mm3) / 1000,
            edges=tuple(float(edge) for edge in by_id[int(object_id)]),  # type: ignore[arg-type]
            density=float(record.mean_density),
            confidence=float(getattr(record, "confidence", float("nan"))),
        )
        for object_id, record in zip(objects.index, objects.itertuples(index=False), strict=True)
        if int(object_id) in by_id
    ]
