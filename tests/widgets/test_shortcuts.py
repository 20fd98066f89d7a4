"""Every key of the panel, pressed on the canvas as a person does."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import Qt

from keys import Keys
from napari_unpack.layers import compat
from opened_panel import SMALL, add_bag, controller_with, open_panel, states

Viewers = Callable[..., Any]
CONTROL, SHIFT = Qt.KeyboardModifier.ControlModifier, Qt.KeyboardModifier.ShiftModifier
PLAIN = Qt.KeyboardModifier.NoModifier


class Desk:
    """A viewer with the panel open on the pile of balls."""

    def __init__(self, viewer: Any, qtbot: QtBot) -> None:
        self.viewer, self.qtbot = viewer, qtbot
        viewer.window.resize(*SMALL)
        self.panel = open_panel(viewer, qtbot)
        self.image, self.labels = add_bag(viewer)
        self.session = controller_with(self.panel, qtbot, self.labels)
        self.controller = self.panel.workspace.controller
        self.controller.seconds = 0.1
        self.controller.recolor_at_rest = False
        assert self.controller.settle(60)

    def press(self, key: Qt.Key, held: Any = PLAIN) -> None:
        """Press and release a key with the mouse on the canvas."""
        self.qtbot.keyClick(compat.native_canvas(self.viewer).native, key, held)

    def rest(self) -> None:
        """Wait until everybody has landed."""
        self.qtbot.waitUntil(lambda: not self.controller.flying, timeout=20000)
        assert self.controller.settle(30)

    def count(self, state: str) -> int:
        """Count the objects in a state."""
        return list(states(self.session).values()).count(state)

    def activate(self, layer: Any) -> None:
        """Make a layer the active one, as a click in the layer list does."""
        self.viewer.layers.selection.active = compat.unwrap(layer)


@pytest.fixture
def desk(make_napari_viewer: Viewers, qtbot: QtBot) -> Iterator[Desk]:
    made = Desk(make_napari_viewer(show=True), qtbot)
    yield made
    made.panel.end()


def test_every_key_acts_whatever_picture_layer_is_active(desk: Desk) -> None:
    controller = desk.controller
    for layer in (controller.packed, controller.transition, controller.sprites, desk.image):
        desk.activate(layer)
        every_key_acts(desk, layer is desk.image)


def every_key_acts(desk: Desk, on_the_users_image: bool) -> None:
    session = desk.session
    session.select([])

    desk.press(Qt.Key.Key_N)
    desk.rest()
    (out,) = (i for i, s in states(session).items() if s == "UNPACKED")

    desk.press(Qt.Key.Key_I)
    assert desk.count("INSPECTED") == 1
    desk.press(Qt.Key.Key_I)
    desk.qtbot.waitUntil(lambda: states(session)[out] == "UNPACKED", timeout=10000)
    desk.press(Qt.Key.Key_I)
    desk.press(Qt.Key.Key_Escape)
    desk.qtbot.waitUntil(lambda: states(session)[out] == "UNPACKED", timeout=10000)

    desk.press(Qt.Key.Key_B)
    desk.rest()
    assert desk.count("PACKED") == 6
    session.select([2])
    desk.press(Qt.Key.Key_H)
    assert states(session)[2] == "HIDDEN"
    desk.press(Qt.Key.Key_Z, CONTROL)
    assert states(session)[2] == "PACKED"
    desk.press(Qt.Key.Key_Z, CONTROL | SHIFT)
    assert states(session)[2] == "HIDDEN"
    desk.press(Qt.Key.Key_Z, CONTROL)

    # All alike: others have to come.
    session.apply_hues(dict.fromkeys(session.ids, 0.0), undoable=False)
    told: list[str] = []
    session.events.hues.connect(lambda *_: told.append("hues"))
    desk.press(Qt.Key.Key_C)
    # On an image of the user's, C is napari's own: contrast.
    assert told == ([] if on_the_users_image else ["hues"])


def test_reveal_by_its_key_asks_what_frees_the_selected_object(desk: Desk) -> None:
    found: list[Any] = []
    desk.panel.planner.found.connect(found.append)
    desk.session.select([2])
    desk.press(Qt.Key.Key_R)
    desk.qtbot.waitUntil(lambda: bool(found), timeout=10000)
    assert found[0].target == 2
    desk.press(Qt.Key.Key_Escape)
    assert found[1:] == [None]


def test_the_users_labels_layer_keeps_its_own_keys(desk: Desk) -> None:
    labels, session = compat.unwrap(desk.labels), desk.session
    desk.activate(labels)
    desk.press(Qt.Key.Key_N)
    desk.rest()
    session.select([2])
    desk.press(Qt.Key.Key_H)
    assert states(session)[2] == "HIDDEN"

    before = states(session)
    voxel = (np.array([0]), np.array([0]), np.array([0]))
    labels.data_setitem(voxel, 3)
    desk.press(Qt.Key.Key_Z, CONTROL)
    assert labels.data[0, 0, 0] == 0
    assert states(session) == before
    desk.press(Qt.Key.Key_Z, CONTROL | SHIFT)
    assert labels.data[0, 0, 0] == 3
    assert states(session) == before


def test_undo_in_slices_takes_back_the_last_step_and_not_the_last_stroke(desk: Desk) -> None:
    labels, session = compat.unwrap(desk.labels), desk.session
    desk.viewer.dims.ndisplay = 2
    desk.activate(labels)
    free = tuple(np.argwhere(session.labels == 0)[0])
    at = tuple(np.array([n]) for n in free)
    labels.data_setitem(at, 2)
    desk.qtbot.waitUntil(lambda: session.labels[free] == 2, timeout=20000)
    session.merge([1, 2])
    desk.press(Qt.Key.Key_Z, CONTROL)
    assert session.ids == (1, 2, 3, 4, 5, 6)
    assert labels.data[free] == 2
    desk.press(Qt.Key.Key_Z, CONTROL)
    assert session.labels[free] == labels.data[free] == 0
    desk.press(Qt.Key.Key_Z, CONTROL | SHIFT)
    assert session.labels[free] == labels.data[free] == 2
    session.select([3])
    desk.press(Qt.Key.Key_Escape)
    assert not session.selected
    two_presses_right_after_a_stroke_take_back_two_steps(desk, free)


def two_presses_right_after_a_stroke_take_back_two_steps(desk: Desk, painted: Any) -> None:
    labels, session = compat.unwrap(desk.labels), desk.session
    other = tuple(np.argwhere(session.labels == 0)[0])
    session.merge([1, 2])
    labels.data_setitem(tuple(np.array([n]) for n in other), 3)
    desk.press(Qt.Key.Key_Z, CONTROL)
    assert labels.data[other] == 0
    desk.press(Qt.Key.Key_Z, CONTROL)
    desk.qtbot.waitUntil(lambda: session.ids == (1, 2, 3, 4, 5, 6), timeout=20000)
    # napari's own second step would be the stroke of before the merge.
    assert session.labels[painted] == labels.data[painted] == 2
    assert session.labels[other] == labels.data[other] == 0


def test_escape_leaves_a_drawn_polygon_first(desk: Desk) -> None:
    labels, session = compat.unwrap(desk.labels), desk.session
    desk.viewer.dims.ndisplay = 2
    desk.activate(labels)
    labels.visible = True
    session.select([3])
    labels.mode = "polygon"
    desk.press(Qt.Key.Key_Escape)
    assert session.selected == {3}
    labels.mode = "pan_zoom"
    desk.panel.measure.measure(2)
    desk.press(Qt.Key.Key_Escape)
    assert desk.controller.interaction.tool is None
    assert session.selected == {3}


def test_in_slices_the_panels_keys_go_first_while_it_has_the_keyboard(desk: Desk) -> None:
    labels = compat.unwrap(desk.labels)
    button, canvas = desk.panel.unpack.next, compat.native_canvas(desk.viewer).native
    desk.press(Qt.Key.Key_N)
    desk.rest()
    desk.viewer.dims.ndisplay = 2
    desk.activate(labels)
    labels.visible = True
    Keys(desk.panel.window(), desk.qtbot)
    before = labels.selected_label, labels.preserve_labels, labels.mode
    button.setFocus()
    desk.qtbot.keyClick(button, Qt.Key.Key_M)
    assert desk.controller.interaction.tool is not None
    desk.qtbot.keyClick(button, Qt.Key.Key_Escape)
    assert desk.controller.interaction.tool is None
    desk.qtbot.keyClick(button, Qt.Key.Key_B)
    desk.qtbot.waitUntil(lambda: desk.count("PACKED") == 6, timeout=20000)
    assert (labels.selected_label, labels.preserve_labels, labels.mode) == before
    # The brush's tools are chosen from there too.
    desk.qtbot.keyClick(button, Qt.Key.Key_2)
    assert labels.mode == "paint"
    canvas.setFocus()
    desk.press(Qt.Key.Key_B)
    assert labels.preserve_labels is not before[1]


def test_keys_go_back_when_the_panel_closes(desk: Desk) -> None:
    mine: list[str] = []
    session = desk.session
    desk.panel.end()
    desk.viewer.layers.selection.clear()
    for key in "NBIHRC":
        desk.viewer.bind_key(key, lambda _, key=key: mine.append(key), overwrite=True)
    before = states(session)
    for key in "NBIHRC":
        desk.press(getattr(Qt.Key, f"Key_{key}"))
    assert mine == list("NBIHRC")
    desk.press(Qt.Key.Key_Z, CONTROL)
    desk.press(Qt.Key.Key_Escape)
    assert states(session) == before
