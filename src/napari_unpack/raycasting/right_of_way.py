"""Who may use the processor's cores first: what a person waits for.

A picture of the turned bag takes all cores for a tenth of a second. A click that falls into it
would share them, and be answered half as fast.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Condition, get_ident
from time import monotonic

PATIENCE = 0.25
"""Seconds that one worker lets others go first in all: nothing waits for ever."""


class RightOfWay:
    """Lets the passes of some threads go before those of all others, band by band."""

    def __init__(self) -> None:
        self._changed = Condition()
        self._holders: list[int] = []

    @contextmanager
    def taken(self) -> Iterator[None]:
        """Let passes begun by this thread go first."""
        own = get_ident()
        with self._changed:
            self._holders.append(own)
        try:
            yield
        finally:
            with self._changed:
                self._holders.remove(own)
                self._changed.notify_all()

    @property
    def mine(self) -> bool:
        """Whether this thread goes first."""
        return get_ident() in self._holders

    def give(self, patience: float) -> float:
        """Wait while others go first, at most so many seconds; return how many are left."""
        if not self._holders or patience <= 0:
            return patience
        start = monotonic()
        with self._changed:
            self._changed.wait_for(lambda: not self._holders, patience)
        return patience - (monotonic() - start)


WAY = RightOfWay()
"""Of this process, as its cores are."""
