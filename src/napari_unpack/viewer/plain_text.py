"""Texts in places where Qt guesses whether they are HTML: names of objects may look like it."""

from __future__ import annotations

from html import escape

from qtpy.QtCore import QPoint
from qtpy.QtWidgets import QToolTip, QWidget


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
