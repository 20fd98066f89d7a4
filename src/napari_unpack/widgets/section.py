"""A numbered step of the panel, settings that fold away, and the small parts both are made of."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING

from qtpy.QtCore import Qt
from qtpy.QtWidgets import (
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QLayout,
    QScrollArea,
    QSizePolicy,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from napari_unpack.widgets.narrow import Button, Link, Row, Words
from napari_unpack.widgets.theme import GAP, LABELS

if TYPE_CHECKING:
    from qtpy.QtGui import QMouseEvent

    from napari_unpack.viewer.scheduler import Scheduler

# Until what was shown or hidden has moved all that lies around it, box by box.
LAID_OUT_MS = 50


class Section(QWidget):
    """One step. Fill `contents`; lock it with a reason until it can work.

    A click on the title folds the step away or opens it again.

    Parameters
    ----------
    number, title : str
        In the badge, and beside it.
    """

    def __init__(self, number: str, title: str) -> None:
        super().__init__()
        self._badge = label(number, "badge")
        self._badge.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self._status = Words()
        self._status.setProperty("role", "status")
        self._reason = label("", "hint", wrap=True)
        self._reason.hide()
        self.body = QWidget(self)
        self.contents = column(self.body)
        self.fold = QToolButton()
        self.fold.setProperty("role", "link")
        self.fold.setArrowType(Qt.ArrowType.DownArrow)
        self.fold.setCheckable(True)
        self.fold.setToolTip("Fold this step away, or open it again.")
        self.fold.setAccessibleName(f"Fold {title}")
        self.fold.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        self.fold.toggled.connect(self._fold)

        self.head = _Head(self.fold)
        line = QHBoxLayout(self.head)
        line.setContentsMargins(0, 0, 0, 0)
        line.setSpacing(GAP + 2)
        line.addWidget(self._badge)
        line.addWidget(label(title, "title"))
        line.addWidget(self._status, stretch=1)
        line.addWidget(self.fold)
        outer = column(self)
        outer.addWidget(self.head)
        outer.addWidget(self._reason)
        outer.addWidget(self.body, stretch=1)
        outer.addStretch(0)

    def _fold(self, away: bool) -> None:
        self.fold.setArrowType(Qt.ArrowType.LeftArrow if away else Qt.ArrowType.DownArrow)
        self.body.setVisible(not away and self.reason == "")

    def lock(self, reason: str | None) -> None:
        """Disable and fold away the step and say why, or enable it again.

        Parameters
        ----------
        reason : str or None
            A sentence on what has to happen first; None unlocks.
        """
        self.body.setEnabled(reason is None)
        self._reason.setText(reason or "")
        self._reason.setVisible(reason is not None)
        # A locked step shows its reason alone, and comes back as it was folded.
        self.body.setVisible(reason is None and not self.fold.isChecked())
        self.fold.setVisible(reason is None)
        self._badge.setProperty("ready", "true" if reason is None else "false")
        # Qt reads a property used by a style sheet again only when told to.
        self._badge.style().unpolish(self._badge)
        self._badge.style().polish(self._badge)

    @property
    def reason(self) -> str:
        """Why the step is locked; empty when it is not."""
        return str(self._reason.text())

    def set_status(self, text: str) -> None:
        """Show a few words at the right of the title."""
        self._status.setText(text)

    @property
    def status(self) -> str:
        """The words at the right of the title."""
        return str(self._status.text())


class _Head(QWidget):
    """The title's line, all of it a handle to fold the step."""

    def __init__(self, fold: QToolButton) -> None:
        super().__init__()
        self._fold = fold
        self.setCursor(Qt.CursorShape.PointingHandCursor)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        self._fold.toggle()


class Collapsible(QWidget):
    """Settings that few people need, behind one small line of text.

    Parameters
    ----------
    title, tooltip : str
    """

    def __init__(self, title: str, tooltip: str) -> None:
        super().__init__()
        self.toggle = Link()
        self.toggle.setProperty("role", "link")
        self.toggle.setText(title)
        self.toggle.setToolTip(tooltip)
        self.toggle.setCheckable(True)
        self.toggle.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextBesideIcon)
        self.toggle.setArrowType(Qt.ArrowType.RightArrow)
        self.toggle.setCursor(Qt.CursorShape.PointingHandCursor)
        self._box = QWidget()
        self.contents = column(self._box)
        self._box.hide()
        layout = column(self)
        layout.addWidget(self.toggle)
        layout.addWidget(self._box)
        self.toggle.toggled.connect(self._show)

    def _show(self, shown: bool) -> None:
        self.toggle.setArrowType(Qt.ArrowType.DownArrow if shown else Qt.ArrowType.RightArrow)
        self._box.setVisible(shown)


def column(owner: QWidget) -> QVBoxLayout:
    """Give a widget a plain vertical layout with the panel's spacing."""
    layout = QVBoxLayout(owner)
    layout.setContentsMargins(0, 0, 0, 0)
    layout.setSpacing(GAP)
    return layout


