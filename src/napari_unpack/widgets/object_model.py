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
Role = Qt.ItemDataRole
SORT, ID, STATE = Role.UserRole, Role.UserRole + 1, Role.UserRole + 2

Rgb = tuple[float, float, float]
NO_HUE: Rgb = (0.5, 0.5, 0.5)

# Short enough for a narrow column.
STATE_WORDS = {
    ObjectState.PACKED: "packed",
    ObjectState.FLYING_OUT: "flying",
    ObjectState.UNPACKED: "out",
    ObjectState.FLYING_BACK: "flying",
    ObjectState.INSPECTED: "alone",
    ObjectState.HIDDEN: "hidden",
}

# What the state column says of some packed objects, and what it means. There is no room for the
# word "unpackable" beside the confidence.
UNPACKABLE, TOGETHER, FIRST = "ready", "group", "next"
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
# For bags of objects all below 1 cm³, such as nuclei under a microscope.
TINY_TITLE = "mm³", "Volume in cubic millimetres."


@dataclass(frozen=True)
class _Row:
    """What is known of an object; the fields from `name` on may change at any moment."""

    id: int
    label: int  # Its ID in the user's own labels, which the session may have renumbered.
    volume: float
    edges: tuple[float, ...]
    density: float
    confidence: float
    name: str = ""
    state: ObjectState = ObjectState.HIDDEN
    hue: float | None = None
    color: Rgb = NO_HUE
    mark: str = ""
    is_example: bool = False

    @property
    def state_words(self) -> str:
        packed = self.state is ObjectState.PACKED
        return self.mark if self.mark and packed else STATE_WORDS[self.state]

    def text(self, column: Column, tiny: bool = False) -> str:
        match column:
            case Column.NAME:
                return self.name
            case Column.STATE:
                return self.state_words
            case Column.VOLUME:
                volume = self.volume * (1000 if tiny else 1)
                return f"{volume:.1f}" if volume < 100 else f"{volume:.0f}"
            case Column.SIZE:
                return " × ".join(f"{edge:.0f}" for edge in self.edges)
            case Column.DENSITY:
                return f"{self.density:.0f}" if abs(self.density) >= 10 else f"{self.density:.2g}"
            case Column.CONFIDENCE:
                return "–" if np.isnan(self.confidence) else percent(self.confidence)
        return ""

    def sort_key(self, column: Column) -> Any:
        match column:
            case Column.EYE:
                return self.state is ObjectState.HIDDEN
            case Column.SWATCH:
                return -1.0 if self.hue is None else self.hue
            case Column.NAME:
                # Digits are padded, so that object 2 comes before object 10.
                return re.sub(r"\d+", lambda found: found[0].zfill(12), self.name.casefold())
            case Column.STATE:
                return self.state_words
            case Column.VOLUME:
                return self.volume
            case Column.SIZE:
                return self.edges[0]
            case Column.DENSITY:
                return self.density
        return -1.0 if np.isnan(self.confidence) else self.confidence

    def tooltip(self, column: Column) -> str:
        if column == Column.STATE and self.state_words in MARKS:
            return MARKS[self.state_words]
        if column in (Column.EYE, Column.SWATCH):
            return TITLES[column][1]
        lines = [
            f"{self.name}, object {self.label}, {self.state_words}",
            f"{self.text(Column.VOLUME)} cm³, {self.text(Column.SIZE)} mm",
            f"density {self.text(Column.DENSITY)}",
        ]
        if not np.isnan(self.confidence):
            lines.append(f"{percent(self.confidence)} sure that this is one whole object")
        if self.is_example:
            lines.append("an example to train the confidence on")
        return "\n".join(lines)


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
        self._rows: list[_Row] = []
        self._row_of: dict[int, int] = {}
        self._tiny = False
        self._keys: dict[int, tuple[list[_Row], list[Any]]] = {}
        self._unpackable: frozenset[int] = frozenset()
        self._first: frozenset[int] = frozenset()

    def load(self, session: Session | None) -> None:
        """Show the objects of a session, or nothing for None."""
        self.beginResetModel()
        self._session = session
        self._rows = [] if session is None else _rows_of(session)
        self._row_of = {row.id: k for k, row in enumerate(self._rows)}
        self._unpackable = self._first = frozenset()
        self._rows = self._read()
        self._tiny = bool(self._rows) and max(row.volume for row in self._rows) < 1.0
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
        before, self._rows = self._rows, self._read()
        for k, (old, new) in enumerate(zip(before, self._rows, strict=True)):
            if old != new:
                # Hues change for all rows at once, while the bag turns: one cell a row is enough.
                only_color = replace(old, hue=new.hue, color=new.color) == new
                left = Column.SWATCH if only_color else Column.EYE
                right = Column.SWATCH if only_color else Column.STATE
                self.dataChanged.emit(self.index(k, left), self.index(k, right))

    def _read(self) -> list[_Row]:
        session = self._session
        if session is None:
            return []
        states, hues = session.states, session.hues
        names, colors = session.objects["name"].to_dict(), _colors(hues, session.tint_mode)
        # Known without casting rays: the queue is used up before it is asked anew.
        groups = session.queries.unpackable_groups()
        together = {i for group in groups if len(group) > 1 for i in group}

        def mark(i: int) -> str:
            if i in self._first:
                return FIRST
            if i not in self._unpackable:
                return ""
            return TOGETHER if i in together else UNPACKABLE

        return [
            replace(
                row,
                name=str(names.get(row.id, "")),
                # A repair may have deleted the object before its row is gone.
                state=states.get(row.id, ObjectState.HIDDEN),
                hue=float(hues[row.id]) % 1.0 if row.id in hues else None,
                color=colors.get(row.id, NO_HUE),
                mark=mark(row.id),
                is_example=row.id in session.examples,
            )
            for row in self._rows
        ]

    @property
    def knows_confidence(self) -> bool:
        """Whether the confidence of any object is known."""
        return any(not np.isnan(row.confidence) for row in self._rows)

    def sort_keys(self, column: int) -> list[Any]:
        """Return the key by which each row sorts in a column, kept until something changes."""
        kept = self._keys.get(column)
        # Qt compares some ten thousand pairs to sort a thousand rows.
        if kept is None or kept[0] is not self._rows:
            keys = [row.sort_key(Column(column)) for row in self._rows]
            kept = self._keys[column] = self._rows, keys
        return kept[1]

    def row_of(self, object_id: int) -> int | None:
        """Return the row of an object, or None."""
        return self._row_of.get(object_id)

    def id_at(self, row: int) -> int:
        """Return the object's ID in a row."""
        return self._rows[row].id

    def rowCount(self, parent: Index | None = None) -> int:
        """Return the number of objects."""
        return 0 if parent is not None and parent.isValid() else len(self._rows)

    def columnCount(self, parent: Index | None = None) -> int:
        """Return the number of columns."""
        return 0 if parent is not None and parent.isValid() else len(Column)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = 0) -> Any:
        """Return a column's title or its tooltip, as Qt asks for them.

        Parameters
        ----------
        section : int
            The column.
        orientation : Qt.Orientation
        role : int
        """
        if orientation != Qt.Orientation.Horizontal:
            return None
        column = Column(section)
        title, tip = TINY_TITLE if column == Column.VOLUME and self._tiny else TITLES[column]
        answers = {Role.DisplayRole: title, Role.ToolTipRole: tip}
        return _alignment(column) if role == Role.TextAlignmentRole else answers.get(role)

    def flags(self, index: Index) -> Qt.ItemFlag:
        """Return what a cell can do: all are selectable, names are editable."""
        if not index.isValid():
            return Qt.ItemFlag.NoItemFlags
        flags = Qt.ItemFlag.ItemIsEnabled | Qt.ItemFlag.ItemIsSelectable
        return flags | Qt.ItemFlag.ItemIsEditable if index.column() == Column.NAME else flags

    def data(self, index: Index, role: int = 0) -> Any:
        """Return what a cell shows, sorts by, or is coloured with, as Qt asks for it.

        Parameters
        ----------
        index : QModelIndex
        role : int
            One of Qt's, or `SORT`, `ID` or `STATE`.
        """
        if not index.isValid() or self._session is None:
            return None
        row, column = self._rows[index.row()], Column(index.column())
        match role:
            case Role.DisplayRole if column == Column.NAME and row.is_example:
                return f"{row.name} ✓"
            case Role.DisplayRole | Role.EditRole:
                return row.text(column, self._tiny)
            case Role.FontRole if column == Column.STATE and row.state_words in MARKS:
                bold = QFont()
                bold.setBold(True)
                return bold
            case Role.DecorationRole if column == Column.SWATCH:
                return QColor.fromRgbF(*row.color)
            case Role.TextAlignmentRole:
                return _alignment(column)
            case Role.ToolTipRole:
                return row.tooltip(column)
        own = {SORT: row.sort_key, ID: lambda _: row.id, STATE: lambda _: row.state}
        return own[role](column) if role in own else None

    def setData(self, index: Index, value: Any, role: int = Role.EditRole) -> bool:
        """Rename an object.

        Parameters
        ----------
        index : QModelIndex
            Of its name.
        value : str
        role : int
        """
        name = str(value).strip()
        if index.column() != Column.NAME or not name or self._session is None:
            return False
        self._rename(self.id_at(index.row()), name)
        self.refresh()
        return True


