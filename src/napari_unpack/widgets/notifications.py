"""Errors and messages become one sentence in napari's notifications."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime, timedelta

SHOWN = timedelta(seconds=4)
"""How long napari shows a notice."""

EXPECTED = (ValueError, TypeError, KeyError, MemoryError, OSError)
"""What bad input and full machines raise; anything else is a defect and keeps its traceback."""


def sentence(error: BaseException) -> str:
    """Turn an exception into a sentence for people.

    Parameters
    ----------
    error : BaseException

    Returns
    -------
    str
        Its message with a capital letter and a full stop.
    """
    text = str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)
    if isinstance(error, MemoryError):
        text = text or "there is not enough memory for this volume"
    text = " ".join(text.split()) or type(error).__name__
    return text[0].upper() + text[1:] + ("" if text[-1] in ".!?" else ".")


def inform(text: str) -> None:
    """Say something that needs no action."""
    from napari.utils.notifications import show_info

    if not _stands_there(text):
        show_info(text)


def warn(text: str) -> None:
    """Say why something could not be done."""
    from napari.utils.notifications import show_warning

    if not _stands_there(text):
        show_warning(text)


def _stands_there(text: str) -> bool:
    """Tell whether the last thing said was this, and is still shown.

    napari lays one notice over the other, and keeps them as long as its window is not in front.
    """
    from napari.utils.notifications import notification_manager

    said = notification_manager.records[-1:]
    return any(s.message == text and datetime.now() - s.date < SHOWN for s in said)


@contextmanager
def spoken(*also: type[Exception]) -> Iterator[None]:
    """Turn expected errors of the block into warnings; let defects through.

    Parameters
    ----------
    *also : exception types
        What is expected of this block beside `EXPECTED`.
    """
    expected: tuple[type[Exception], ...] = (*EXPECTED, *also)
    try:
        yield
    except expected as error:
        warn(sentence(error))
