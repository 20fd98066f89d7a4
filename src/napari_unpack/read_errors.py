"""One boundary around everything that reads a file: any failure is one sentence that names it."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from napari_unpack.file_sizes import TooLargeError
from napari_unpack.tasks import Cancelled

# These write pages about a damaged file, tracebacks among them, of which the last line is told.
_LOGS = ("pydicom", "tifffile")

_LONGEST = 400
"""Characters of a message: what fits into a window."""


@contextmanager
def read_errors_told(file: Path, wanted: str = "a file of this format") -> Iterator[None]:
    """Turn whatever a damaged file has a library raise into one sentence.

    Parameters
    ----------
    file : Path
    wanted : str
        What it should be, with its article.

    Raises
    ------
    ValueError
        Naming the file, and what was found in it.
    PermissionError
        If it may not be read.
    FileNotFoundError, ImportError, TooLargeError, Cancelled
        As they are: these say already what is to be done.
    """
    try:
        with _silent():
            yield
    except (FileNotFoundError, ImportError, TooLargeError, Cancelled):
        raise
    except PermissionError as error:
        raise PermissionError(
            f"{error.filename or file} may not be read by you: change who may, or copy it"
        ) from error
    except ValueError as error:
        # Some quote what they found, which may be pages of bytes.
        sentence = " ".join(str(error).split())[:_LONGEST]
        # The whole path: the name alone may be a word of any sentence, or a part of one.
        named = re.search(rf"(?<!\w){re.escape(str(file))}(?!\w)", str(error))
        if named and sentence == str(error):
            raise
        # A library's own sentence may not say which file it was given, and go on for lines.
        raise ValueError(sentence if named else f"{file}: {sentence}") from error
    except OSError as error:
        if error.strerror is None:
            raise _damaged(file, wanted, error) from error
        # What the system says: a disk that fails, links in a circle, a name that is too long.
        raise ValueError(f"{file} cannot be read: {error.strerror}") from error
    except MemoryError as error:
        raise ValueError(f"{file} asks for more memory than there is: is it damaged?") from error
    except Exception as error:
        # Whatever a damaged file may hold: each library has errors of its own for it.
        raise _damaged(file, wanted, error) from error


def _damaged(file: Path, wanted: str, error: Exception) -> ValueError:
    reason = " ".join(f"{type(error).__name__}: {error}".split())
    return ValueError(f"{file} is damaged, not whole, or not {wanted} ({reason[:_LONGEST]})")


@contextmanager
def _silent() -> Iterator[None]:
    # One that another reader has silenced is that reader's to restore.
    loggers = [logging.getLogger(name) for name in _LOGS]
    before = {logger: logger.level for logger in loggers if logger.level <= logging.CRITICAL}
    for logger in before:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in before.items():
            logger.setLevel(level)
