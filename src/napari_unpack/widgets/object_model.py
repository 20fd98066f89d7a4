"""The objects of a session as a Qt table model."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from qtpy.QtCore import QAbstractTableModel, QModelIndex, QPersistentModelIndex, Qt
from qtpy.QtGui import QColor, QFont

from napari_unpack.session.errors import percent
from napari_unpack.session.object_state import ObjectState

if TYPE_CHECKING:
    from qtpy.QtCore import QObject

    from napari_unpack.appearance.tints import Mode
    from napari_unpack.session import Session

Index: TypeAlias = QModelIndex | QPersistentModelIndex
SORT = Qt.ItemDataRole.UserRole
ID = Qt.ItemDataRole.UserRole + 1
STATE = Qt.ItemDataRole.UserRole + 2

Rgb = tuple[float, float, float]
_CELL = Qt.ItemFlag.ItemIsEnabled | Qt.ItemFlag.ItemIsSelectable
_NAMED = _CELL | Qt.ItemFlag.ItemIsEditable
_NO_COLOR: Rgb = (0.5, 0.5, 0.5)

# Short enough for a narrow column.
STATE_WORDS = {
    ObjectState.PACKED: "packed",
    ObjectState.FLYING_OUT: "flying",
    ObjectState.UNPACKED: "out",
    ObjectState.FLYING_BACK: "flying",
    ObjectState.INSPECTED: "alone",
    ObjectState.HIDDEN: "hidden",
}

UNPACKABLE, TOGETHER, FIRST = "ready", "group", "next"
# What the state column says of some packed objects, and what it means. The column is too narrow for
# "unpackable" beside the confidence.
MARKS = {
    UNPACKABLE: "Unpackable: nothing blocks this object.",
    TOGETHER: "Unpackable as a group: these objects hold each other and leave together.",
    FIRST: "This object must leave before the one to be revealed.",
}


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
    """What never changes about an object, in cm³ and mm; `label` is its ID in the user's labels."""

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
    state: ObjectState
    hue: float | None
    color: Rgb
    mark: str
    is_example: bool = False

    @property
    def state_words(self) -> str:
        packed = self.state is ObjectState.PACKED
        return self.mark if self.mark and packed else STATE_WORDS[self.state]


