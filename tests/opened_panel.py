"""A small pile of touching balls, and what the tests do with panels."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QEvent, QObject

from napari_unpack.widgets.unpacking_widget import UnpackingWidget

SIDE = 48
CENTERS = ((14, 34, 14), (14, 34, 34), (34, 34, 14), (34, 34, 34), (24, 17, 24), (24, 15, 42))
RADIUS = 10.2
DENSITIES = (600, 3000, 1350, 900, 4500, 2000)
SMALL = (900, 600)
"""A window: wide enough for sprites, small for a software rasteriser."""


def pile_of_balls() -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Make six balls that touch, one upon four and one beside it: densities and true labels."""
    grid = np.indices((SIDE,) * 3).astype(np.float64)
    volume = np.full((SIDE,) * 3, 20, dtype=np.uint16)
    labels = np.zeros((SIDE,) * 3, dtype=np.uint16)
    for k, center in enumerate(CENTERS):
        radius = RADIUS if k < 5 else 5.0
        offset = grid - np.array(center).reshape(3, 1, 1, 1)
        inside = (np.einsum("izyx,izyx->zyx", offset, offset) < radius**2) & (labels == 0)
        labels[inside] = k + 1
        volume[inside] = DENSITIES[k]
    return volume, labels


def add_bag(viewer: Any) -> tuple[Any, Any]:
    """Add the pile as an image and its labels, as some other tool would have."""
    volume, labels = pile_of_balls()
    placed = {"scale": (2.0, 1.0, 1.0), "units": ("mm",) * 3}
    true = viewer.add_labels(labels, name="expert", visible=False, **placed)
    image = viewer.add_image(volume, name="bag", **placed)
    return image, true


def open_panel(viewer: Any, qtbot: QtBot) -> UnpackingWidget:
    """Dock the panel as napari does."""
    panel = UnpackingWidget(viewer)
    viewer.window.add_dock_widget(panel, name="Virtual Unpacking", area="right")
    return panel


def press(qtbot: QtBot, button: Any) -> None:
    """Click a button the way a person can: visible and enabled."""
    assert button.isEnabled(), f"{button.text()!r} is disabled"
    button.click()


def controller_with(panel: UnpackingWidget, qtbot: QtBot, labels: Any = None) -> Any:
    """Press the first step's button and wait for the stage; return its session."""
    panel.segment.labels_input.choose(labels)
    press(qtbot, panel.segment.start)
    qtbot.waitUntil(lambda: panel.workspace.controller is not None, timeout=90000)
    qtbot.waitUntil(lambda: not panel.segment.progress.running, timeout=20000)
    return panel.workspace.session


def at_rest(controller: Any, qtbot: QtBot) -> None:
    """Wait until nothing moves by itself any more and every picture is right."""
    qtbot.waitUntil(lambda: not controller.renderer.flight_animation.running, timeout=60000)
    assert controller.settle(120)


def rest(panel: UnpackingWidget, qtbot: QtBot) -> None:
    """Wait until the stage is at rest and the sections have heard of all that changed."""
    at_rest(panel.workspace.controller, qtbot)
    qtbot.waitUntil(lambda: panel.workspace.settled, timeout=20000)


def states(session: Any) -> dict[int, str]:
    """Return the state's name of every object."""
    return {i: state.name for i, state in session.states.items()}


class Closed(QObject):
    """Counts how often a window is closed, and has it stay: napari's fixture closes it."""

    count = 0

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() != QEvent.Type.Close:
            return False
        self.count += 1
        event.ignore()
        return True
