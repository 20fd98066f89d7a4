"""The table of objects: eyes and swatches to click, sorting, searching, and a context menu."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from qtpy.QtCore import (
    QEvent,
    QItemSelection,
    QItemSelectionModel,
    QPointF,
    QRectF,
    QSize,
    QSortFilterProxyModel,
    Qt,
    Signal,
)
from qtpy.QtGui import QColor, QPainter, QPainterPath, QPen
from qtpy.QtWidgets import (
    QAbstractItemView,
    QHeaderView,
    QStyle,
    QStyledItemDelegate,
    QTableView,
    QWidget,
)

from napari_unpack.session.object_state import ObjectState
from napari_unpack.widgets.object_model import ID, SORT, STATE, Column, Index, ObjectModel

if TYPE_CHECKING:
    from qtpy.QtCore import QAbstractItemModel, QModelIndex, QObject
    from qtpy.QtGui import QKeyEvent, QResizeEvent
    from qtpy.QtWidgets import QStyleOptionViewItem

Draw = Callable[[QPainter, QRectF, "QModelIndex", "QStyleOptionViewItem"], None]

# Height of a row, pixels: an eye and a swatch with room around them.
ROW = 24

WIDTHS = {
    Column.EYE: 22,
    Column.SWATCH: 18,
    Column.NAME: 68,
    Column.STATE: 54,
    Column.VOLUME: 44,
    Column.SIZE: 92,
    Column.DENSITY: 60,
    Column.CONFIDENCE: 44,
}
# Texts that a column must have room for in any font, with `PADDING` around them.
WIDEST = {
    Column.NAME: "Object 100",
    Column.STATE: "packed",
    Column.VOLUME: "1234",
    Column.SIZE: "99 × 99 × 99",
    Column.DENSITY: "1234",
    Column.CONFIDENCE: "99 %",
}

# Pixels: Qt's own margins of a cell and those of the style sheet.
PADDING = 15

# Columns shown where the table is wide enough, the most wanted first; tooltips have them all.
WHERE_ROOM = (Column.CONFIDENCE, Column.SIZE, Column.DENSITY)


class ObjectFilter(QSortFilterProxyModel):
    """Sort by any column; keep rows by a text in the name or by state."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._text = ""
        self._states: frozenset[ObjectState] | None = None
        self.setSortRole(SORT)
        self.setDynamicSortFilter(True)

    def keep_text(self, text: str) -> None:
        """Keep the objects whose name or ID contains a text."""
        self._text = text.strip().casefold()
        self._renew()

    def keep_states(self, states: frozenset[ObjectState] | None) -> None:
        """Keep the objects in these states, or in any for None."""
        self._states = states
        self._renew()

    def _renew(self) -> None:
        # Qt 6.9 deprecates invalidateFilter; before it there is nothing else.
        if hasattr(self, "beginFilterChange"):
            self.beginFilterChange()
            self.endFilterChange()
        else:
            self.invalidateFilter()

    def lessThan(self, left: Index, right: Index) -> bool:
        """Compare two rows by the keys that the model keeps.

        Parameters
        ----------
        left, right : QModelIndex
            Of the model, in the column to sort by.
        """
        keys = self.sourceModel().sort_keys(left.column())
        return bool(keys[left.row()] < keys[right.row()])

    def filterAcceptsRow(self, row: int, parent: Index) -> bool:
        """Return whether a row is listed.

        Parameters
        ----------
        row : int
            Of the model.
        parent : QModelIndex
            Invalid: the model has no levels.
        """
        model = self.sourceModel()
        index = model.index(row, Column.NAME, parent)
        if self._states is not None and model.data(index, STATE) not in self._states:
            return False
        name = str(model.data(index, Qt.ItemDataRole.DisplayRole)).casefold()
        return self._text in name or self._text == str(model.data(index, ID))


class _ClickDelegate(QStyledItemDelegate):
    """A drawn cell that emits one click and leaves the selection as it is."""

    clicked = Signal(int)

    def __init__(self, draw: Draw, parent: QWidget) -> None:
        super().__init__(parent)
        self._draw = draw

    def editorEvent(
        self,
        event: QEvent,
        model: QAbstractItemModel,
        option: QStyleOptionViewItem,
        index: QModelIndex,
    ) -> bool:
        if (
            event.type() == QEvent.Type.MouseButtonRelease
            and event.button() == Qt.MouseButton.LeftButton
        ):
            self.clicked.emit(int(index.data(ID)))
        # True says that the event was used: the view then leaves the selection alone.
        return event.type() in (
            QEvent.Type.MouseButtonPress,
            QEvent.Type.MouseButtonRelease,
            QEvent.Type.MouseButtonDblClick,
        )

    def paint(self, painter: QPainter, option: QStyleOptionViewItem, index: QModelIndex) -> None:
        if option.state & QStyle.StateFlag.State_Selected:
            painter.fillRect(option.rect, option.palette.highlight())
        painter.save()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        self._draw(painter, QRectF(option.rect), index, option)
        painter.restore()

    def sizeHint(self, option: QStyleOptionViewItem, index: QModelIndex) -> QSize:
        return QSize(ROW, ROW)


