"""What is over is let go of: stages that were closed, and what finished jobs worked on."""

from __future__ import annotations

import gc
import weakref

from napari_unpack.viewer.controller import SessionController
from napari_unpack.widgets.job import Job


class Heavy:
    """Something that a job works on."""

    def work(self, _progress: object) -> int:
        return 3


def test_a_closed_controller_and_its_session_are_let_go_of_while_the_window_lives(
    make_napari_viewer_proxy, bag, qtbot
) -> None:
    from napari_unpack.session import Session

    viewer = make_napari_viewer_proxy(show=True)
    controller = SessionController(viewer, Session(*bag))
    controller.open()
    assert controller.settle(60)
    kept = weakref.ref(controller), weakref.ref(controller.session)
    controller.close()
    del controller

    def gone() -> bool:
        # Threads and Qt's queue let go of their last piece of work in their own time.
        gc.collect()
        return [one() for one in kept] == [None, None]

    qtbot.waitUntil(gone, timeout=20000)


def test_a_finished_job_keeps_nothing_of_what_it_worked_on(make_napari_viewer_proxy, qtbot) -> None:
    make_napari_viewer_proxy()
    job, heavy = Job(), Heavy()
    kept = weakref.ref(heavy)
    with qtbot.waitSignal(job.ended, timeout=20000):
        job.start(heavy.work)
    del heavy
    gc.collect()
    assert kept() is None
