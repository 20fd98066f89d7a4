"""The rows of the objects in the order of one column."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from qtpy.QtCore import QAbstractItemModel, QAbstractProxyModel, QModelIndex, QObject, Qt, Signal

if TYPE_CHECKING:
    from napari_unpack.widgets.object_model import Index, ObjectModel


class SortedRows(QAbstractProxyModel):
    """A model's rows, sorted by Python on keys made once; each table has an order of its own.

    Qt's own proxy asks Python to compare two rows some ten times a row. It filters what this sorts.

    Signals: `moving`, `moved`, before and after all that Qt does about another order.

    Parameters
    ----------
    model : ObjectModel
        Its rows change by a reset only.
    parent : QObject, optional
    """

    moving = Signal()
    moved = Signal()

    def __init__(self, model: ObjectModel, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._model = model
        self._column, self._descending = -1, False
        self._take(self._order_now())
        self.setSourceModel(model)
        model.modelAboutToBeReset.connect(self.beginResetModel)
        model.modelReset.connect(self._renew)
        model.dataChanged.connect(self._follow)
        model.headerDataChanged.connect(self.headerDataChanged)

    def sort(self, column: int, order: Qt.SortOrder = Qt.SortOrder.AscendingOrder) -> None:
        """Sort by a column; rows that are alike stay in the model's order either way.

        Parameters
        ----------
        column : int
            -1 for the model's order.
        order : Qt.SortOrder
        """
        wanted = column, order == Qt.SortOrder.DescendingOrder
        # A table asks twice: by its header, and itself.
        if wanted != (self._column, self._descending):
            self._column, self._descending = wanted
            self._rearrange()

    def source_row(self, row: int) -> int:
        """Return the model's row of a row here."""
        return self._order[row]

    def _order_now(self) -> list[int]:
        rows = range(self._model.rowCount())
        if self._column < 0:
            return list(rows)
        key = self._model.sort_keys(self._column).__getitem__
        return sorted(rows, key=key, reverse=self._descending)

    def _take(self, order: list[int]) -> None:
        self._order = order
        self._places = [0] * len(order)
        for place, row in enumerate(order):
            self._places[row] = place

    def _renew(self) -> None:
        self._take(self._order_now())
        self.endResetModel()

    def _rearrange(self) -> None:
        order = self._order_now()
        if order == self._order:
            return
        self.moving.emit()
        hint = QAbstractItemModel.LayoutChangeHint.VerticalSortHint
        self.layoutAboutToBeChanged.emit([], hint)
        held = self.persistentIndexList()
        rows = [self._order[index.row()] for index in held]
        self._take(order)
        moved = [
            self.createIndex(self._places[row], index.column())
            for row, index in zip(rows, held, strict=True)
        ]
        self.changePersistentIndexList(held, moved)
        self.layoutChanged.emit([], hint)
        self.moved.emit()

    def _follow(self, first: Index, last: Index) -> None:
        places = self._places[first.row() : last.row() + 1]
        left, right = first.column(), last.column()
        # Of rows that are neighbours in the model alone; those between are drawn once more.
        top, bottom = self.createIndex(min(places), left), self.createIndex(max(places), right)
        self.dataChanged.emit(top, bottom)
        if left <= self._column <= right:
            self._rearrange()

    # What Qt asks of a model.

    def mapToSource(self, index: Index) -> QModelIndex:
        """Return the model's index of one here."""
        if not index.isValid():
            return QModelIndex()
        return self._model.index(self._order[index.row()], index.column())

    def mapFromSource(self, index: Index) -> QModelIndex:
        """Return the index here of one of the model's."""
        if not index.isValid():
            return QModelIndex()
        return self.createIndex(self._places[index.row()], index.column())

    def index(self, row: int, column: int, parent: Index | None = None) -> QModelIndex:
        """Return the index of a cell.

        Parameters
        ----------
        row, column : int
        parent : QModelIndex, optional
            Invalid: the model has no levels.
        """
        inside = 0 <= row < len(self._order) and 0 <= column < self._model.columnCount()
        if not inside or (parent is not None and parent.isValid()):
            return QModelIndex()
        return self.createIndex(row, column)

    def parent(self, index: Index | None = None) -> Any:
        """Return an index's parent, which is none, or that of this object."""
        return super().parent() if index is None else QModelIndex()

    def rowCount(self, parent: Index | None = None) -> int:
        """Return the number of rows."""
        return 0 if parent is not None and parent.isValid() else len(self._order)

    def columnCount(self, parent: Index | None = None) -> int:
        """Return the number of columns."""
        return self._model.columnCount(parent)

    def flags(self, index: Index) -> Qt.ItemFlag:
        """Return what a cell can do, which its column says."""
        # Qt asks for those of all cells of a selection: no index is made for it.
        return self._model.flags(index)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = 0) -> Any:
        """Return the model's own titles, also where there is no row.

        Parameters
        ----------
        section : int
        orientation : Qt.Orientation
        role : int
        """
        return self._model.headerData(section, orientation, role)
