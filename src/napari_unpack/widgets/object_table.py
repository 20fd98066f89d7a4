"""The table of objects: eyes, swatches and flags to click, sorting, searching, columns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from qtpy.QtCore import (
    QItemSelection,
    QItemSelectionModel,
    QItemSelectionRange,
    QModelIndex,
    QSortFilterProxyModel,
    Qt,
    Signal,
)
from qtpy.QtGui import (
    QFont,
    QFontMetrics,
    QKeySequence,
    QPainter,
)
from qtpy.QtWidgets import (
    QAbstractItemView,
    QHeaderView,
    QLineEdit,
    QMenu,
    QStyledItemDelegate,
    QTableView,
)

from napari_unpack.widgets.object_cells import (
    DRAWN,
    PADDING,
    ROW,
    ClickDelegate,
    NameDelegate,
    TextDelegate,
)
from napari_unpack.widgets.object_columns import (
    MARKS,
    SHORT_TITLES,
    Column,
    Row,
    choice_of,
    sought,
)
from napari_unpack.widgets.object_model import ID, Index, ObjectModel
from napari_unpack.widgets.remembered import ChosenColumns
from napari_unpack.widgets.sorted_rows import SortedRows

if TYPE_CHECKING:
    from qtpy.QtCore import QObject, QPoint
    from qtpy.QtGui import QKeyEvent, QPaintEvent, QResizeEvent

    from napari_unpack.session import Session

Widths = dict[Column, int]

WIDTHS = {
    Column.EYE: 22,
    Column.SWATCH: 18,
    Column.FLAG: 20,
    Column.NAME: 68,
    Column.STATE: 54,
    Column.VOLUME: 44,
    Column.SIZE: 92,
    Column.DENSITY: 60,
    Column.CONFIDENCE: 44,
    Column.ORDER: 40,
    Column.BLOCKERS: 170,
    Column.NOTE: 150,
}
# Texts that a column must have room for in any font, with `PADDING` around them.
WIDEST = {
    Column.NAME: "Object 12, part",
    Column.STATE: max(MARKS, key=len),
    Column.VOLUME: "1234",
    Column.SIZE: "999 × 999 × 999",
    Column.DENSITY: "1234",
    Column.CONFIDENCE: "99 %",
    Column.ORDER: "99",
    Column.BLOCKERS: "Objects 10, 11, 12 and 9 others",
}

# Said where a search or a choice lists no object.
NO_MATCH = "No object matches."

# From left to right; a table that chooses by itself shows the first five, and of the others what
# it has room for, the state beneath the name where volume and confidence would have none. Tooltips
# have them all.
ORDER = (
    Column.EYE,
    Column.SWATCH,
    Column.FLAG,
    Column.NAME,
    Column.STATE,
    Column.VOLUME,
    Column.CONFIDENCE,
    Column.SIZE,
    Column.DENSITY,
    Column.ORDER,
    Column.BLOCKERS,
    Column.NOTE,
)
ALWAYS = ORDER[:5]
WHERE_ROOM = ORDER[5:]


class ObjectFilter(QSortFilterProxyModel):
    """Sort by any column; keep rows by a text in name, note or flag, or by what is known of them.

    Parameters
    ----------
    model : ObjectModel
    parent : QObject, optional
    """

    def __init__(self, model: ObjectModel, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._model, self._sorted = model, SortedRows(model, self)
        self._text = ""
        self._listed: Callable[[Row], bool] = lambda row: True
        self._short = False
        self.setSourceModel(self._sorted)

    def sort(self, column: int, order: Qt.SortOrder = Qt.SortOrder.AscendingOrder) -> None:
        """Sort the rows, those left out too, by a column.

        Parameters
        ----------
        column : int
        order : Qt.SortOrder
        """
        self._sorted.sort(column, order)

    def around_moves(self, before: Callable[[], object], after: Callable[[], object]) -> None:
        """Call something before and after rows are moved to another order.

        Parameters
        ----------
        before, after : callable
        """
        self._sorted.moving.connect(before)
        self._sorted.moved.connect(after)

    def index_of(self, object_id: int) -> QModelIndex:
        """Return the index of an object's name, invalid where it is not listed."""
        row = self._model.row_of(object_id)
        if row is None:
            return QModelIndex()
        return self.mapFromSource(self._sorted.mapFromSource(self._model.index(row, Column.NAME)))

    def keep_text(self, text: str) -> None:
        """Keep the objects with a text in their name, note or flag, or with that ID."""
        self._text = sought(text.strip())
        self._renew()

    def keep(self, listed: Callable[[Row], bool]) -> None:
        """Keep the objects of which something is true."""
        self._listed = listed
        self._renew()

    def shorten_titles(self, short: bool) -> None:
        """Have the titles of a narrow table, or whole ones."""
        if short != self._short:
            self._short = short
            across = Qt.Orientation.Horizontal
            self.headerDataChanged.emit(across, min(SHORT_TITLES), max(SHORT_TITLES))

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = 0) -> Any:
        """Return a column's title or its tooltip, as Qt asks for them.

        Parameters
        ----------
        section, orientation, role
            As for `ObjectModel.headerData`.
        """
        if self._short and role == Qt.ItemDataRole.DisplayRole and section in SHORT_TITLES:
            return SHORT_TITLES[Column(section)]
        return super().headerData(section, orientation, role)

    def _renew(self) -> None:
        # Qt 6.9 deprecates invalidateFilter; before it there is nothing else.
        if hasattr(self, "beginFilterChange"):
            self.beginFilterChange()
            self.endFilterChange()
        else:
            self.invalidateFilter()

    def filterAcceptsRow(self, row: int, parent: Index) -> bool:
        """Return whether a row is listed.

        Parameters
        ----------
        row : int
            Of all, sorted.
        parent : QModelIndex
            Invalid: the model has no levels.
        """
        told = self._model.row_at(self._sorted.source_row(row))
        found = self._text in told.searched or self._text == str(told.label)
        return found and self._listed(told)


