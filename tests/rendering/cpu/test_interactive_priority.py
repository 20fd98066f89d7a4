"""Passes that somebody waits for go first, and nothing waits for ever."""

from __future__ import annotations

from threading import Event, Thread
from time import sleep

import pytest

from napari_unpack.rendering.cpu.thread_pool import (
    CANCELLING,
    INTERACTIVE_PRIORITY,
    InteractivePriority,
    over_bands,
)
from napari_unpack.tasks import Cancelled, Share


def test_bands_begun_by_others_wait_and_own_ones_do_not() -> None:
    begun, go_on, done = Event(), Event(), []

    def slow(_: None, first: int, last: int) -> None:
        del last
        done.append(("slow", first))
        begun.set()
        assert go_on.wait(20)

    other = Thread(target=over_bands, args=(2, slow, lambda: None, 1, 1))
    other.start()
    assert begun.wait(20)
    with INTERACTIVE_PRIORITY.taken():
        assert INTERACTIVE_PRIORITY.mine
        go_on.set()
        over_bands(3, lambda _, first, last: done.append(("own", first)), lambda: None, 1, 1)
    other.join(20)
    assert not INTERACTIVE_PRIORITY.mine
    assert done == [("slow", 0), ("own", 0), ("own", 1), ("own", 2), ("slow", 1)]


@pytest.mark.parametrize("threads", [1, 2])
def test_passes_end_where_their_thread_is_cancelled(threads: int) -> None:
    done = []

    def check(fraction: float, _: str) -> None:
        assert 0 <= fraction <= 1
        if len(done) > 3:
            raise Cancelled

    def band(_: None, first: int, last: int) -> None:
        del last
        sleep(0.01)
        done.append(first)

    with CANCELLING.by(Share(check)), pytest.raises(Cancelled):
        over_bands(1000, band, lambda: None, threads, 1)
    # Threads are asked every fifth of a second.
    assert len(done) < 200
    over_bands(5, band, lambda: None, threads, 1)
    assert done[-1] == 4


def test_patience_ends() -> None:
    way = InteractivePriority()
    assert way.give(5.0) == 5.0
    with way.taken(), way.taken():
        left = way.give(0.02)
        assert left <= 0
        assert way.give(left) == left
    assert way.give(5.0) == 5.0
    assert not way.mine


@pytest.mark.parametrize("threads", [1, 2])
def test_short_passes_tell_one_after_the_other_and_never_fall(threads: int) -> None:
    told: list[float] = []
    with CANCELLING.by(Share(lambda done, _text: told.append(done))):
        for _ in range(5):
            over_bands(8, lambda _, first, last: None, lambda: None, threads, 1)
    assert len(told) >= 5
    assert told == sorted(told)