def _draw_swatch(
    painter: QPainter, cell: QRectF, index: QModelIndex, _option: QStyleOptionViewItem
) -> None:
    """Draw the hue of an object: full in the bag, else a ring."""
    color = index.data(Qt.ItemDataRole.DecorationRole)
    square = QRectF(0, 0, 12, 12)
    square.moveCenter(cell.center())
    if index.data(STATE) is ObjectState.PACKED:
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(color)
    else:
        painter.setPen(QPen(color, 2))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        square.adjust(1, 1, -1, -1)
    painter.drawRoundedRect(square, 3, 3)


def _draw_eye(
    painter: QPainter, cell: QRectF, index: QModelIndex, option: QStyleOptionViewItem
) -> None:
    """Draw an eye: open, or faint and closed where the object is hidden."""
    hidden = index.data(STATE) is ObjectState.HIDDEN
    color = QColor(option.palette.text().color())
    color.setAlphaF(0.35 if hidden else 0.85)
    middle = cell.center()
    painter.setPen(QPen(color, 1.3))
    lids = QPainterPath(middle + QPointF(-7, 0))
    lids.quadTo(middle + QPointF(0, 8), middle + QPointF(7, 0))
    if not hidden:
        lids.quadTo(middle + QPointF(0, -8), middle + QPointF(-7, 0))
    painter.drawPath(lids)
    if not hidden:
        painter.setBrush(color)
        painter.drawEllipse(middle, 2.0, 2.0)


class ObjectTable(QTableView):
    """The table, which emits what the user does and changes nothing itself.

    Signals: `eye_clicked`, `swatch_clicked` (object ID), `ids_selected` (frozenset of IDs, by
    the user only).
    """

    eye_clicked = Signal(int)
    swatch_clicked = Signal(int)
    ids_selected = Signal(object)

    def __init__(self, model: ObjectModel) -> None:
        super().__init__()
        self.objects = model
        self.rows = ObjectFilter(self)
        self.rows.setSourceModel(model)
        self.setModel(self.rows)
        model.modelReset.connect(self._fit_columns)
        self._silent = False
        self._selected: list[int] | None = None
        self._widths: dict[Column, int] = {}
        self._delegates = _ClickDelegate(_draw_eye, self), _ClickDelegate(_draw_swatch, self)
        self._delegates[0].clicked.connect(self.eye_clicked)
        self._delegates[1].clicked.connect(self.swatch_clicked)
        self.setItemDelegateForColumn(Column.EYE, self._delegates[0])
        self.setItemDelegateForColumn(Column.SWATCH, self._delegates[1])
        self._set_looks()
        rows = self.rows
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
        # The ends of names tell objects apart: a number, a mark.
        self.setTextElideMode(Qt.TextElideMode.ElideMiddle)
        # By pixels, as wide columns would jump otherwise.
        self.setHorizontalScrollMode(QAbstractItemView.ScrollMode.ScrollPerPixel)
        self.verticalHeader().hide()
        self.verticalHeader().setSectionResizeMode(QHeaderView.ResizeMode.Fixed)
        self.verticalHeader().setDefaultSectionSize(ROW)
        header = self.horizontalHeader()
        header.setHighlightSections(False)
        header.setMinimumSectionSize(18)
        header.setSectionsMovable(True)
        self._fit_columns()
        header.setSectionResizeMode(Column.NAME, QHeaderView.ResizeMode.Stretch)
        self.setSortingEnabled(True)
        self.sortByColumn(Column.NAME, Qt.SortOrder.AscendingOrder)
        self.setMinimumHeight(ROW * 6)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Show as many columns as there is room for, so that nothing is cut off."""
        super().resizeEvent(event)
        self._fit_columns()

    def _fit_columns(self) -> None:
        measure = self.fontMetrics().horizontalAdvance
        widths = {c: max(w, measure(WIDEST.get(c, "")) + PADDING) for c, w in WIDTHS.items()}
        # Setting widths resizes the view, which would call this again without end.
        if widths != self._widths:
            self._widths = widths
            for column, width in widths.items():
                self.setColumnWidth(column, width)
        room = self.viewport().width() - sum(widths[c] for c in Column if c not in WHERE_ROOM)
        for column in WHERE_ROOM:
            wanted = column != Column.CONFIDENCE or self.objects.knows_confidence
            room -= widths[column] if wanted else 0
            self.setColumnHidden(column, room < 0 or not wanted)

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
        known = [row for row in map(self.objects.row_of, ids) if row is not None]
        there = [self.rows.mapFromSource(self.objects.index(row, Column.NAME)) for row in known]
        rows = sorted(index.row() for index in there if index.isValid())
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
        if rows:
            self.scrollTo(self.rows.index(rows[0], Column.NAME))

    def _emit_selection(self, *_: object) -> None:
        if not self._silent:
            self.ids_selected.emit(frozenset(self.selected_ids()))

    def keyboardSearch(self, text: str) -> None:
        """Ignore letters: N, B, I, H and C are commands of the viewer."""

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Pass letters and Ctrl+Z on to the viewer; arrows and the like stay the table's."""
        if event.text().strip() and self.state() != QAbstractItemView.State.EditingState:
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
