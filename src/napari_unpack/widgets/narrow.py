"""Controls that are never wider than the panel, whatever their words and the language.

A row that finds no room breaks into lines; a control that is too long for a line of its own is
shortened there, and says the whole in its tooltip.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from qtpy.QtCore import QEvent, QSize, Qt
from qtpy.QtGui import QPainter
from qtpy.QtWidgets import (
    QCheckBox,
    QComboBox,
    QLabel,
    QLineEdit,
    QPushButton,
    QSizePolicy,
    QStyle,
    QStyleOptionComboBox,
    QToolButton,
    QWidget,
)

from napari_unpack.viewer.plain_text import literal, show_tip
from napari_unpack.widgets.kept_keyboard import KeepsKeyboard
from napari_unpack.widgets.theme import GAP

if TYPE_CHECKING:
    from qtpy.QtGui import QPaintEvent, QResizeEvent
    from qtpy.QtWidgets import QAbstractButton

# Letters of a choice that are seen at least, beside its label.
LETTERS = 6

# Pixels: nothing is shortened further, and it is less than any panel is wide.
LEAST = 40

# Of a line to type into: Qt has it as wide as that many letters x.
SIZED = 17


if TYPE_CHECKING:

    class _Control(QAbstractButton):
        """What the classes below are."""

else:
    # Qt's classes cannot have a second one of Qt beside them.
    _Control = object


class _Shortened(KeepsKeyboard, _Control):
    """Of a control: it paints as much of its text as there is room for."""

    _grows, _lacking = QSizePolicy.Policy.Preferred, 0

    def __init__(self, text: str = "") -> None:
        super().__init__()
        self.setText(text)
        self.setSizePolicy(self._grows, QSizePolicy.Policy.Fixed)

    def minimumSizeHint(self) -> QSize:
        """Return a size that widens no panel."""
        hint = super().minimumSizeHint()
        return QSize(min(LEAST, hint.width()), hint.height())

    def paintEvent(self, event: QPaintEvent) -> None:
        """Paint it, shortened where it has to be."""
        # All but the text needs what it needs. Asked for its size it must not be shortened.
        self._lacking = max(0, self.sizeHint().width() - self.width())
        super().paintEvent(event)
        self._lacking = 0

    def initStyleOption(self, option: Any) -> None:
        """Shorten the text that is painted, and that alone."""
        super().initStyleOption(option)
        if self._lacking:
            metrics = option.fontMetrics
            room = metrics.horizontalAdvance(self.text()) - self._lacking
            option.text = metrics.elidedText(self.text(), Qt.TextElideMode.ElideRight, room)

    def event(self, event: QEvent) -> bool:
        """Say the whole text in the tooltip where it is not to be read."""
        if event.type() == QEvent.Type.ToolTip and self.width() < self.sizeHint().width():
            return _tell(self, event, self.text())
        return bool(super().event(event))


class Button(_Shortened, QPushButton):
    """A push button."""


class Check(_Shortened, QCheckBox):
    """A check box."""


class Link(_Shortened, QToolButton):
    """A small button that looks like a line of text."""

    _grows = QSizePolicy.Policy.Maximum


class Choice(QComboBox):
    """A drop-down list in the room that it finds; its entries are listed whole.

    Parameters
    ----------
    *texts : str
    """

    def __init__(self, *texts: str) -> None:
        super().__init__()
        self.addItems(texts)
        # Or its longest entry would widen the whole panel.
        self.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.setMinimumContentsLength(LETTERS)

    def showPopup(self) -> None:
        """List all entries as wide as they are."""
        self.view().setMinimumWidth(self.view().sizeHintForColumn(0))
        super().showPopup()

    def initStyleOption(self, option: Any) -> None:
        """Shorten the text that is painted, and that alone."""
        super().initStyleOption(option)
        option.currentText = option.fontMetrics.elidedText(
            self.currentText(), Qt.TextElideMode.ElideRight, self._room(option)
        )

    def event(self, event: QEvent) -> bool:
        """Say the whole text in the tooltip where it is not to be read."""
        if event.type() == QEvent.Type.ToolTip:
            option, text = QStyleOptionComboBox(), self.currentText() or self.placeholderText()
            self.initStyleOption(option)
            if self._room(option) < self.fontMetrics().horizontalAdvance(text):
                return _tell(self, event, text)
        return bool(super().event(event))

    def _room(self, option: Any) -> int:
        field = QStyle.SubControl.SC_ComboBoxEditField
        combo = QStyle.ComplexControl.CC_ComboBox
        return int(self.style().subControlRect(combo, option, field, self).width())


class Field(QLineEdit):
    """A line to type into that has room for what it says while it is empty."""

    def sizeHint(self) -> QSize:
        """Return a size in which its placeholder is to be read."""
        hint, measure = super().sizeHint(), self.fontMetrics().horizontalAdvance
        lacking = measure(self.placeholderText()) - SIZED * measure("x")
        return QSize(hint.width() + max(0, lacking), hint.height())


class Words(QLabel):
    """A line of text that is shortened where there is no room for it."""

    def __init__(self) -> None:
        super().__init__()
        self.setTextFormat(Qt.TextFormat.PlainText)

    def minimumSizeHint(self) -> QSize:
        """Return a size that widens no panel."""
        return QSize(0, super().minimumSizeHint().height())

    def paintEvent(self, event: QPaintEvent) -> None:
        """Write as much as there is room for."""
        room, side = self.contentsRect(), Qt.AlignmentFlag.AlignRight
        text = self.fontMetrics().elidedText(self.text(), Qt.TextElideMode.ElideRight, room.width())
        place, lit = side | Qt.AlignmentFlag.AlignVCenter, self.isEnabled()
        painter, role = QPainter(self), self.foregroundRole()
        self.style().drawItemText(painter, room, place, self.palette(), lit, text, role)

    def setText(self, text: str) -> None:
        """Show a text, the whole of it in the tooltip."""
        super().setText(text)
        self.setToolTip(literal(text))


class Row(KeepsKeyboard, QWidget):
    """Widgets side by side that share the width equally, on more lines where one has no room.

    Notes
    -----
    No layout: those that Python writes may be asked by Qt once Python has ended.
    """

    def __init__(self) -> None:
        super().__init__()
        self.controls: list[QWidget] = []
        self._weights: dict[QWidget, int] = {}
        policy = QSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Minimum)
        policy.setHeightForWidth(True)
        self.setSizePolicy(policy)

    def add(self, widget: QWidget, weight: int = 1) -> None:
        """Add a widget at the right.

        Parameters
        ----------
        widget : QWidget
        weight : int
            How many shares of the width it takes; 0 for what it needs and no more.
        """
        widget.setParent(self)
        self.controls.append(widget)
        self._weights[widget] = weight

    def heightForWidth(self, width: int) -> int:
        """Return the height of all lines in a width, pixels."""
        heights = [height for _, height in self._lines(width)]
        return sum(heights) + GAP * max(0, len(heights) - 1)

    def sizeHint(self) -> QSize:
        """Return the size of one line."""
        shown = [w for w in self.controls if not w.isHidden()]
        return QSize(_needed(shown), max((_hint(w).height() for w in shown), default=0))

    def minimumSizeHint(self) -> QSize:
        """Return a size in which nothing is shortened further."""
        least = [w.minimumSizeHint().width() for w in self.controls if not w.isHidden()]
        return QSize(max(least, default=0), self.sizeHint().height())

    def event(self, event: QEvent) -> bool:
        """Place the widgets anew where one has other words, or came or went."""
        if event.type() == QEvent.Type.LayoutRequest:
            self.updateGeometry()
            self._place()
        return bool(super().event(event))

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Place the widgets in the new width."""
        super().resizeEvent(event)
        self._place()

    def _place(self) -> None:
        top = 0
        for line, height in self._lines(self.width()):
            left = 0
            for widget, width in self._widths(line):
                widget.setGeometry(left, top, width, height)
                left += width + GAP
            top += height + GAP

    def _lines(self, width: int) -> Iterator[tuple[list[QWidget], int]]:
        """Yield which widgets stand on each line, and its height."""
        lines: list[list[QWidget]] = []
        for widget in self.controls:
            if widget.isHidden():
                continue
            if lines and _needed([*lines[-1], widget]) <= width:
                lines[-1].append(widget)
            else:
                lines.append([widget])
        yield from ((line, max(_hint(w).height() for w in line)) for line in lines)

    def _widths(self, line: list[QWidget]) -> Iterator[tuple[QWidget, int]]:
        """Yield the width of each widget of a line: its share, or what it needs if that is more."""
        left = self.width() - GAP * (len(line) - 1)
        weights = {widget: self._weights[widget] for widget in line}
        shares, given = sum(weights.values()), {}
        # Who needs more than a share takes it first; the others share what is left.
        for widget in sorted(line, key=lambda w: -_hint(w).width() / max(weights[w], 1e-3)):
            share = left * weights[widget] // max(shares, 1)
            given[widget] = min(left, max(_hint(widget).width(), share), widget.maximumWidth())
            left, shares = left - given[widget], shares - weights[widget]
        yield from ((widget, given[widget]) for widget in line)


def _hint(widget: QWidget) -> QSize:
    return widget.sizeHint().boundedTo(widget.maximumSize()).expandedTo(widget.minimumSize())


def _needed(line: list[QWidget]) -> int:
    return sum(int(_hint(w).width()) for w in line) + GAP * max(0, len(line) - 1)


def _tell(widget: QWidget, event: Any, whole: str) -> bool:
    """Show a tooltip that begins with the whole text."""
    show_tip(event.globalPos(), "\n".join(filter(None, (whole, widget.toolTip()))), widget)
    return True
