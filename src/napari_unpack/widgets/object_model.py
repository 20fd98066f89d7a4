"""The objects of a session as a Qt table model."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from qtpy.QtCore import QAbstractTableModel, QModelIndex, QPersistentModelIndex, Qt
from qtpy.QtGui import QColor, QFont

from napari_unpack.geometry.length_unit import MM
from napari_unpack.session.errors import listed_objects
from napari_unpack.session.object_state import ObjectState
from napari_unpack.viewer.plain_text import literal
from napari_unpack.widgets.object_columns import (
    BESIDE_HUE,
    FIRST,
    MARKS,
    NO_HUE,
    TOGETHER,
    UNPACKABLE,
    Column,
    Rgb,
    Row,
    Units,
    choice_of,
)

if TYPE_CHECKING:
    from qtpy.QtCore import QObject

    from napari_unpack.appearance.tints import Mode, Rgba
    from napari_unpack.session import Session
    from napari_unpack.widgets.object_sizes import ObjectSizes

    Sizes = Mapping[int, tuple[float, ...]]

Index: TypeAlias = QModelIndex | QPersistentModelIndex
Role = Qt.ItemDataRole
ID, STATE, FLAG = (Role.UserRole + k for k in range(3))
# Asked for at every index, where counting an enum takes longer than all else.
COLUMNS = len(Column)
EDITABLE = (Column.NAME, Column.NOTE)


class ObjectModel(QAbstractTableModel):
    """One row an object; `refresh` reads states, hues and names from the session.

    Parameters
    ----------
    rename : callable
        Takes an object ID and the name that the user has typed.
    parent : QObject, optional
    note : callable, optional
        Takes an object ID and the note that the user has typed.
    sizes : ObjectSizes, optional
        Measures the objects as soon as a table shows their sizes; by default those are unknown.
    reasons : callable, optional
        Takes an object ID and returns why its confidence is low, a sentence for the tooltip.

    Attributes
    ----------
    units : Units
        In which lengths and volumes are told; those of the session.
    """

    def __init__(
        self,
        rename: Callable[[int, str], None],
        parent: QObject | None = None,
        note: Callable[[int, str], None] = lambda _id, _text: None,
        sizes: ObjectSizes | None = None,
        reasons: Callable[[int], str] = lambda _id: "",
    ) -> None:
        super().__init__(parent)
        self._rename, self._note, self._measures = rename, note, sizes
        self._reasons = reasons
        self._sizes: Sizes = {}
        self._blockers: dict[int, tuple[int, ...]] | None = None
        self._session: Session | None = None
        self._rows: list[Row] = []
        self._row_of: dict[int, int] = {}
        self.units = Units.of(MM, 0.0)
        self._unpackable: frozenset[int] = frozenset()
        self._first: frozenset[int] = frozenset()

    @property
    def session(self) -> Session | None:
        """The one whose objects are shown."""
        return self._session

    def load(self, session: Session | None) -> None:
        """Show the objects of a session, or nothing for None."""
        self.beginResetModel()
        # A repair changes few of many objects.
        before = {row.id: row for row in self._rows} if session is self._session else {}
        self._session = session
        self._rows = [] if session is None else _rows_of(session, before)
        self._sizes = {} if session is None else self._known_sizes()
        self._row_of = {row.id: k for k, row in enumerate(self._rows)}
        self._unpackable = self._first = frozenset()
        self._rows = self._read()
        self.units = self._measured_in()
        self.endResetModel()

    def _measured_in(self) -> Units:
        unit = MM if self._session is None else self._session.length_unit
        return Units.of(unit, max((row.volume for row in self._rows), default=0.0))

    def refresh(
        self, unpackable: Iterable[int] | None = None, first: Iterable[int] | None = None
    ) -> None:
        """Read states, hues and names anew; the first to the last row changed are drawn again.

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
        units, self.units = self.units, self._measured_in()
        if units != self.units and self._rows:
            across = Qt.Orientation.Horizontal
            self.headerDataChanged.emit(across, Column.VOLUME, Column.SIZE)
            last = self.index(len(self._rows) - 1, Column.SIZE)
            self.dataChanged.emit(self.index(0, Column.VOLUME), last)
        before, self._rows = self._rows, self._read()
        rows = list(zip(before, self._rows, strict=True))
        changed = [k for k, (old, new) in enumerate(rows) if old is not new]
        if changed:
            # Hues change for all rows at once, while the bag turns: one cell a row is enough.
            only_hue = all(BESIDE_HUE(old) == BESIDE_HUE(new) for old, new in rows)
            left = Column.SWATCH if only_hue else Column.EYE
            right = Column.SWATCH if only_hue else Column.NOTE
            # One word for all: each costs more than drawing the rows between once more.
            first, last = self.index(changed[0], left), self.index(changed[-1], right)
            self.dataChanged.emit(first, last)
        if self._blockers is not None and self._rows:
            # Asked for anew by the tables that show it, and by no other.
            self._blockers = None
            last = self.index(len(self._rows) - 1, Column.BLOCKERS)
            self.dataChanged.emit(self.index(0, Column.BLOCKERS), last)

    def show_sizes(self) -> None:
        """Show the extents that were measured meanwhile."""
        if self._session is not None:
            self._sizes = self._known_sizes()
            self.refresh()

    def _known_sizes(self) -> Sizes:
        return self._measures.known() if self._measures else {}

    def _read(self) -> list[Row]:
        session = self._session
        if session is None:
            return []
        states, hues = session.states, session.hues
        said = session.annotations
        own, notes, flags = said.colors, said.notes, said.flags
        objects = session.objects
        names = dict(zip(objects.index.tolist(), objects["name"].tolist(), strict=True))
        colors = _colors(hues, session.tint_mode, own)
        # Steps up to now: those undone are still in the bag.
        done = session.steps[: session.step]
        orders = {i: k for k, group in enumerate(done, 1) for i in group}
        # Known without casting rays: the queue is used up before it is asked anew.
        groups, examples = session.queries.unpackable_groups(), session.examples
        together = {i for group in groups if len(group) > 1 for i in group}

        def mark(i: int) -> str:
            if i in self._first:
                return FIRST
            if i not in self._unpackable:
                return ""
            return TOGETHER if i in together else UNPACKABLE

        return [
            row.changed(
                name=str(names.get(row.id, "")),
                # A repair may have deleted the object before its row is gone.
                state=states.get(row.id, ObjectState.HIDDEN),
                hue=float(hues[row.id]) % 1.0 if row.id in hues else None,
                color=colors.get(row.id, NO_HUE),
                opacity=own[row.id][3] if row.id in own else 1.0,
                own_color=row.id in own,
                mark=mark(row.id),
                is_example=row.id in examples,
                edges=self._sizes.get(row.id),
                note=notes.get(row.id, ""),
                flag=flags.get(row.id),
                order=orders.get(row.id),
            )
            for row in self._rows
        ]

    @property
    def widest_volume(self) -> str:
        """The longest text of a volume."""
        volumes = [row.volume for row in self._rows] or [0.0]
        # The largest has most digits, or the smallest most decimals.
        return max(map(self.units.volume.text, (max(volumes), min(volumes))), key=len)

    @property
    def knows_confidence(self) -> bool:
        """Whether the confidence of any object is known."""
        return any(not np.isnan(row.confidence) for row in self._rows)

    def sort_keys(self, column: int) -> list[Any]:
        """Return the key by which each row sorts in a column."""
        if column == Column.BLOCKERS:
            return [len(self._blockers_of(row.id)) for row in self._rows]
        which = Column(column)
        return [row.sort_key(which) for row in self._rows]

    def row_of(self, object_id: int) -> int | None:
        """Return the row of an object, or None."""
        return self._row_of.get(object_id)

    def id_at(self, row: int) -> int:
        """Return the object's ID in a row."""
        return self._rows[row].id

    def row_at(self, row: int) -> Row:
        """Return what is known of the object in a row."""
        return self._rows[row]

    def index(self, row: int, column: int, parent: Index | None = None) -> QModelIndex:
        """Return the index of a cell, as Qt would after it has asked twice how many there are.

        Parameters
        ----------
        row, column : int
        parent : QModelIndex, optional
            Invalid: there are no levels.
        """
        inside = 0 <= row < len(self._rows) and 0 <= column < COLUMNS
        if not inside or (parent is not None and parent.isValid()):
            return QModelIndex()
        return self.createIndex(row, column)

    def rowCount(self, parent: Index | None = None) -> int:
        """Return the number of objects."""
        return 0 if parent is not None and parent.isValid() else len(self._rows)

    def columnCount(self, parent: Index | None = None) -> int:
        """Return the number of columns."""
        return 0 if parent is not None and parent.isValid() else COLUMNS

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
        title, tip = self.units.title(column)
        # Read aloud, a column has its name where it shows a unit or nothing.
        spoken = title if choice_of(column) in title else f"{choice_of(column)} {title}".strip()
        answers = {Role.DisplayRole: title, Role.ToolTipRole: tip, Role.AccessibleTextRole: spoken}
        return _alignment(column) if role == Role.TextAlignmentRole else answers.get(role)

    def flags(self, index: Index) -> Qt.ItemFlag:
        """Return what a cell can do: all are selectable, names and notes are editable."""
        if not index.isValid():
            return Qt.ItemFlag.NoItemFlags
        flags = Qt.ItemFlag.ItemIsEnabled | Qt.ItemFlag.ItemIsSelectable
        return flags | Qt.ItemFlag.ItemIsEditable if index.column() in EDITABLE else flags

    def data(self, index: Index, role: int = 0) -> Any:
        """Return what a cell shows, or is coloured with, as Qt asks for it.

        Parameters
        ----------
        index : QModelIndex
        role : int
            One of Qt's, or `ID`, `STATE` or `FLAG`.
        """
        if not index.isValid() or self._session is None:
            return None
        row, column = self._rows[index.row()], Column(index.column())
        match role:
            case Role.DisplayRole if column == Column.NAME and row.is_example:
                return f"{row.name} ✓"
            case Role.DisplayRole if column == Column.BLOCKERS:
                return self._blockers_text(row.id)
            case Role.ToolTipRole if column == Column.BLOCKERS:
                return literal(self._blockers_text(row.id))
            case Role.DisplayRole | Role.EditRole:
                return self._text(row, column)
            case Role.AccessibleTextRole if row.spoken(column):
                return row.spoken(column)
            case Role.FontRole if column == Column.STATE and row.state_words in MARKS:
                bold = QFont()
                bold.setBold(True)
                return bold
            case Role.DecorationRole if column == Column.SWATCH:
                return QColor.fromRgbF(*row.color, row.opacity)
            case Role.TextAlignmentRole:
                return _alignment(column)
            case Role.ToolTipRole if column == Column.CONFIDENCE and not np.isnan(row.confidence):
                return literal(f"{row.tooltip(column, self.units)}\n{self._reasons(row.id)}")
            case Role.ToolTipRole:
                return literal(row.tooltip(column, self.units))
        own = {ID: row.id, STATE: row.state, FLAG: row.flag}
        return own.get(role)

    def _text(self, row: Row, column: Column) -> str:
        # Measured only where a table shows the column, and told once it is.
        if column == Column.SIZE and row.edges is None and self._measures is not None:
            self._measures.want()
        return row.text(column, self.units)

    def _blockers_of(self, object_id: int) -> tuple[int, ...]:
        if self._blockers is None:
            self._blockers = {} if self._session is None else self._session.queries.blockers()
        return self._blockers.get(object_id, ())

    def _blockers_text(self, object_id: int) -> str:
        # What an undo has brought back has a row only once that is told.
        known = [self._row_of[i] for i in self._blockers_of(object_id) if i in self._row_of]
        names = [self._rows[row].name for row in known]
        return listed_objects(names) if names else ""

    def setData(self, index: Index, value: Any, role: int = Role.EditRole) -> bool:
        """Rename an object, or write a note on it.

        Parameters
        ----------
        index : QModelIndex
            Of its name or note.
        value : str
        role : int
        """
        text, column = str(value).strip(), index.column()
        # A note may be taken away; a name may not.
        if column not in EDITABLE or self._session is None or not (text or column == Column.NOTE):
            return False
        (self._rename if column == Column.NAME else self._note)(self.id_at(index.row()), text)
        self.refresh()
        return True


