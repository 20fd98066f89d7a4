"""The cells of the table of objects: an eye, a swatch and a flag to click, texts and names."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING

from qtpy.QtCore import QEvent, QModelIndex, QPointF, QRectF, QSize, Qt, Signal
from qtpy.QtGui import (
    QColor,
    QFont,
    QFontInfo,
    QFontMetrics,
    QPainter,
    QPainterPath,
    QPen,
    QPolygonF,
)
from qtpy.QtWidgets import QStyle, QStyledItemDelegate, QWidget

from napari_unpack.session.object_state import ObjectState
from napari_unpack.widgets.object_columns import MARKS, Column
from napari_unpack.widgets.object_model import FLAG, ID, STATE

if TYPE_CHECKING:
    from qtpy.QtCore import QAbstractItemModel
    from qtpy.QtWidgets import QStyleOptionViewItem

Draw = Callable[[QPainter, QRectF, "QModelIndex", "QStyleOptionViewItem"], None]

# Height of a row, pixels: an eye and a swatch with room around them.
ROW = 24

# Pixels: Qt's own margins of a cell and those of the style sheet.
PADDING = 15

# What tells names apart that begin alike: a number, a mark.
END = re.compile(r"\s\S{1,3}$")

# A second line is smaller than the first by the factor that browsers have for small print.
SMALLER = 5 / 6

FLAG_COLORS = {"suspicious": "#e5484d", "cleared": "#46a758"}


class ClickDelegate(QStyledItemDelegate):
    """A drawn cell that emits one click and leaves the selection as it is.

    Parameters
    ----------
    draw : callable
        Takes (painter, cell, index, option).
    parent : QWidget
    """

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
        """Emit a click of the left button; leave no press to the view.

        Parameters
        ----------
        event, model, option, index
            As Qt gives them.
        """
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
        """Draw the cell, framed where it has the keyboard.

        Parameters
        ----------
        painter, option, index
            As Qt gives them.
        """
        if option.state & QStyle.StateFlag.State_Selected:
            painter.fillRect(option.rect, option.palette.highlight())
        painter.save()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        self._draw(painter, QRectF(option.rect), index, option)
        if option.state & QStyle.StateFlag.State_HasFocus:
            # Space acts on this cell.
            painter.setPen(QPen(option.palette.text().color(), 1, Qt.PenStyle.DotLine))
            painter.setBrush(Qt.BrushStyle.NoBrush)
            painter.drawRect(QRectF(option.rect).adjusted(1.5, 1.5, -1.5, -1.5))
        painter.restore()

    def sizeHint(self, option: QStyleOptionViewItem, index: QModelIndex) -> QSize:
        """Return a square as high as a row.

        Parameters
        ----------
        option, index
            As Qt gives them.
        """
        return QSize(ROW, ROW)


class TextDelegate(QStyledItemDelegate):
    """A text, which stays as it is being typed."""

    def setEditorData(self, editor: QWidget, index: QModelIndex) -> None:
        """Fill the field once.

        Parameters
        ----------
        editor, index
            As Qt gives them.
        """
        # Again with all news of the object, such as where it flies.
        if not editor.property("filled"):
            super().setEditorData(editor, index)
            editor.setProperty("filled", True)


class NameDelegate(TextDelegate):
    """A name, and beneath it the state where the state has no column."""

    says_state = False

    def height(self, font: QFont) -> int:
        """Return the height of a row in a font."""
        if not self.says_state:
            return ROW
        return max(ROW, QFontMetrics(font).height() + QFontMetrics(_small(font)).height() + 4)

    def initStyleOption(self, option: QStyleOptionViewItem, index: QModelIndex) -> None:
        """Cut off what has no room, but for a number at the end.

        Parameters
        ----------
        option, index
            As Qt gives them.
        """
        super().initStyleOption(option, index)
        if self.says_state:
            option.text = ""
        elif option.rect.isValid():
            room = option.rect.width() - PADDING
            option.text = _shortened(option.text, option.fontMetrics, room)

    def paint(self, painter: QPainter, option: QStyleOptionViewItem, index: QModelIndex) -> None:
        """Draw the name, and the state below it where it has no column.

        Parameters
        ----------
        painter, option, index
            As Qt gives them.
        """
        super().paint(painter, option, index)
        if not self.says_state:
            return
        painter.save()
        state = index.siblingAtColumn(Column.STATE)
        left, color = Qt.AlignmentFlag.AlignLeft, option.palette.text().color()
        cell = option.rect.adjusted(PADDING // 2, 2, -4, -2)
        first, second = (
            left | side for side in (Qt.AlignmentFlag.AlignTop, Qt.AlignmentFlag.AlignBottom)
        )
        for font, side, text in (
            (option.font, first, index.data()),
            (_small(option.font), second, state.data()),
        ):
            painter.setFont(font)
            painter.setPen(color)
            shown = _shortened(text, QFontMetrics(font), cell.width())
            painter.drawText(cell, side, shown)
            # What can be done with an object is as plain as its name; where it is, is not.
            color.setAlphaF(1.0 if text in MARKS else 0.7)
        painter.restore()


def _draw_swatch(
    painter: QPainter, cell: QRectF, index: QModelIndex, _option: QStyleOptionViewItem
) -> None:
    """Draw the colour of an object: full in the bag, else a ring; its opacity inside."""
    color = index.data(Qt.ItemDataRole.DecorationRole)
    square = QRectF(0, 0, 12, 12).adjusted(1, 1, -1, -1)
    square.moveCenter(cell.center())
    painter.setBrush(Qt.BrushStyle.NoBrush)
    if index.data(STATE) is ObjectState.PACKED:
        painter.setBrush(color)
    rim = QColor(color)
    # An object that is nearly transparent keeps a swatch that one can see and click.
    rim.setAlphaF(1.0)
    painter.setPen(QPen(rim, 2))
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


def _draw_flag(
    painter: QPainter, cell: QRectF, index: QModelIndex, option: QStyleOptionViewItem
) -> None:
    """Draw a flag: filled for what is suspicious, a tick for what is cleared, else faint."""
    flag, middle = index.data(FLAG), cell.center()
    color = QColor(FLAG_COLORS.get(flag) or option.palette.text().color())
    if flag is None:
        color.setAlphaF(0.25)
    painter.setPen(QPen(color, 2.0 if flag == "cleared" else 1.3, cap=Qt.PenCapStyle.RoundCap))
    if flag == "cleared":
        tick = [QPointF(-5, 0), QPointF(-1.5, 4), QPointF(5, -4)]
        painter.drawPolyline(QPolygonF([middle + point for point in tick]))
        return
    painter.drawLine(middle + QPointF(-4, -6), middle + QPointF(-4, 6))
    painter.setBrush(color if flag else Qt.BrushStyle.NoBrush)
    cloth = [QPointF(-4, -6), QPointF(5, -3), QPointF(-4, 0)]
    painter.drawPolygon(QPolygonF([middle + point for point in cloth]))


def _shortened(text: str, metrics: QFontMetrics, room: int) -> str:
    """Return as much of a text as there is room for, with a number or mark at its end."""
    found = END.search(text)
    end = found[0] if found else ""
    rest, right = text.removesuffix(end), Qt.TextElideMode.ElideRight
    return metrics.elidedText(rest, right, room - metrics.horizontalAdvance(end)) + end


def _small(font: QFont) -> QFont:
    """Return a font for a second line."""
    small = QFont(font)
    small.setPixelSize(round(SMALLER * QFontInfo(font).pixelSize()))
    return small


# Columns of drawn cells; a click on one acts at once.
DRAWN = {Column.EYE: _draw_eye, Column.SWATCH: _draw_swatch, Column.FLAG: _draw_flag}
