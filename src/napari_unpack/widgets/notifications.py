"""Errors and messages become one sentence in napari's notifications."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime, timedelta

from napari_unpack.tasks import Cancelled

# How long napari shows a notification.
SHOWN = timedelta(seconds=4)

# What bad input and a full memory or disk raise; anything else is a defect with a traceback.
EXPECTED = (ValueError, TypeError, KeyError, MemoryError, OSError)


def sentence(error: BaseException) -> str:
    """Turn an exception into a sentence.

    Returns
    -------
    str
        Its message with a capital letter and a full stop.
    """
    # str() of a KeyError puts quotes around its message.
    text = str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)
    if isinstance(error, MemoryError):
        # NumPy says how much was wanted; Python itself says nothing.
        text = text or "there is not enough memory for this volume"
    text = " ".join(text.split()) or type(error).__name__
    return text[0].upper() + text[1:] + ("" if text[-1] in ".!?" else ".")


def inform(text: str) -> None:
    """Show a message that needs no action."""
    from napari.utils.notifications import show_info

    if not _is_shown(text):
        show_info(text)


def warn(text: str) -> None:
    """Show why something could not be done."""
    from napari.utils.notifications import show_warning

    if not _is_shown(text):
        show_warning(text)


def _is_shown(text: str) -> bool:
    """Return whether the last notification was this one, and is still shown."""
    from napari.utils.notifications import notification_manager

    # napari lays one notification over the other and keeps all while its window is not in front:
    # a key held down would bury the viewer under copies of one sentence.
    last = notification_manager.records[-1:]
    return any(n.message == text and datetime.now() - n.date < SHOWN for n in last)


def show_error(error: Exception) -> None:
    """Show the error of a task as `errors_shown` does; cancelling is none."""
    if not isinstance(error, Cancelled):
        with errors_shown():
            raise error


@contextmanager
def errors_shown(*also: type[Exception]) -> Iterator[None]:
    """Show expected errors of the block as warnings; let defects through.

    Parameters
    ----------
    *also : exception types
        Expected of this block beside `EXPECTED`.
    """
    expected: tuple[type[Exception], ...] = (*EXPECTED, *also)
    try:
        yield
    except expected as error:
        warn(sentence(error))
