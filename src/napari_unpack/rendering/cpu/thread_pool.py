"""Threads that share the rows of an image, and the priority of interactive work among them.

Kernels release the GIL, so plain Python threads use every core; numba's own `parallel=True` is
not used because its thread layers abort when two Python threads enter them. An image of the turned
bag takes all cores for a tenth of a second. A click during that time would be answered half as
fast, so threads that answer a person go first.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from threading import Condition, Lock, get_ident
from time import monotonic
from typing import TypeVar

# Seconds that one worker lets others go first in all: nothing waits for ever.
PATIENCE = 0.25


class InteractivePriority:
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


# Of this process, as its cores are.
INTERACTIVE_PRIORITY = InteractivePriority()


State = TypeVar("State")


def over_bands(
    rows: int,
    work: Callable[[State, int, int], None],
    state: Callable[[], State],
    threads: int | None = None,
    band: int | None = None,
) -> list[State]:
    """Run work over all rows, bands taken by free threads; return the state of every worker.

    Parameters
    ----------
    rows : int
        How many rows there are.
    work : callable
        Takes (state, first row, row after the last).
    state : callable
        Makes what one thread keeps between its bands, such as counters of its own.
    threads : int, optional
        Workers, by default one a core.
    band : int, optional
        Rows of a band; by default about 16 bands a worker.

    Notes
    -----
    Between bands, workers let those go first that a thread with the interactive priority has begun.
    """
    workers = max(1, threads or os.cpu_count() or 1)
    height = band or max(1, -(-rows // (16 * workers)))
    workers = min(workers, -(-rows // height))
    starts = iter(range(0, rows, height))
    lock = Lock()
    goes_first = INTERACTIVE_PRIORITY.mine

    def worker() -> State:
        own = state()
        patience = 0.0 if goes_first else PATIENCE
        while True:
            patience = INTERACTIVE_PRIORITY.give(patience)
            with lock:
                first = next(starts, None)
            if first is None:
                return own
            work(own, first, min(first + height, rows))

    if workers <= 1:
        return [worker()]
    with ThreadPoolExecutor(workers, "unpack") as pool:
        futures = [pool.submit(worker) for _ in range(workers)]
        return [future.result() for future in futures]
