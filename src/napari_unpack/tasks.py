"""A piece of work for any thread: its key, its progress, its cancelling and its result."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Generic, TypeVar

T = TypeVar("T")

Progress = Callable[[float, str], None]
"""Called with the share done, 0 to 1, and what is done now; raises `Cancelled` to stop the work."""


class Cancelled(Exception):
    """The user asked the work to stop."""


def no_progress(_fraction: float, _text: str) -> None:
    """Report to nobody.

    Parameters
    ----------
    _fraction, _text : float, str
        See `Progress`.
    """


@dataclass(frozen=True, eq=False)
class Task(Generic[T]):
    """Work whose inputs are frozen, so that it may run on any thread at any time.

    Parameters
    ----------
    key : hashable
        What the result depends on. A result is stored under it, so a stale one is never found.
    run : callable
        Takes a `Progress` and returns the result; touches no Qt, no GL and no session.
    """

    key: Hashable
    run: Callable[[Progress], T]


@dataclass(frozen=True, eq=False)
class TaskResult(Generic[T]):
    """What became of a task.

    Parameters
    ----------
    result : object
        What the task returned; None where it raised.
    error : Exception, optional
        What it raised.
    """

    result: T | None = None
    error: Exception | None = None

    @property
    def cancelled(self) -> bool:
        """Whether the task stopped because it was asked to."""
        return isinstance(self.error, Cancelled)

    def get(self) -> T:
        """Return the result.

        Raises
        ------
        Exception
            What the task raised.
        """
        if self.error is not None:
            raise self.error
        return self.result  # type: ignore[return-value]


def attempt(work: Callable[[], T]) -> TaskResult[T]:
    """Return what becomes of work: its result, or the error that it raised."""
    try:
        return TaskResult(work())
    except Exception as error:
        return TaskResult(error=error)