class ObjectModel(QAbstractTableModel):
    """One row an object; `refresh` reads states, hues and names from the session.

    Parameters
    ----------
    rename : callable
        Takes an object ID and the name that the user has typed.
    parent : QObject, optional
    """

    def __init__(self, rename: Callable[[int, str], None], parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._rename = rename
        self._session: Session | None = None
        self._facts: list[_Facts] = []
        self._rows: dict[int, int] = {}
        self._live: list[_Live] = []
        self._shows_mm3 = False
        self._keys: dict[int, tuple[list[_Live], list[Any]]] = {}
        self._unpackable: frozenset[int] = frozenset()
        self._first: frozenset[int] = frozenset()

    def load(self, session: Session | None) -> None:
        """Show the objects of a session, or nothing for None."""
        self.beginResetModel()
        self._session = session
        self._facts = [] if session is None else _facts_of(session)
        self._rows = {facts.id: row for row, facts in enumerate(self._facts)}
        self._unpackable = self._first = frozenset()
        self._live = self._look()
        self._shows_mm3 = bool(self._facts) and max(f.volume for f in self._facts) < 1.0
        self.endResetModel()

    def refresh(
        self, unpackable: Iterable[int] | None = None, first: Iterable[int] | None = None
    ) -> None:
        """Read states, hues and names anew; only rows that changed are drawn again.

        Parameters
        ----------
        unpackable : iterable of int, optional
            The objects that nothing blocks now; by default those of the last call.
        first : iterable of int, optional
            Those that must leave before the one to be revealed; by default as before.
        """
        if unpackable is not None:
            self._unpackable = frozenset(unpackable)
        if first is not None:
            self._first = frozenset(first)
        before, self._live = self._live, self._look()
        for row, (old, new) in enumerate(zip(before, self._live, strict=True)):
            if old != new:
                # Hues change for all rows at once, while the bag turns: one cell a row is enough.
                only_color = replace(old, hue=new.hue, color=new.color) == new
                left = Column.SWATCH if only_color else Column.EYE
                right = Column.SWATCH if only_color else Column.STATE
                self.dataChanged.emit(self.index(row, left), self.index(row, right))

    def _look(self) -> list[_Live]:
        if self._session is None:
            return []
        session = self._session
        states, hues = session.states, session.hues
        names = session.objects["name"].to_dict()
        colors = _colors(hues, session.tint_mode)
        groups = session.unpackable_groups()
        together = {i for group in groups if len(group) > 1 for i in group}

        def mark(object_id: int) -> str:
            if object_id in self._first:
                return FIRST
            if object_id not in self._unpackable:
                return ""
            return TOGETHER if object_id in together else UNPACKABLE

        return [
            _Live(
                str(names.get(f.id, "")),
                states.get(f.id, ObjectState.HIDDEN),
                float(hues[f.id]) % 1.0 if f.id in hues else None,
                colors.get(f.id, _NO_COLOR),
                mark(f.id),
                f.id in session.examples,
            )
            for f in self._facts
        ]

    @property
    def knows_confidence(self) -> bool:
        """Whether the confidence of any object is known."""
        return any(not np.isnan(facts.confidence) for facts in self._facts)

    def sort_keys(self, column: int) -> list[Any]:
        """Return what every row sorts by in a column; kept until something changes.

        Qt compares some ten thousand pairs to sort a thousand rows.
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
        if section == Column.VOLUME and self._shows_mm3:
            title, tip = "mm³", "Volume in cubic millimetres."
        if role == Qt.ItemDataRole.DisplayRole:
            return title
        if role == Qt.ItemDataRole.ToolTipRole:
            return tip
        if role == Qt.ItemDataRole.TextAlignmentRole:
            return _alignment(Column(section))
        return None

    def flags(self, index: Index) -> Any:
        """Return what a cell can do: all are selectable, names are editable."""
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
                return _amount(facts.volume * (1000 if self._shows_mm3 else 1))
            shown = _text(facts, live, column)
            marked = (
                live.is_example and column == Column.NAME and role == Qt.ItemDataRole.DisplayRole
            )
            return f"{shown} ✓" if marked else shown
        if (
            role == Qt.ItemDataRole.FontRole
            and column == Column.STATE
            and live.state_words in MARKS
        ):
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
        self._rename(self.id_at(index.row()), name)
        self.refresh()
        return True


def _bold() -> QFont:
    font = QFont()
    font.setBold(True)
    return font


def _colors(hues: Mapping[int, float], mode: Mode) -> dict[int, Rgb]:
    """Return the tints as they are multiplied onto the densities."""
    if not hues:
        return {}
    from napari_unpack.appearance import tints_of

    tints = tints_of(hues, max(hues), mode=mode)
    return {i: (float(tints[i, 0]), float(tints[i, 1]), float(tints[i, 2])) for i in hues}


def _text(facts: _Facts, live: _Live, column: Column) -> str:
    if column == Column.NAME:
        return live.name
    if column == Column.STATE:
        return live.state_words
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
            return live.state is ObjectState.HIDDEN
        case Column.SWATCH:
            return -1.0 if live.hue is None else live.hue
        case Column.NAME:
            return _natural(live.name)
        case Column.STATE:
            return live.state_words
        case Column.VOLUME:
            return facts.volume
        case Column.SIZE:
            return facts.edges[0]
        case Column.DENSITY:
            return facts.density
    return -1.0 if np.isnan(facts.confidence) else facts.confidence


def _tip(facts: _Facts, live: _Live, column: Column) -> str:
    if column == Column.STATE and live.state_words in MARKS:
        return MARKS[live.state_words]
    if column in (Column.EYE, Column.SWATCH):
        return TITLES[column][1]
    lines = [
        f"{live.name}, object {facts.label}, {live.state_words}",
        f"{_amount(facts.volume)} cm³, {_text(facts, live, Column.SIZE)} mm",
        f"density {_text(facts, live, Column.DENSITY)}",
    ]
    if not np.isnan(facts.confidence):
        lines.append(f"{percent(facts.confidence)} sure that this is one whole object")
    if live.is_example:
        lines.append("an example to train the confidence on")
    return "\n".join(lines)


def _natural(name: str) -> str:
    """Return a key by which object 2 sorts before object 10."""
    return re.sub(r"\d+", lambda digits: digits.group().zfill(12), name.casefold())


def _alignment(column: Column) -> Any:
    numbers = column in (Column.VOLUME, Column.SIZE, Column.DENSITY, Column.CONFIDENCE)
    side = Qt.AlignmentFlag.AlignRight if numbers else Qt.AlignmentFlag.AlignLeft
    return side | Qt.AlignmentFlag.AlignVCenter


def _facts_of(session: Session) -> list[_Facts]:
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