def _colors(hues: Mapping[int, float], mode: Mode, own: Mapping[int, Rgba]) -> dict[int, Rgb]:
    """Return the tints as they are multiplied onto the densities."""
    if not hues:
        return {}
    from napari_unpack.appearance import tints_of

    tints = tints_of(hues, max(hues), mode=mode, colors=own)
    return {i: (float(tints[i, 0]), float(tints[i, 1]), float(tints[i, 2])) for i in hues}


def _alignment(column: Column) -> Qt.AlignmentFlag:
    numbers = (*range(Column.VOLUME, Column.FLAG), Column.ORDER)
    side = Qt.AlignmentFlag.AlignRight if column in numbers else Qt.AlignmentFlag.AlignLeft
    return side | Qt.AlignmentFlag.AlignVCenter


def _rows_of(session: Session, before: Mapping[int, Row]) -> list[Row]:
    objects, there = session.objects, set(session.boxes.ids.tolist())
    facts = [
        objects[column].to_numpy(float).tolist() if column in objects else [math.nan] * len(objects)
        for column in ("volume_mm3", "mean_density", "confidence")
    ]

    def row(i: int, volume: float, density: float, confidence: float) -> Row:
        # One NaN for all: what is not known is no change from what was not.
        density, confidence = (math.nan if math.isnan(x) else x for x in (density, confidence))
        if (old := before.get(i)) is not None:
            return old.changed(volume=volume, density=density, confidence=confidence)
        return Row(i, int(session.label_of(i)), volume, density, confidence)

    return [
        row(i, volume, density, confidence)
        for i, volume, density, confidence in zip(objects.index.tolist(), *facts, strict=True)
        if i in there
    ]
