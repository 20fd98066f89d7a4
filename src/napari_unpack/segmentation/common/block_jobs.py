"""Work on the blocks of a volume, a few at once: on threads here, or on workers elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from itertools import islice
from threading import Event
from typing import Any

from napari_unpack.segmentation.common.array_source import Box, Source
from napari_unpack.tasks import BEAT_SECONDS, Cancelled, Progress, Share
from napari_unpack.thread_count import thread_count


@dataclass(frozen=True, eq=False)
class BlockJob:
    """Some work on a block.

    Parameters
    ----------
    work : callable
        `work(source, *given, share)`; it reads no more than `box` of the source.
    box : tuple of slice
        In the volume.
    given : tuple
    """

    work: Callable[..., Any]
    box: Box
    given: tuple[Any, ...]


RunBlocks = Callable[[Source, Iterator[BlockJob], int, Share], Iterator[Any]]
"""`run(source, jobs, count, share)` yields the results of so many jobs on the blocks of a volume.

They come in order, while a few jobs are under way; the share is told of what is done every
`BEAT_SECONDS`. What a job raises comes out in its turn. Then, and where the share is cancelled,
jobs that wait are never begun.
"""


def run_in_turn(
    source: Source, jobs: Iterator[BlockJob], count: int, share: Share
) -> Iterator[Any]:
    """Do one job after the other on this thread, with all of the processor; they report themselves.

    Parameters
    ----------
    source, jobs, count, share
        As for `RunBlocks`.
    """
    for n, job in enumerate(jobs):
        yield job.work(source, *job.given, share.part(n / count, (n + 1) / count))


def run_on_threads(
    source: Source, jobs: Iterator[BlockJob], count: int, share: Share
) -> Iterator[Any]:
    """Do jobs on at most eight threads of this process; they end when the share is cancelled.

    Parameters
    ----------
    source, jobs, count, share
        As for `RunBlocks`.
    """
    # More threads than eight wait for the store, and each holds a block in memory.
    most = min(thread_count(), 8)
    stopping, done, numbered = Event(), [0.0] * count, enumerate(jobs)

    def told(n: int) -> Progress:
        def report(fraction: float, _text: str) -> None:
            if stopping.is_set():
                raise Cancelled
            done[n] = fraction

        return report

    with ThreadPoolExecutor(most, "unpack") as threads:

        def begun(few: int) -> list[Future[Any]]:
            return [
                threads.submit(job.work, source, *job.given, Share(told(n)))
                for n, job in islice(numbered, few)
            ]

        waiting = begun(most + 1)
        try:
            while waiting:
                while not wait(waiting[:1], BEAT_SECONDS).done:
                    share(sum(done) / count)
                result = waiting.pop(0).result()
                waiting += begun(1)
                yield result
        finally:
            # The user cancelled, or a block failed: what runs ends soon, what waits never does.
            stopping.set()
            for future in waiting:
                future.cancel()
