"""A piece of work for any thread: its key, its progress, its cancelling and its result."""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from contextvars import copy_context
from dataclasses import dataclass
from math import prod
from queue import Empty, Queue
from threading import Event
from typing import Generic, TypeVar

from napari_unpack.thread_count import thread_count

T = TypeVar("T")

Slab = tuple[int, int]
"""First slice of a slab of a volume, and the one after its last."""

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


# Between two checks of a loop over voxels: a quarter of a second at the 0.6 us a voxel that the
# dearest of them takes.
VOXELS_PER_CHECK = 2**18


@dataclass(frozen=True)
class Share:
    """A share of some work, itself a `Progress`: every call tells how far it is, and may cancel.

    Parameters
    ----------
    report : Progress
        Of the whole work.
    start, stop : float
        How much of the whole is done before and after this share.
    text : str
        What is done in it.
    """

    report: Progress = no_progress
    start: float = 0.0
    stop: float = 1.0
    text: str = ""

    def __call__(self, done: float = 0.0, text: str = "") -> None:
        """Tell how much of this share is done.

        Parameters
        ----------
        done : float
            In [0, 1].
        text : str
            By default the share's.

        Raises
        ------
        Cancelled
            Or whatever the progress raises to stop the work.
        """
        self.report(self.start + (self.stop - self.start) * done, text or self.text)

    def part(self, start: float, stop: float, text: str = "") -> Share:
        """Begin a part of this share.

        Parameters
        ----------
        start, stop : float
            In [0, 1], of this share.
        text : str
            By default this share's.
        """
        span = self.stop - self.start
        part = Share(
            self.report, self.start + span * start, self.start + span * stop, text or self.text
        )
        part()
        return part

    def over(self, items: Collection[T]) -> Iterator[T]:
        """Yield items of equal work."""
        for n, item in enumerate(items):
            self(n / len(items))
            yield item

    def slabs(self, shape: tuple[int, ...]) -> Iterator[Slab]:
        """Yield the first slice of each of some slabs of a volume, and the one after its last."""
        yield from self.over(_slabs(shape))

    def over_slabs(self, shape: tuple[int, ...], work: Callable[[Slab], T]) -> list[T]:
        """Do some work on every slab of a volume, on several threads; return what each gives.

        Parameters
        ----------
        shape : tuple of int
            Of the volume.
        work : callable
            Given a slab, see `slabs`. Whatever the order it must give the same: it writes to its
            slab alone. It runs at once only where it leaves Python to others, as `nogil` does.
        """
        slabs = _slabs(shape)
        threads = min(thread_count(), len(slabs))
        if threads < 2:
            return [work(slab) for slab in self.over(slabs)]
        with ThreadPoolExecutor(threads, "unpack-slabs") as pool:
            begun = [pool.submit(work, slab) for slab in slabs]
            try:
                return [future.result() for future in self.over(begun)]
            finally:
                # Cancelled, it waits for the slabs that were begun.
                pool.shutdown(wait=False, cancel_futures=True)


def _slabs(shape: tuple[int, ...]) -> list[Slab]:
    slices = max(1, VOXELS_PER_CHECK // max(1, prod(shape[1:])))
    return [(first, min(first + slices, shape[0])) for first in range(0, shape[0], slices)]


SILENT = Share()

# A wait for another thread checks so often.
BEAT_SECONDS = 0.2


def awaited(future: Future[T], share: Share) -> T:
    """Return what another thread finds; meanwhile the share moves on, ever more slowly.

    Parameters
    ----------
    future : Future
    share : Share
        Raises to cancel; whoever waits then has to stop the other thread.
    """
    beats = 0
    while not wait([future], BEAT_SECONDS).done:
        beats += 1
        # Half of it after a second.
        share(beats / (beats + 1 / BEAT_SECONDS))
    return future.result()


def attended(work: Callable[[], T], share: Share) -> T:
    """Do work that tells nothing on a thread of its own, while the share moves on.

    Parameters
    ----------
    work : callable
        Left to itself where the share cancels it, so that it may change nothing.
    share : Share
    """
    thread = ThreadPoolExecutor(1, "unpack-attended")
    try:
        return awaited(thread.submit(work), share)
    finally:
        thread.shutdown(wait=False)


@contextmanager
def beside(work: Callable[[], T]) -> Iterator[Future[T]]:
    """Do work that tells nothing on a thread of its own, beside what the block does.

    Parameters
    ----------
    work : callable
        The block ends once it has; where there is one thread, it is done before the block.

    Yields
    ------
    Future
        Of what it gives.
    """
    if thread_count() < 2:
        done: Future[T] = Future()
        done.set_result(work())
        yield done
        return
    with ThreadPoolExecutor(1, "unpack-beside") as pool:
        yield pool.submit(work)


# What a bar moves on in a beat without news, of what is left.
CREEP = 1 / 2000


def relayed(work: Callable[[Progress], T], progress: Progress | None) -> T:
    """Do work on a thread of its own; this one hears of it every beat and can leave at any time.

    Parameters
    ----------
    work : callable
        Given a progress that ends it, at its next report, once `progress` has raised. It may be
        in a library's code for long until then, so it may change nothing but its result.
    progress : callable, optional
        Called from this thread alone, with every report and in every beat without one.
    """
    if progress is None:
        return work(no_progress)
    # Two: the last report and the end, once nobody listens. More would let the work run ahead.
    told: Queue[tuple[float, str] | None] = Queue(2)
    left = Event()

    def report(fraction: float, text: str) -> None:
        if left.is_set():
            raise Cancelled
        told.put((fraction, text))

    def run() -> T:
        try:
            return work(report)
        finally:
            told.put(None)

    thread = ThreadPoolExecutor(1, "unpack-relayed")
    future = thread.submit(copy_context().run, run)
    try:
        _relay(told, progress)
        return future.result()
    finally:
        left.set()
        while not told.empty():
            told.get()
        thread.shutdown(wait=False)
        # Its error would keep this frame, and that the arrays of the work.
        del future


def _relay(told: Queue[tuple[float, str] | None], progress: Progress) -> None:
    shown, text = 0.0, ""
    while True:
        try:
            news = told.get(timeout=BEAT_SECONDS)
        except Empty:
            # At 0 nobody knows yet how long it takes.
            shown += CREEP * (1 - shown) * (shown > 0)
        else:
            if news is None:
                return
            shown, text = max(shown, news[0]), news[1]
        progress(shown, text)


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
