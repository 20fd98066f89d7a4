"""Directions drawn by hand, the best of 26, Reveal, and what is drawn over the bag."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QEvent, QPoint, Qt
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QApplication, QScrollArea, QToolTip

from mouse import LEFT, drag, move
from napari_unpack.geometry.view import Camera
from napari_unpack.layers import compat
from napari_unpack.session import Session
from napari_unpack.widgets.directions import words_of
from napari_unpack.widgets.held_place import OPENED_MS
from napari_unpack.widgets.reveal_box import sentence
from napari_unpack.widgets.section import scroll_to
from napari_unpack.widgets.unpacking_widget import WIDTH as UNPACKING_WIDTH
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import controller_with, press, rest, states


def nested() -> tuple[np.ndarray, np.ndarray]:
    """A core (1) between plates on all six sides, two deep but for the lid (2) towards -y."""
    labels = np.zeros((30, 30, 30), np.uint16)
    labels[12:18, 12:18, 12:18] = 1
    labels[12:18, 10:12, 12:18] = 2
    sides = [(1, 18, 22), (0, 10, 6), (0, 18, 22), (2, 10, 6), (2, 18, 22)]
    for k, (axis, *places) in enumerate(sides):
        for j, place in enumerate(places):
            part = [slice(12, 18)] * 3
            part[axis] = slice(place, place + 2)
            labels[tuple(part)] = 3 + 2 * k + j
    return np.where(labels, 1000 + 40 * labels, 0).astype(np.uint16), labels


@pytest.fixture
def panel(viewer: Any, panel: UnpackingWidget, qtbot: QtBot) -> UnpackingWidget:
    volume, labels = nested()
    expert = viewer.add_labels(labels, name="expert")
    viewer.add_image(volume, name="bag")
    controller_with(panel, qtbot, expert)
    controller = panel.workspace.controller
    controller.seconds, controller.recolor_at_rest = 0.2, False
    return panel


def place_of(panel: UnpackingWidget) -> int:
    """Return the row of the screen in which the objects begin."""
    return int(panel.objects.mapToGlobal(QPoint(0, 0)).y())


def test_reveal_shows_the_least_that_must_leave_and_unpacks_just_those(
    panel: UnpackingWidget, qtbot: QtBot
) -> None:
    session, controller = panel.workspace.session, panel.workspace.controller
    session.direction = "+z"
    session.select([1])
    table, where = panel.objects.pane.table, place_of(panel)
    panel.planner.reveal_selected()
    box = panel.unpack.reveal_box
    qtbot.waitUntil(box.isVisible, timeout=60000)
    # The table stays where it is.
    qtbot.wait(20)
    assert place_of(panel) == where
    assert "take out Object 2 (towards you and up)." in box.sentence.text()
    assert controller.overlays.outlines.outlined.buried == 1
    assert controller.overlays.outlines.outlined.leaving == {2}
    row = panel.objects.model.row_of(2)
    state = panel.objects.model.index(row, 3)
    qtbot.waitUntil(lambda: state.data() == "take out first", timeout=10000)
    qtbot.waitUntil(
        lambda: len(controller.overlays.outlines.quads_at(controller.frame)) == 1, timeout=60000
    )
    assert len(controller.overlays.outlines.quads_at(controller.frame)) == 1
    press(qtbot, box.take)
    qtbot.waitUntil(lambda: not controller.flying, timeout=60000)
    assert [i for i, s in states(session).items() if s == "UNPACKED"] == [1, 2]
    assert not box.isVisible()
    assert session.direction == (1.0, 0.0, 0.0)
    rest(panel, qtbot)
    assert place_of(panel) == where
    # Inspected with the mouse over the picture or the table, what comes above scrolls up.
    qtbot.wait(OPENED_MS)
    scroll_to(table)
    where = place_of(panel)
    for mouse in (QEvent.Type.Leave, QEvent.Type.Enter):
        for widget in (panel.findChild(QScrollArea), panel.objects, table):
            QApplication.sendEvent(widget, QEvent(mouse))
        panel.commands.inspect(2)
        qtbot.waitUntil(panel.unpack.inspection.isVisible, timeout=10000)
        rest(panel, qtbot)
        assert place_of(panel) == where
        panel.commands.leave()
        rest(panel, qtbot)
        assert place_of(panel) == where
    panel.commands.undo()
    assert set(states(session).values()) <= {"PACKED", "FLYING_BACK"}


def test_one_object_that_nothing_blocks_is_no_these(panel: UnpackingWidget, qtbot: QtBot) -> None:
    box, session = panel.unpack.reveal_box, panel.workspace.session
    session.direction = "-y"
    panel.planner.reveal(2)
    qtbot.waitUntil(lambda: box.take.text() == "Unpack it", timeout=60000)
    panel.planner.reveal(1)
    qtbot.waitUntil(lambda: box.take.text() == "Unpack these", timeout=60000)


def test_an_arrow_drawn_in_the_picture_is_the_direction(
    panel: UnpackingWidget, qtbot: QtBot
) -> None:
    session, controller = panel.workspace.session, panel.workspace.controller
    viewer = controller.viewer
    widget = compat.native_canvas(viewer).native
    angles = viewer.scene.camera.angles
    panel.unpack.draw.setChecked(True)
    assert controller.interaction.pencil.drawing
    assert len(controller.overlays.arrow.quads_at(controller.frame)) == 0
    start = QPoint(200, 200)
    QTest.mousePress(widget, Qt.MouseButton.LeftButton, pos=start)
    for part in (20, 50, 90):
        move(widget, start + QPoint(part, 0), LEFT)
        qtbot.wait(20)
    assert len(controller.overlays.arrow.quads_at(controller.frame)) == 6
    QTest.mouseRelease(widget, Qt.MouseButton.LeftButton, pos=start + QPoint(90, 0))
    qtbot.waitUntil(lambda: session.direction is not None, timeout=10000)
    np.testing.assert_allclose(session.unpack_direction, session.camera.right, atol=1e-6)
    assert viewer.scene.camera.angles == angles
    assert not panel.unpack.draw.isChecked()
    assert not controller.interaction.pencil.drawing
    qtbot.waitUntil(lambda: panel.unpack.direction.currentText() == "Along arrow", timeout=10000)
    panel.unpack.direction.setCurrentText("Towards you")
    assert session.direction is None
    assert len(controller.overlays.arrow.quads_at(controller.frame)) == 0

    # With Shift, out of the surface that was pressed: nearly towards the viewer or beside it.
    panel.unpack.draw.setChecked(True)
    height, width = viewer.canvas.size
    middle = QPoint(width // 2, height // 2)
    QTest.mouseClick(
        widget, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.ShiftModifier, pos=middle
    )
    qtbot.waitUntil(lambda: session.direction is not None, timeout=10000)
    assert session.unpack_direction @ -session.camera.direction > 0.2


def test_an_arrow_is_called_off_where_slices_are_shown(panel: UnpackingWidget) -> None:
    controller, draw = panel.workspace.controller, panel.unpack.draw
    draw.setChecked(True)
    controller.viewer.dims.ndisplay = 2
    assert not controller.interaction.pencil.drawing
    assert not draw.isChecked()
    # From slices it brings the 3D view.
    draw.setChecked(True)
    assert controller.viewer.dims.ndisplay == 3
    assert controller.interaction.pencil.drawing
    draw.setChecked(False)


def test_where_nobody_is_free_the_panel_offers_the_direction_that_frees_most(
    panel: UnpackingWidget, qtbot: QtBot
) -> None:
    session = panel.workspace.session
    # Somebody is free in this bag: the queries must not say so in between.
    panel.workspace.unpackable.disconnect()
    panel.unpack.show_unpackable(frozenset())
    qtbot.waitUntil(panel.unpack.use_best.isVisible, timeout=60000)
    best = session.best_direction()
    assert f"({len(best.ids)} unpackable)" in panel.unpack.use_best.text()
    words = words_of(best.direction, session.camera)
    assert words in panel.unpack.sentence.text().lower()
    qtbot.waitUntil(lambda: "Next: Object" in panel.unpack.sentence.text(), timeout=10000)
    # However long the words are, the panel gets no wider than its place.
    assert panel.unpack.minimumSizeHint().width() < UNPACKING_WIDTH
    press(qtbot, panel.unpack.use_best)
    np.testing.assert_allclose(session.unpack_direction, best.direction, atol=1e-9)


def test_shift_drag_carries_a_sprite_and_hover_shows_where_it_was(
    panel: UnpackingWidget, qtbot: QtBot
) -> None:
    session, controller = panel.workspace.session, panel.workspace.controller
    widget = compat.native_canvas(controller.viewer).native
    (out,) = controller.unpack(1)
    qtbot.waitUntil(lambda: not controller.flying, timeout=60000)
    assert controller.settle(60)
    before, slot = session.poses[out], session.state.placements[out].slot
    row, col = controller.frame.camera.pixels(before.center, controller.frame.size)
    at = QPoint(round(col), round(row))
    move(widget, at + QPoint(1, 1))
    move(widget, at)
    qtbot.waitUntil(
        lambda: len(controller.overlays.ghost.quads_at(controller.frame)) == 3, timeout=100000
    )
    assert QToolTip.text().startswith(str(session.objects["name"][out]))
    home = session.camera.project(session.boxes.center(out, session.spacing), controller.frame.size)
    patch = controller.overlays.ghost.image.patch
    assert patch.row < home[0] < patch.row + patch.size[0]
    assert patch.col < home[1] < patch.col + patch.size[1]
    assert patch.rgba[..., 3].max() < 0.5

    angles, casts = controller.viewer.scene.camera.angles, controller.renderer.sprite_renderer.casts
    shift = Qt.KeyboardModifier.ShiftModifier
    drag(widget, at, QPoint(-30, 40), qtbot, shift)
    qtbot.waitUntil(lambda: session.poses[out] is not before, timeout=10000)
    moved = controller.frame.camera.pixels(session.poses[out].center, controller.frame.size)
    np.testing.assert_allclose(moved - [row, col], [40, -30], atol=1.5)
    assert session.state.placements[out].slot == slot
    assert controller.viewer.scene.camera.angles == angles
    assert controller.renderer.sprite_renderer.casts == casts
    panel.commands.undo()
    np.testing.assert_allclose(session.poses[out].center, before.center)
    move(widget, QPoint(3, 3))
    qtbot.waitUntil(
        lambda: len(controller.overlays.ghost.quads_at(controller.frame)) == 0, timeout=100000
    )
    qtbot.waitUntil(lambda: not QToolTip.isVisible(), timeout=20000)

    move(widget, at)
    qtbot.waitUntil(
        lambda: len(controller.overlays.ghost.quads_at(controller.frame)) == 3, timeout=100000
    )
    # Sent home by a key while the mouse lies still: nothing is left of the ghost.
    panel.commands.restore()
    assert controller.settle(60)
    assert session.states[out].name == "PACKED"
    assert not controller.overlays.ghost.quads_at(controller.frame)


def pile(axis: int) -> Session:
    """Return a session of four slabs one upon the other along an axis."""
    labels = np.zeros((40, 40, 40), np.uint16)
    for k in range(4):
        at = [slice(6, 34)] * 3
        at[axis] = slice(2 + 9 * k, 11 + 9 * k)
        labels[tuple(at)] = k + 1
    return Session(np.where(labels, 1500, 0).astype(np.uint16), labels)


def test_a_question_about_the_bag_before_answers_none_about_the_one_shown(
    panel: UnpackingWidget, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    workspace, planner = panel.workspace, panel.planner
    before, after = pile(0), pile(2)
    before.direction = after.direction = "+z"
    task = before.queries.survey_task()
    # Only its own session tells one from the other.
    assert task.key == after.queries.survey_task().key
    began, go_on, found = threading.Event(), threading.Event(), []

    def slow(progress: Any) -> Any:
        began.set()
        assert go_on.wait(60)
        return task.run(lambda *_: None)

    monkeypatch.setattr(before.queries, "survey_task", lambda: replace(task, run=slow))
    workspace.open(before)
    planner.find_best_direction()
    assert began.wait(60)
    workspace.open(after)
    planner.best.connect(found.append)
    planner.find_best_direction()
    go_on.set()
    qtbot.waitUntil(lambda: not planner.running, timeout=60000)
    (best,) = found
    assert len(best.ids) == 4
    # All four leave at once only across the way in which they lie upon each other.
    assert best.direction[2] == 0


def test_the_best_direction_is_asked_again_where_something_came_back_meanwhile(
    panel: UnpackingWidget, qtbot: QtBot
) -> None:
    workspace, planner, session, found = panel.workspace, panel.planner, pile(0), []
    workspace.open(session)
    session.hide(1)
    planner.best.connect(found.append)
    planner.find_best_direction()
    # Its result is delivered on this thread, which has not waited yet.
    session.show(1)
    qtbot.waitUntil(lambda: bool(found), timeout=60000)
    (best,) = found
    assert len(best.ids) == 4


@pytest.mark.parametrize(
    ("looking", "direction", "words"),
    [
        ((-1, 0, 0), (0, -1, 0), "up"),
        ((-1, 0, 0), (0.7, 0, -0.71), "to the left and towards you"),
        ((-1, 0, 0), (0.58, 0.58, 0.58), "towards you, down and to the right"),
        # From the other side left is right.
        ((1, 0, 0), (0.7, 0, -0.71), "to the right and away from you"),
        ((0, 1, 0), (0, -3, 0), "towards you"),
    ],
)
def test_directions_in_words(
    looking: tuple[float, ...], direction: tuple[float, ...], words: str
) -> None:
    camera = Camera.looking(looking, (0, 0, 1) if looking[1] else None, (0, 0, 0), 10.0)
    assert words_of(direction, camera) == words


def test_sentences_about_what_must_leave() -> None:
    assert sentence("Tin", ["Sock"], "up") == "To reach Tin, take out Sock (up)."
    assert sentence("Tin", list("abcde"), "up") == (
        "To reach Tin, take out a, b, c and 2 others (up)."
    )
    assert sentence("Tin", [], "up") == "Tin is unpackable (up)."
