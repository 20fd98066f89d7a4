"""Shares of work: how far it is, and where it can be cancelled."""

from __future__ import annotations

import os
from concurrent.futures import Future, ThreadPoolExecutor
from threading import Barrier, Event, get_ident
from time import sleep

import pytest

from napari_unpack import tasks
from napari_unpack.tasks import Cancelled, Progress, Share, awaited, beside, relayed
from napari_unpack.thread_count import thread_count


def test_threads_are_as_many_as_the_cores_that_were_granted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("NAPARI_UNPACK_THREADS", raising=False)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3}, raising=False)
    assert thread_count() == 1
    # Where the system does not tell, all there are.
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: 5)
    assert thread_count() == 5
    monkeypatch.setenv("NAPARI_UNPACK_THREADS", "²")
    with pytest.raises(ValueError, match="NAPARI_UNPACK_THREADS must be a whole number"):
        thread_count()


def test_a_part_of_a_share_tells_of_the_whole_work() -> None:
    told: list[tuple[float, str]] = []
    share = Share(lambda fraction, text: told.append((fraction, text)), text="all")
    half = share.part(0.5, 1.0)
    part = half.part(0.0, 0.5, "a quarter")
    part(0.5)
    assert list(half.over("ab")) == ["a", "b"]
    assert told == [
        (0.5, "all"),
        (0.5, "a quarter"),
        (0.625, "a quarter"),
        (0.5, "all"),
        (0.75, "all"),
    ]


def test_slabs_hold_every_slice_once_and_few_voxels(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tasks, "VOXELS_PER_CHECK", 100)
    told: list[float] = []
    share = Share(lambda fraction, _: told.append(fraction))
    assert list(share.slabs((7, 5, 10))) == [(0, 2), (2, 4), (4, 6), (6, 7)]
    assert told == [0.0, 0.25, 0.5, 0.75]
    # A slice is never cut, and nothing has no slabs.
    assert list(share.slabs((2, 50, 50))) == [(0, 1), (1, 2)]
    assert list(share.slabs((0, 5, 5))) == []


@pytest.mark.parametrize("threads", ["1", "2", "8"])
def test_work_on_slabs_is_done_once_each_in_order_and_ends_when_cancelled(
    threads: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tasks, "VOXELS_PER_CHECK", 100)
    monkeypatch.setenv("NAPARI_UNPACK_THREADS", threads)
    told: list[float] = []
    share = Share(lambda fraction, _: told.append(fraction))
    assert share.over_slabs((7, 5, 10), lambda slab: slab) == [(0, 2), (2, 4), (4, 6), (6, 7)]
    assert told == [0.0, 0.25, 0.5, 0.75]
    assert share.over_slabs((0, 5, 5), lambda slab: slab) == []

    done: list[int] = []

    def work(slab: tuple[int, int]) -> None:
        sleep(0.05)
        done.append(slab[0])

    def stop(fraction: float, _: str) -> None:
        if fraction > 0.05:
            raise Cancelled

    with pytest.raises(Cancelled):
        Share(stop).over_slabs((100, 100, 1), work)
    # Those that were begun have ended, and no more begin.
    few = len(done)
    assert 6 <= few < 100
    sleep(0.2)
    assert len(done) == few


def test_several_threads_work_on_slabs_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tasks, "VOXELS_PER_CHECK", 1)
    monkeypatch.setenv("NAPARI_UNPACK_THREADS", "3")
    # Each waits for two others: one after another they would wait for ever.
    together = Barrier(3, timeout=20)
    assert len(Share().over_slabs((3, 1, 1), lambda slab: together.wait())) == 3


def test_waiting_for_another_thread_moves_on_and_can_be_cancelled() -> None:
    told: list[float] = []
    go_on = Event()

    def report(fraction: float, _: str) -> None:
        told.append(fraction)
        if len(told) == 3:
            go_on.set()

    with ThreadPoolExecutor(1) as threads:
        assert awaited(threads.submit(go_on.wait, 20), Share(report))
    assert sorted(set(told)) == told
    assert 0 < told[0] < told[-1] < 1

    def stop(*_: object) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        awaited(Future(), Share(stop))


def test_work_in_a_librarys_code_is_heard_of_every_beat_and_can_be_left() -> None:
    ended, told, done = Event(), [], []

    def work(report: Progress) -> int:
        report(0.5, "sleeping")
        # As a library does that never looks.
        ended.wait(20)
        try:
            report(0.6, "awake")
        except Cancelled:
            done.append("cancelled")
            raise
        return get_ident()

    def leave(fraction: float, text: str) -> None:
        told.append((fraction, get_ident()))
        if len(told) == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        relayed(work, leave)
    fractions = [fraction for fraction, _ in told]
    # The bar goes on meanwhile, and who called is who is told.
    assert 0.5 == fractions[0] < fractions[1] < fractions[-1] < 0.6
    assert {who for _, who in told} == {get_ident()}
    ended.set()
    for _ in range(100):
        if done:
            break
        Event().wait(0.02)
    assert done == ["cancelled"]
    told.clear()
    assert relayed(work, lambda *news: told.append(news)) != get_ident()
    assert [text for _, text in told] == ["sleeping", "awake"]
    # Who does not want to hear of it waits for it as for any other work.
    assert relayed(work, None) == get_ident()


def test_what_fails_on_the_other_thread_fails_here() -> None:
    def work(report: Progress) -> None:
        raise ValueError("no objects")

    with pytest.raises(ValueError, match="no objects"):
        relayed(work, lambda *_: None)


@pytest.mark.parametrize(("threads", "apart"), [("1", False), ("2", True)])
def test_work_beside_a_block_has_a_thread_of_its_own_and_ends_with_it(
    threads: str, apart: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NAPARI_UNPACK_THREADS", threads)
    begun = Event()

    def work() -> int:
        # Alone, it is done before the block, which could not begin it.
        assert not apart or begun.wait(10)
        return get_ident()

    with beside(work) as found:
        begun.set()
    assert found.done()
    assert (found.result() != get_ident()) == apart


def test_a_block_that_fails_waits_for_what_is_beside_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NAPARI_UNPACK_THREADS", "2")
    go, ended = Event(), Event()

    def work() -> None:
        go.wait(10)
        ended.set()

    def fails() -> None:
        with beside(work):
            go.set()
            raise ValueError("in the block")

    with pytest.raises(ValueError, match="in the block"):
        fails()
    assert ended.is_set()