@dataclass(frozen=True)
class _Typed:
    """A name or a note that is being typed, with the place of the cursor."""

    session: Session | None
    id: int
    column: int
    text: str
    place: int


class ObjectTable(QTableView):
    """The table, which emits what the user does and changes nothing itself.

    Signals: `eye_clicked`, `swatch_clicked`, `flag_clicked` (object ID), `ids_selected`
    (frozenset of IDs, by the user only).

    Parameters
    ----------
    model : ObjectModel
        Several tables may share one.
    key : str
        Under which the columns that a person chooses are remembered.
    """

    eye_clicked = Signal(int)
    swatch_clicked = Signal(int)
    flag_clicked = Signal(int)
    ids_selected = Signal(object)

    def __init__(self, model: ObjectModel, key: str = "panel") -> None:
        super().__init__()
        self.objects = model
        self.rows = ObjectFilter(model, self)
        self.setModel(self.rows)
        model.modelAboutToBeReset.connect(self._keep_typed)
        model.modelReset.connect(self._fit_columns)
        self.rows.modelReset.connect(self._type_on)
        model.headerDataChanged.connect(lambda *_: self._fit_columns())
        self._silent = False
        self._selected: list[int] | None = None
        self._typed: _Typed | None = None
        self._widths: Widths = {}
        self._columns = ChosenColumns(key)
        self._texts, self._names = TextDelegate(self), NameDelegate(self)
        self.setItemDelegate(self._texts)
        self.setItemDelegateForColumn(Column.NAME, self._names)
        self._clicked = {
            Column.EYE: self.eye_clicked,
            Column.SWATCH: self.swatch_clicked,
            Column.FLAG: self.flag_clicked,
        }
        # Kept: a view does not own its delegates.
        self._cells = {column: ClickDelegate(draw, self) for column, draw in DRAWN.items()}
        for column, cell in self._cells.items():
            cell.clicked.connect(self._clicked[column])
            self.setItemDelegateForColumn(column, cell)
        self._set_looks()
        rows = self.rows
        self._held: frozenset[int] = frozenset()
        rows.around_moves(self._hold_selection, lambda: self._select(self._held))
        for moved in (rows.layoutChanged, rows.rowsInserted, rows.rowsRemoved, rows.modelReset):
            moved.connect(self._forget_selected)
        self.selectionModel().selectionChanged.connect(self._forget_selected)
        self.selectionModel().selectionChanged.connect(self._emit_selection)

    def _set_looks(self) -> None:
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.setSelectionMode(QAbstractItemView.SelectionMode.ExtendedSelection)
        self.setEditTriggers(
            QAbstractItemView.EditTrigger.DoubleClicked
            | QAbstractItemView.EditTrigger.EditKeyPressed
        )
        self.setShowGrid(False)
        self.setWordWrap(False)
        # Arrow keys go from cell to cell: Tab would never come out of the table.
        self.setTabKeyNavigation(False)
        # By pixels, as wide columns would jump otherwise.
        self.setHorizontalScrollMode(QAbstractItemView.ScrollMode.ScrollPerPixel)
        self.verticalHeader().hide()
        self.verticalHeader().setSectionResizeMode(QHeaderView.ResizeMode.Fixed)
        self.verticalHeader().setDefaultSectionSize(ROW)
        header = self.horizontalHeader()
        header.setHighlightSections(False)
        header.setMinimumSectionSize(18)
        header.setSectionsMovable(True)
        for place, column in enumerate(ORDER):
            header.moveSection(header.visualIndex(column), place)
        header.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        header.customContextMenuRequested.connect(self._open_columns_menu)
        header.setToolTip("Click a title to sort; right-click to choose columns.")
        self.setAccessibleName("Objects")
        self._fit_columns()
        header.setSectionResizeMode(Column.NAME, QHeaderView.ResizeMode.Stretch)
        self.setSortingEnabled(True)
        self.sortByColumn(Column.NAME, Qt.SortOrder.AscendingOrder)
        self.setMinimumHeight(ROW * 6)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Show as many columns as there is room for, so that nothing is cut off."""
        super().resizeEvent(event)
        self._fit_columns()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Say so where there are objects and none of them is listed."""
        super().paintEvent(event)
        if self.objects.rowCount() and not self.rows.rowCount():
            room = self.viewport().rect().adjusted(PADDING, PADDING, -PADDING, -PADDING)
            where = Qt.AlignmentFlag.AlignHCenter | Qt.AlignmentFlag.AlignTop
            QPainter(self.viewport()).drawText(room, where | Qt.TextFlag.TextWordWrap, NO_MATCH)

    def _fit_columns(self) -> None:
        widths, shown, narrow = self._measured({}), self._columns.chosen, False
        if shown is None:
            wanted = [c for c in WHERE_ROOM if self._is_worth_showing(c)]
            shown = self._fitting(widths, ALWAYS, wanted)
            narrow = not shown.issuperset({Column.VOLUME, Column.CONFIDENCE}.intersection(wanted))
            if narrow:
                widths = self._measured(SHORT_TITLES)
                shown = self._fitting(widths, [c for c in ALWAYS if c != Column.STATE], wanted)
        self._names.says_state = Column.STATE not in shown
        self.rows.shorten_titles(narrow)
        # Setting widths resizes the view, which would call this again without end.
        if widths != self._widths:
            self._widths = widths
            for column, width in widths.items():
                self.setColumnWidth(column, width)
        for column in Column:
            self.setColumnHidden(column, column not in shown)
        self.verticalHeader().setDefaultSectionSize(self._names.height(self.font()))

    def _measured(self, short: dict[Column, str]) -> Widths:
        """Return how wide the columns must be, where some titles are short."""
        measure = self.fontMetrics().horizontalAdvance
        bold = QFont(self.font())
        bold.setBold(True)
        # What can be done with an object is written bold.
        boldly = QFontMetrics(bold).horizontalAdvance
        titles = {c: self.objects.units.title(c)[0] for c in WIDTHS} | short
        volume = max(WIDEST[Column.VOLUME], self.objects.widest_volume, key=len)
        widest = WIDEST | {Column.VOLUME: volume}
        return {
            c: max(
                w,
                (boldly if c == Column.STATE else measure)(widest.get(c, "")) + PADDING,
                measure(titles[c]) + (PADDING if titles[c] else 0),
            )
            for c, w in WIDTHS.items()
        }

    def _is_worth_showing(self, column: Column) -> bool:
        return column != Column.CONFIDENCE or self.objects.knows_confidence

    def _fitting(
        self, widths: Widths, always: Sequence[Column], wanted: Iterable[Column]
    ) -> set[Column]:
        """Return some columns and the first of others that there is room for."""
        shown, room = set(always), self.viewport().width()
        room -= sum(widths[column] for column in always)
        for column in wanted:
            room -= widths[column]
            if room < 0:
                break
            shown.add(column)
        return shown

    def columns_menu(self) -> QMenu:
        """Make the menu in which a person chooses the columns."""
        menu = QMenu(self)
        menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        automatic = menu.addAction("As many as there is room for")
        automatic.setCheckable(True)
        automatic.setChecked(self._columns.chosen is None)
        automatic.triggered.connect(lambda _: self._choose_columns(None))
        sorting = menu.addMenu("Sort by")
        for column in ORDER:
            if not self.isColumnHidden(column):
                action = sorting.addAction(choice_of(column))
                action.triggered.connect(lambda _, column=column: self._sort_by(column))
        menu.addSeparator()
        for column in ORDER:
            action = menu.addAction(choice_of(column))
            action.setCheckable(True)
            action.setChecked(not self.isColumnHidden(column))
            # Without names nobody could tell the rows apart.
            action.setEnabled(column != Column.NAME)
            action.triggered.connect(lambda shown, column=column: self._choose(column, shown))
        return menu

    def _sort_by(self, column: Column) -> None:
        """Sort as a click on a title does: a second one the other way round."""
        header, up = self.horizontalHeader(), Qt.SortOrder.AscendingOrder
        again = (header.sortIndicatorSection(), header.sortIndicatorOrder()) == (column, up)
        self.sortByColumn(column, Qt.SortOrder.DescendingOrder if again else up)

    def _open_columns_menu(self, position: QPoint) -> None:
        self.columns_menu().popup(self.horizontalHeader().mapToGlobal(position))

    def _choose(self, column: Column, shown: bool) -> None:
        now = {each for each in Column if not self.isColumnHidden(each)}
        self._choose_columns(now | {column} if shown else now - {column})
        if shown:
            # Else one beyond the edge would come unseen. Qt knows only later how wide it all is.
            self.updateGeometries()
            self.scrollTo(self.rows.index(max(self.rowAt(0), 0), column))

    def _choose_columns(self, columns: set[Column] | None) -> None:
        self._columns.choose(columns)
        self._fit_columns()

    def _keep_typed(self) -> None:
        """Take note of what is being typed, before all rows go and the field with them."""
        index = self.currentIndex()
        field = self.indexWidget(index)
        self._typed = None
        if isinstance(field, QLineEdit):
            session, id_ = self.objects.session, int(index.data(ID))
            place = field.cursorPosition()
            self._typed = _Typed(session, id_, index.column(), field.text(), place)
            # The keyboard is the table's: Qt would give it to the picture, whose commands are keys.
            self.closeEditor(field, QStyledItemDelegate.EndEditHint.NoHint)

    def _type_on(self) -> None:
        """Open the field again where its row is still there."""
        typed, self._typed = self._typed, None
        if typed is None or typed.session is not self.objects.session:
            return
        index = self.rows.index_of(typed.id).siblingAtColumn(typed.column)
        if index.isValid():
            # The selection stays as it is.
            stay = QItemSelectionModel.SelectionFlag.NoUpdate
            self.selectionModel().setCurrentIndex(index, stay)
            self.edit(index)
            field = self.indexWidget(index)
            if isinstance(field, QLineEdit):
                field.setText(typed.text)
                field.setCursorPosition(typed.place)

    def write(self, object_id: int, column: Column) -> None:
        """Let a person type into a cell, in a column that is shown for that.

        Parameters
        ----------
        object_id : int
        column : Column
            Of the name or of the note.
        """
        if self.isColumnHidden(column):
            self._choose(column, True)
        index = self.rows.index_of(object_id).siblingAtColumn(column)
        # The selection stays as it is.
        self.selectionModel().setCurrentIndex(index, QItemSelectionModel.SelectionFlag.NoUpdate)
        self.scrollTo(index)
        self.edit(index)

    def selected_ids(self) -> list[int]:
        """Return the IDs of the selected rows, from top to bottom."""
        if self._selected is None:
            # By ranges: Qt's list of selected rows asks for the flags of every cell.
            ranges = self.selectionModel().selection()
            rows = {row for part in ranges for row in range(part.top(), part.bottom() + 1)}
            indices = (self.rows.index(row, Column.NAME) for row in sorted(rows))
            self._selected = [int(index.data(ID)) for index in indices]
        return list(self._selected)

    def _forget_selected(self, *_: object) -> None:
        self._selected = None

    def show_selection(self, ids: frozenset[int]) -> None:
        """Select these objects' rows and scroll to the first; emits nothing."""
        # Most selections come from here: scrolling to the first row would take it from the mouse.
        if ids == frozenset(self.selected_ids()):
            return
        rows = self._select(ids)
        if rows:
            self.scrollTo(self.rows.index(rows[0], Column.NAME))

    def _hold_selection(self) -> None:
        # Qt remembers a selection over another order cell by cell, and asks Python about each.
        self._held = frozenset(self.selected_ids())
        self._select(frozenset())

    def _select(self, ids: frozenset[int]) -> list[int]:
        """Select these objects' rows, and return them; emits nothing."""
        rows = sorted(index.row() for index in map(self.rows.index_of, ids) if index.isValid())
        # One range for neighbouring rows: Qt slows down with thousands of single ones.
        picked = QItemSelection()
        for run in _runs(rows):
            top, bottom = (self.rows.index(row, Column.NAME) for row in (run[0], run[-1]))
            picked.select(top, bottom)
        flags = (
            QItemSelectionModel.SelectionFlag.ClearAndSelect
            | QItemSelectionModel.SelectionFlag.Rows
        )
        self._silent = True
        self.selectionModel().select(picked, flags)
        self._silent = False
        return rows

    def _emit_selection(self, picked: QItemSelection, dropped: QItemSelection) -> None:
        # A search that leaves rows out is no wish to select them no longer.
        searched_away = picked.isEmpty() and not any(map(self._is_listed, dropped))
        if not self._silent and (dropped.isEmpty() or not searched_away):
            self.ids_selected.emit(frozenset(self.selected_ids()))

    def _is_listed(self, rows: QItemSelectionRange) -> bool:
        """Return whether the first of some rows, which may be about to go, passes the search."""
        source = self.rows.mapToSource(self.rows.index(rows.top(), Column.NAME))
        return self.rows.filterAcceptsRow(source.row(), source.parent())

    def keyboardSearch(self, text: str) -> None:
        """Ignore letters: N, B, I, H and C are commands of the viewer."""

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Select all by Ctrl+A, click a drawn cell by Space; pass letters on to the viewer."""
        current = self.currentIndex()
        if event.key() == Qt.Key.Key_Space and current.column() in self._clicked:
            self._clicked[Column(current.column())].emit(int(current.data(ID)))
            return
        everything = event.matches(QKeySequence.StandardKey.SelectAll)
        editing = self.state() == QAbstractItemView.State.EditingState
        if event.text().strip() and not everything and not editing:
            # napari gets the event next, and its keymap has the commands.
            event.ignore()
            return
        super().keyPressEvent(event)


def _runs(rows: list[int]) -> list[list[int]]:
    """Part ascending rows where one is missing between them."""
    runs: list[list[int]] = []
    for row in rows:
        if runs and runs[-1][-1] == row - 1:
            runs[-1].append(row)
        else:
            runs.append([row])
    return runs
