"""Texts in places where Qt guesses whether they are HTML: names of objects may look like it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from html import escape
from typing import TYPE_CHECKING
from weakref import ref

from qtpy.QtCore import QPoint, Qt
from qtpy.QtWidgets import QLabel, QToolTip, QWidget

from napari_unpack.layers import compat

if TYPE_CHECKING:
    import napari


def literal(text: str) -> str:
    """Return a text for a tooltip, in which Qt then shows every sign as it stands."""
    # What Qt takes for HTML has one of these; all else stays as it is.
    if "<" not in text and "&lt;" not in text:
        return text
    # As plain text, it breaks where it says and nowhere else.
    return f"<p style='white-space: pre'>{escape(text, quote=False)}</p>"


def show_tip(place: QPoint, text: str, over: QWidget) -> None:
    """Show a text beside the mouse; none takes away what is shown.

    Parameters
    ----------
    place : QPoint
        On the screen.
    text : str
    over : QWidget
        What the mouse is on.
    """
    QToolTip.showText(place, literal(text), over)


def show_status_as_written(viewer: napari.Viewer) -> Callable[[], None]:
    """Have the status bar show names as they are, where Qt takes some for HTML.

    Returns
    -------
    callable
        Puts back how it was.
    """
    window = compat.native_window(viewer)
    labels = [] if window is None else window.statusBar().findChildren(QLabel)
    before = [(ref(words), words.textFormat()) for words in labels]
    for words in labels:
        words.setTextFormat(Qt.TextFormat.PlainText)

    def put_back() -> None:
        for known, form in before:
            words = known()
            # The window may have gone.
            if words is not None:
                with suppress(RuntimeError):
                    words.setTextFormat(form)

    return put_back