def _colors(hues: Mapping[int, float], mode: Mode) -> dict[int, Rgb]:
    """Return the tints as they are multiplied onto the densities."""
    if not hues:
        return {}
    from napari_unpack.appearance import tints_of

    tints = tints_of(hues, max(hues), mode=mode)
    return {i: (float(tints[i, 0]), float(tints[i, 1]), float(tints[i, 2])) for i in hues}


def _alignment(column: Column) -> Qt.AlignmentFlag:
    numbers = (Column.VOLUME, Column.SIZE, Column.DENSITY, Column.CONFIDENCE)
    side = Qt.AlignmentFlag.AlignRight if column in numbers else Qt.AlignmentFlag.AlignLeft
    return side | Qt.AlignmentFlag.AlignVCenter


def _rows_of(session: Session) -> list[_Row]:
    objects, boxes = session.objects, session.boxes
    # The longest edge first: upright boxes of lying and standing objects compare.
    edges = -np.sort(-(boxes.upper - boxes.lower) * np.asarray(session.spacing), axis=1)
    by_id = dict(zip((int(i) for i in boxes.ids), edges, strict=True))
    return [
        _Row(
            id=int(i),
            label=int(session.label_of(int(i))),
            volume=float(record.volume_mm3) / 1000,
            edges=tuple(float(edge) for edge in by_id[int(i)]),
            density=float(record.mean_density),
            confidence=float(getattr(record, "confidence", float("nan"))),
        )
        for i, record in zip(objects.index, objects.itertuples(index=False), strict=True)
        if int(i) in by_id
    ]
