"""Threads that share the rows of an image, and the priority of interactive work among them.

Kernels release the GIL, so plain Python threads use every core; numba's own `parallel=True` is
not used because its thread layers abort when two Python threads enter them. An image of the turned
bag takes all cores for a tenth of a second. A click during that time would be answered half as
fast, so threads that answer a person go first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from threading import Condition, Event, Lock, get_ident
from time import monotonic
from typing import TypeVar

from napari_unpack.tasks import BEAT_SECONDS, SILENT, Share
from napari_unpack.thread_count import thread_count

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


class Cancelling:
    """Lets the passes that a thread begins be called off between two bands."""

    def __init__(self) -> None:
        self._shares: dict[int, Share] = {}

    @contextmanager
    def by(self, share: Share) -> Iterator[None]:
        """Report to a share while passes begun by this thread run, which may cancel them."""
        own, furthest = get_ident(), 0.0

        def onward(done: float, text: str) -> None:
            # One pass after another begins at 0; nobody knows how many there are.
            nonlocal furthest
            furthest = max(furthest, done)
            share(furthest, text)

        self._shares[own] = Share(onward)
        try:
            yield
        finally:
            del self._shares[own]

    @property
    def mine(self) -> Share:
        """What passes begun by this thread report to."""
        return self._shares.get(get_ident(), SILENT)


# By thread, for the same reason.
CANCELLING = Cancelling()


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
    Between bands, workers let those go first that a thread with the interactive priority has begun,
    and end where the thread that began them is cancelled; see `Cancelling`.
    """
    workers = max(1, threads or thread_count())
    height = band or max(1, -(-rows // (16 * workers)))
    workers = min(workers, -(-rows // height))
    starts = iter(range(0, rows, height))
    lock, begun = Lock(), 0
    goes_first, share, stopping = INTERACTIVE_PRIORITY.mine, CANCELLING.mine, Event()
    caller = get_ident()

    def worker() -> State:
        nonlocal begun
        own = state()
        patience = 0.0 if goes_first else PATIENCE
        while True:
            patience = INTERACTIVE_PRIORITY.give(patience)
            if get_ident() == caller:
                share(begun / rows)
            with lock:
                first = None if stopping.is_set() else next(starts, None)
                if first is None:
                    return own
                begun = first
            work(own, first, min(first + height, rows))

    if workers <= 1:
        return [worker()]
    # Passes that take less than a beat come one after the other.
    share()
    with ThreadPoolExecutor(workers, "unpack") as pool:
        futures = [pool.submit(worker) for _ in range(workers)]
        try:
            while wait(futures, BEAT_SECONDS).not_done:
                share(begun / rows)
        finally:
            stopping.set()
        return [future.result() for future in futures]
