"""What becomes of the picture when the GL context beneath it goes: it comes back."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import pytest

from napari_unpack.layers import compat
from viewer_fixtures import canvas, complaints


class Elsewhere:
    """Moves a viewer's canvas to a window of its own and back, as Qt's docks do.

    Qt makes a new context for each; the old ones are lost with all that is in them.
    """

    def __init__(self, viewer: Any, qtbot: Any) -> None:
        from qtpy.QtWidgets import QMainWindow

        self.native = compat.native_canvas(viewer).native
        self.home = self.native.parentWidget().layout()
        self.window, self.qtbot = QMainWindow(), qtbot
        qtbot.addWidget(self.window)
        self.lost = 0

    def go(self) -> None:
        self._listen()
        self.window.resize(self.native.size())
        self.window.setCentralWidget(self.native)
        self.window.show()
        self._wait()

    def come_back(self) -> None:
        self._listen()
        self.home.addWidget(self.native)
        self._wait()

    def _listen(self) -> None:
        self.before = self.native.context()
        self.before.aboutToBeDestroyed.connect(self._count)

    def _count(self) -> None:
        self.lost += 1

    def _wait(self) -> None:
        shown = lambda: self.native.isValid() and self.native.context() is not self.before  # noqa: E731
        self.qtbot.waitUntil(shown, timeout=20000)


@pytest.mark.parametrize("backend", ["cpu", "gl"])
def test_a_context_that_is_replaced_shows_the_bag_sprites_and_other_layers_again(
    staged, qtbot, caplog, backend
) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = False
    viewer.add_points([[20, 24, 80]], size=12, face_color="lime", name="mine")
    controller.backend = backend
    controller.unpack(1)
    controller.finish()
    assert controller.settle(60)
    before, heard = canvas(viewer), []
    controller.events.message.connect(heard.append)
    elsewhere = Elsewhere(viewer, qtbot)
    elsewhere.go()
    qtbot.waitUntil(lambda: len(heard) == 1, timeout=20000)
    assert controller.settle(60)
    assert controller.casts_with == backend
    assert canvas(viewer).std(axis=(0, 1)).max() > 10
    assert complaints(viewer) == []
    elsewhere.come_back()
    qtbot.waitUntil(lambda: len(heard) == 2, timeout=20000)
    qtbot.waitUntil(lambda: canvas(viewer).shape == before.shape, timeout=20000)
    assert controller.settle(60)
    assert elsewhere.lost == 2
    assert "drawn again" in heard[0]
    after = canvas(viewer)
    assert np.quantile(np.abs(after - before).max(axis=2), 0.999) <= 3.0
    assert complaints(viewer) == []
    controller.restore(1)
    controller.finish()
    assert controller.settle(60)
    assert complaints(viewer) == []
    assert [r.getMessage() for r in caplog.records if r.levelno >= logging.ERROR] == []
