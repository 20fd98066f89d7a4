"""What is over is let go of: controllers that were closed."""

from __future__ import annotations

import gc
import weakref

from napari_unpack.viewer.controller import SessionController


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