def row(*widgets: QWidget) -> Row:
    """Put widgets side by side, sharing the width equally; on two lines where one is too short."""
    layout = Row()
    for widget in widgets:
        layout.add(widget)
    return layout


def form(**fields: QWidget) -> QFormLayout:
    """Make a two-column layout of labelled fields, aligned with those of the other steps."""
    layout = QFormLayout()
    layout.setContentsMargins(0, 0, 0, 0)
    layout.setHorizontalSpacing(GAP + 2)
    layout.setVerticalSpacing(GAP)
    layout.setFieldGrowthPolicy(QFormLayout.FieldGrowthPolicy.AllNonFixedFieldsGrow)
    layout.setRowWrapPolicy(QFormLayout.RowWrapPolicy.WrapLongRows)
    for name, field in fields.items():
        title = label(name.replace("_", " "), "field")
        # Alike, so that the fields of all steps stand in one line; long names have what they need.
        title.setMinimumWidth(LABELS)
        title.setBuddy(field)
        if not field.accessibleName():
            field.setAccessibleName(title.text())
        layout.addRow(title, field)
    return layout


def scroll_to(widget: QWidget) -> None:
    """Scroll the panel so far that a widget is in sight: all of it, or from its top on."""
    above = widget.parentWidget()
    while above is not None and not isinstance(above, QScrollArea):
        above = above.parentWidget()
    if above is None:
        return
    # Qt's own would show no more of a table than the row that has the keyboard.
    bar, room = above.verticalScrollBar(), above.viewport().height()
    top = widget.mapTo(above.widget(), widget.rect().topLeft()).y()
    lowest, highest = top + widget.height() + GAP - room, top - GAP
    bar.setValue(min(max(bar.value(), lowest), highest))


def scroll_to_new(widget: QWidget, scheduler: Scheduler) -> None:
    """Scroll the panel to what appears in it now, once that is laid out.

    Parameters
    ----------
    widget : QWidget
    scheduler : Scheduler
    """
    # What was over at once is hidden by then.
    scheduler.later(LAID_OUT_MS, lambda: scroll_to(widget) if widget.isVisible() else None)


def order_tabs(layout: QLayout) -> None:
    """Have Tab go through a layout as it is laid out, whatever was made first."""
    widgets = list(_laid_out(layout))
    for before, after in pairwise(widgets):
        QWidget.setTabOrder(before, after)


def _laid_out(layout: QLayout) -> Iterator[QWidget]:
    for place in range(layout.count()):
        item = layout.itemAt(place)
        widget = item.widget()
        inside = item.layout() if widget is None else widget.layout()
        if inside is not None:
            yield from _laid_out(inside)
        elif isinstance(widget, Row):
            yield from (w for w in widget.controls if w.focusPolicy() & Qt.FocusPolicy.TabFocus)
        elif widget is not None and widget.focusPolicy() & Qt.FocusPolicy.TabFocus:
            yield widget


def label(text: str, role: str, wrap: bool = False, rich: bool = False) -> QLabel:
    """Make a label.

    Parameters
    ----------
    text, role : str
        The roles are those of the style sheet in `theme`.
    wrap : bool
        Break long text, so that it does not widen the panel.
    rich : bool
        Whether texts are HTML, in which names are to be escaped; else every sign is shown.
    """
    made = QLabel()
    # Told: Qt's own guess would take a name such as "Doll <body>" for HTML.
    made.setTextFormat(Qt.TextFormat.RichText if rich else Qt.TextFormat.PlainText)
    made.setText(text)
    made.setProperty("role", role)
    made.setWordWrap(wrap)
    if wrap:
        # Ignored, or a long sentence would widen the whole panel.
        made.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
    return made


def keep_room(widget: QWidget) -> None:
    """Have a widget that comes and goes keep its place, so that what is below it stays."""
    policy = widget.sizePolicy()
    policy.setRetainSizeWhenHidden(True)
    widget.setSizePolicy(policy)


def keep_lines(sentence: QLabel, count: int) -> None:
    """Have a label of rich text keep room for some lines, so that what is below it stays.

    Parameters
    ----------
    sentence : QLabel
        In the font that it is shown in: of what was not shown yet that is another.
    count : int
    """
    text = sentence.text()
    sentence.setText("<br>".join("x" * count))
    sentence.setMinimumHeight(0)
    sentence.setMinimumHeight(sentence.sizeHint().height())
    sentence.setText(text)


def button(text: str, tooltip: str, primary: bool = False) -> Button:
    """Make a push button.

    Parameters
    ----------
    text, tooltip : str
    primary : bool
        Whether it stands out; a section has one such.
    """
    made = Button(text)
    made.setToolTip(tooltip)
    # Keys such as N and Space belong to the viewer, also just after a click.
    made.setFocusPolicy(Qt.FocusPolicy.TabFocus)
    if primary:
        made.setProperty("role", "primary")
    return made


def rule() -> QWidget:
    """Make the thin line between two sections."""
    line = QWidget()
    line.setProperty("role", "rule")
    line.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
    line.setFixedHeight(1)
    return line
