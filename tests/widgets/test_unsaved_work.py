"""Work that is saved nowhere ends after one question, answered with the mouse, or not at all."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from threading import Event
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from napari.utils.notifications import notification_manager
from pytestqt.qtbot import QtBot
from qtpy.QtCore import Qt
from qtpy.QtWidgets import QFileDialog, QMessageBox

import napari_unpack as nu
from napari_unpack.io.recovery import leftovers, recovery_folder
from napari_unpack.io.sessions import standing_of
from napari_unpack.layers import compat
from napari_unpack.viewer.viewer_state import SavedView
from napari_unpack.widgets.files_section import WHOLE
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import (
    Closed,
    add_bag,
    controller_with,
    open_panel,
    pile_of_balls,
    press,
    rest,
    states,
)
from tin import tin

Button = QMessageBox.StandardButton


@pytest.fixture
def worked(panel: UnpackingWidget, piled: Any, qtbot: QtBot) -> UnpackingWidget:
    """Return the panel with a session in which something was done."""
    panel.workspace.controller.seconds = 0.15
    press(qtbot, panel.unpack.next)
    rest(panel, qtbot)
    return panel


def answer(panel: UnpackingWidget, qtbot: QtBot, button: Any, more: bool = False) -> str:
    """Wait for the question, press a button of it, after which may come more; return its words."""
    qtbot.waitUntil(lambda: panel.unsaved.question is not None, timeout=10000)
    box = panel.unsaved.question
    assert box is not None
    assert box.isVisible()
    said = f"{box.text()} {box.informativeText()}"
    qtbot.mouseClick(box.button(button), Qt.MouseButton.LeftButton)
    assert (panel.unsaved.question is not None) == more
    return said


def done(panel: UnpackingWidget, qtbot: QtBot) -> None:
    qtbot.waitUntil(lambda: not panel.files.progress.running, timeout=60000)


def test_nothing_is_asked_where_nothing_was_done(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot
) -> None:
    _, expert = add_bag(viewer)
    controller_with(panel, qtbot, expert)
    session = panel.workspace.session
    viewer.scene.camera.angles = (20, 50, 10)
    session.select([1])
    press(qtbot, panel.unpack.next)
    panel.commands.undo()
    rest(panel, qtbot)
    assert not panel.unsaved.changed
    viewer.layers.remove("Sprites")
    qtbot.waitUntil(lambda: panel.workspace.controller is None, timeout=10000)
    assert len(viewer.layers) == 2


def test_another_unit_of_length_is_work(viewer: Any, panel: UnpackingWidget, qtbot: QtBot) -> None:
    _, expert = add_bag(viewer)
    controller_with(panel, qtbot, expert)
    assert not panel.unsaved.changed
    # Exported surfaces are as large as it says.
    panel.workspace.session.length_unit = "µm"
    assert panel.unsaved.changed
    panel.workspace.session.length_unit = "mm"
    assert not panel.unsaved.changed


@pytest.mark.parametrize("backend", ["cpu", "gl"])
def test_layers_deleted_in_naparis_list_are_asked_for_and_cancel_leaves_all_as_it_was(
    viewer: Any, worked: UnpackingWidget, qtbot: QtBot, backend: str
) -> None:
    panel, controller = worked, worked.workspace.controller
    controller.backend = backend
    rest(panel, qtbot)
    viewer.scene.camera.zoom *= 1.1
    rest(panel, qtbot)
    session, before = controller.session, states(controller.session)
    layers, camera = list(viewer.layers), SavedView.of(viewer.scene.camera)
    # All of them at once: the image goes too, and comes back.
    for gone in ([controller.packed], layers):
        viewer.layers.selection = set(gone)
        rest(panel, qtbot)
        seen = viewer.screenshot(canvas_only=True, flash=False)
        viewer.layers.remove_selected()
        said = answer(panel, qtbot, Button.Cancel)
        assert said.startswith("Save the unpacking of bag? Without its layers it ends.")
        assert list(viewer.layers) == layers
        assert panel.workspace.controller is controller
        assert controller.is_open
        assert states(session) == before
        rest(panel, qtbot)
        assert SavedView.of(viewer.scene.camera) == camera
        again = viewer.screenshot(canvas_only=True, flash=False)
        assert np.abs(again.astype(int) - seen.astype(int)).max() <= 2
    # It goes on: nothing was taken down.
    press(qtbot, panel.unpack.next)
    rest(panel, qtbot)
    assert session.step == 2
    viewer.layers.remove("Packed")
    answer(panel, qtbot, Button.Discard)
    assert panel.workspace.controller is None
    assert len(viewer.layers) == 2


@pytest.mark.parametrize("worked_on", [False, True])
def test_all_layers_deleted_at_once_are_gone_and_napari_stumbles_over_none(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot, worked_on: bool
) -> None:
    _, expert = add_bag(viewer)
    controller_with(panel, qtbot, expert)
    if worked_on:
        press(qtbot, panel.unpack.next)
    rest(panel, qtbot)
    viewer.layers.selection = set(viewer.layers)
    viewer.layers.remove_selected()
    if worked_on:
        answer(panel, qtbot, Button.Discard)
    qtbot.waitUntil(lambda: panel.workspace.controller is None, timeout=20000)
    assert len(viewer.layers) == 0


def test_what_is_saved_is_not_asked_for_again_until_something_is_done(
    viewer: Any, worked: UnpackingWidget, qtbot: QtBot, tmp_path: Path, monkeypatch: Any
) -> None:
    panel, path = worked, tmp_path / "kept.unpack"
    # A place to save to that is not chosen is a cancel.
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: ("", ""))
    viewer.layers.remove("Transition")
    answer(panel, qtbot, Button.Save)
    assert panel.workspace.controller is not None
    assert panel.unsaved.changed

    rest(panel, qtbot)
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: (str(path), ""))
    viewer.layers.remove("Transition")
    answer(panel, qtbot, Button.Save)
    # Until it is saved it stays.
    assert panel.workspace.controller is not None
    qtbot.waitUntil(lambda: panel.workspace.controller is None, timeout=60000)
    assert nu.open_session(path).step == 1

    panel.files.open_from(path)
    done(panel, qtbot)
    assert not panel.unsaved.changed
    session = panel.workspace.session
    session.rename(1, "a knife")
    assert panel.unsaved.changed
    panel.files.save_to(path)
    done(panel, qtbot)
    assert not panel.unsaved.changed


def test_segmenting_again_and_opening_ask_before_the_work(
    viewer: Any, worked: UnpackingWidget, qtbot: QtBot, tmp_path: Path
) -> None:
    panel, session = worked, worked.workspace.session
    path = nu.save_session(session, tmp_path / "other.unpack")
    panel.segment.start.click()
    assert "Other objects will take its place." in answer(panel, qtbot, Button.Cancel)
    assert not panel.segment.progress.running
    panel.files.open_from(path)
    assert "Opening other.unpack ends it." in answer(panel, qtbot, Button.Cancel)
    assert not panel.files.progress.running
    # Given up for what then fails: it is there, and asked for the next time.
    panel.files.open_from(tmp_path / "missing.unpack")
    answer(panel, qtbot, Button.Discard)
    done(panel, qtbot)
    assert panel.workspace.session is session
    assert panel.unsaved.changed
    panel.segment.start.click()
    answer(panel, qtbot, Button.Discard)
    qtbot.waitUntil(lambda: not panel.segment.progress.running, timeout=60000)
    assert panel.workspace.session is not session
    assert panel.unsaved.question is None


@pytest.mark.parametrize(
    ("another_question", "said", "file"),
    [
        (False, Button.Cancel, None),
        (False, Button.Save, None),
        (False, Button.Save, "no folder/kept.unpack"),
        (True, Button.Cancel, None),
    ],
)
def test_what_is_done_during_a_segmentation_is_asked_for_and_its_labels_are_kept(
    viewer: Any, worked: UnpackingWidget, qtbot: QtBot, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, another_question: bool, said: Any, file: str | None,
) -> None:  # fmt: skip
    """Also where it is to be saved and is not, and where something else is asked just then."""
    panel, session = worked, worked.workspace.session
    found = SimpleNamespace(labels=session.labels.astype(np.int32), objects=None, evidence=None)
    monkeypatch.setattr("napari_unpack.segmentation.segment", lambda *_, **__: found)
    chosen = str(tmp_path / file) if file else ""
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: (chosen, WHOLE))
    panel.segment.labels_input.choose(None)
    panel.segment.start.click()
    answer(panel, qtbot, Button.Discard)
    session.rename(1, "a knife")
    if another_question:
        panel.files.open_from(tmp_path / "other.unpack")
    qtbot.waitUntil(lambda: not panel.segment.progress.running, timeout=90000)
    if another_question:
        assert "Opening other.unpack ends it." in answer(panel, qtbot, Button.Cancel, more=True)
    assert "The new objects" in answer(panel, qtbot, said)
    done(panel, qtbot)
    assert panel.workspace.session is session
    assert panel.unsaved.changed
    assert "bag objects" in [layer.name for layer in viewer.layers]
    told = [notice.message for notice in notification_manager.records]
    assert any("The new objects are kept in the layer 'bag objects'" in one for one in told)


def test_what_waits_while_the_window_is_closed_is_not_shown_in_it(
    viewer: Any, worked: UnpackingWidget, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    panel, session, go_on = worked, worked.workspace.session, Event()
    found = SimpleNamespace(labels=session.labels.astype(np.int32), objects=None, evidence=None)

    def segment(*_: Any, **__: Any) -> Any:
        go_on.wait(60)
        return found

    monkeypatch.setattr("napari_unpack.segmentation.segment", segment)
    panel.segment.labels_input.choose(None)
    panel.segment.start.click()
    answer(panel, qtbot, Button.Discard)
    session.rename(1, "a knife")
    window, closed = compat.native_window(viewer), Closed()
    for filtering in (closed, panel):
        window.installEventFilter(filtering)
    window.close()
    go_on.set()
    qtbot.waitUntil(lambda: not panel.segment.progress.running, timeout=90000)
    assert "Closing the window ends it." in answer(panel, qtbot, Button.Discard)
    assert closed.count == 1
    assert panel.workspace.session is session
    # As after a Cancel, for whoever has the window stay.
    assert "bag objects" in [layer.name for layer in viewer.layers]
    window.removeEventFilter(closed)


def test_exit_during_another_question_is_called_off(
    viewer: Any, worked: UnpackingWidget, qtbot: QtBot, tmp_path: Path
) -> None:
    panel, window, closed = worked, compat.native_window(viewer), Closed()
    for filtering in (closed, panel):
        window.installEventFilter(filtering)
    panel.files.open_from(tmp_path / "other.unpack")
    window.close(quit_app=True)
    assert closed.count == 0
    # Else closing this window later would end the application.
    assert not compat.quits_with(window)
    assert "Opening other.unpack ends it." in answer(panel, qtbot, Button.Cancel)
    # Once more during its own question it is wanted still.
    for _ in range(2):
        window.close(quit_app=True)
    assert "Quitting napari ends it." in answer(panel, qtbot, Button.Discard)
    assert closed.count == 1
    assert compat.quits_with(window)
    window.removeEventFilter(closed)
    compat.call_off_exit(window)


def test_a_second_file_that_is_refused_leaves_what_was_discarded_for_the_first(
    viewer: Any, worked: UnpackingWidget, qtbot: QtBot, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    panel, first, go_on = worked, worked.workspace.session, Event()
    read = nu.open_session

    def slowly(*args: Any, **options: Any) -> Any:
        go_on.wait(60)
        return read(*args, **options)

    monkeypatch.setattr("napari_unpack.io.open_session", slowly)
    panel.files.open_from(nu.save_session(first, tmp_path / "other.unpack"))
    answer(panel, qtbot, Button.Discard)
    assert panel.files.progress.running
    panel.files.name_from(tmp_path / "names.ctbl")
    assert not panel.unsaved.changed
    go_on.set()
    done(panel, qtbot)
    assert panel.unsaved.question is None
    assert panel.workspace.session is not first


def test_what_was_discarded_for_something_that_is_refused_is_work_still(
    viewer: Any, worked: UnpackingWidget, qtbot: QtBot, tmp_path: Path
) -> None:
    panel = worked
    panel.segment.labels_input.choose(None)
    panel.segment.options.foreground.setCurrentText("Fixed density")
    panel.segment.start.click()
    # No density is typed.
    answer(panel, qtbot, Button.Discard)
    assert not panel.segment.progress.running
    assert panel.unsaved.changed
    panel.files.save_to(tmp_path / "kept.unpack")
    panel.files.open_from(tmp_path / "other.unpack")
    # Two files at once are none.
    answer(panel, qtbot, Button.Discard)
    assert panel.unsaved.changed
    done(panel, qtbot)


def test_a_bag_is_saved_though_another_comes_while_a_place_is_chosen(
    viewer: Any, worked: UnpackingWidget, qtbot: QtBot, tmp_path: Path, monkeypatch: Any
) -> None:
    panel, path = worked, tmp_path / "first.unpack"
    first, second = panel.workspace.session, nu.Session(*pile_of_balls())
    viewer.layers["bag"].translate = (30, -20, 5)
    rest(panel, qtbot)
    first.rename(1, "a knife")

    def choose(*_: Any) -> tuple[str, str]:
        panel.workspace.open(second)
        second.rename(1, "a cup")
        return str(path), WHOLE

    monkeypatch.setattr(QFileDialog, "getSaveFileName", choose)
    press(qtbot, panel.files.save)
    done(panel, qtbot)
    assert nu.open_session(path).objects["name"][1] == "a knife"
    np.testing.assert_allclose(standing_of(path)[:3, 3], (30, -20, 5))
    assert panel.workspace.session is second
    assert panel.unsaved.changed


def test_closing_the_window_asks_once_and_cancel_keeps_it_open(
    viewer: Any, worked: UnpackingWidget, qtbot: QtBot
) -> None:
    panel, window, closed = worked, compat.native_window(viewer), Closed()
    # Behind the panel's, which is asked first.
    window.installEventFilter(closed)
    window.installEventFilter(panel)
    window.close()
    assert "Closing the window ends it." in answer(panel, qtbot, Button.Cancel)
    assert closed.count == 0
    assert panel.workspace.controller.is_open
    window.close()
    answer(panel, qtbot, Button.Discard)
    assert closed.count == 1
    assert panel.unsaved.question is None
    window.removeEventFilter(closed)


def test_exit_asks_for_each_window_once_and_cancel_keeps_them_all(
    make_napari_viewer: Any, worked: UnpackingWidget, qtbot: QtBot, monkeypatch: Any
) -> None:
    other, closed = make_napari_viewer(show=True), Closed()
    second = open_panel(other, qtbot)
    image, expert = add_bag(other)
    second.workspace.open(nu.Session(image.data, expert.data), [image, expert])
    second.workspace.session.unpack(1)
    window, panels = compat.native_window(other), (second, worked)
    # Behind the panels', which are asked first; else napari would end the tests.
    for filtering in (closed, *panels):
        window.installEventFilter(filtering)
    # A place to save to that is not chosen is a cancel.
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: ("", ""))
    for said in (Button.Cancel, Button.Save):
        window.close(quit_app=True)
        first = next(one for one in panels if one.unsaved.question is not None)
        assert "Quitting napari ends it." in answer(first, qtbot, Button.Discard)
        (last,) = set(panels) - {first}
        answer(last, qtbot, said)
        assert closed.count == 0
        assert all(one.unsaved.changed and one.workspace.controller.is_open for one in panels)
    # What was discarded a moment ago is asked for again, since it is still there.
    window.close(quit_app=True)
    for _ in panels:
        one = next(one for one in panels if one.unsaved.question is not None)
        answer(one, qtbot, Button.Discard)
    assert closed.count == 1
    window.removeEventFilter(closed)
    compat.call_off_exit(window)


def test_what_is_done_inside_a_container_is_asked_for_and_kept(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot, tmp_path: Path
) -> None:
    volume, labels = tin()
    viewer.add_image(volume, name="scan")
    controller_with(panel, qtbot, viewer.add_labels(labels, name="expert", visible=False))
    window, workspace, commands = compat.native_window(viewer), panel.workspace, panel.commands
    workspace.controller.seconds = 0.1
    commands.open_container(1)
    assert workspace.is_inside
    rest(panel, qtbot)
    assert not panel.unsaved.changed
    press(qtbot, panel.unpack.next)
    rest(panel, qtbot)
    out = workspace.session.state.placements.keys()

    def kept_open() -> list[int]:
        file = next(recovery_folder().glob("*/*/session.json"), None)
        return [] if file is None else json.loads(file.read_bytes())["opened"]

    # As a crash now would leave it.
    qtbot.waitUntil(lambda: kept_open() == [1])
    crashed = tmp_path / "crashed"
    shutil.copytree(recovery_folder(), crashed, ignore=shutil.ignore_patterns("lock"))
    window.close()
    assert "Closing the window ends it." in answer(panel, qtbot, Button.Cancel)
    assert workspace.is_inside
    # Whoever leaves the container has not lost it either.
    commands.leave_container()
    rest(panel, qtbot)
    panel.segment.run()
    answer(panel, qtbot, Button.Cancel)
    # On the disk within two seconds of it, and whole.
    qtbot.waitUntil(lambda: kept_open() == [])
    (kept,) = recovery_folder().glob("*/*/session.json")
    bag = nu.io.open_session(kept.parent).opened_bags.open(workspace.session, 1)
    assert bag.state.placements.keys() == out
    panel.files.save_to(tmp_path / "tin.unpack")
    qtbot.waitUntil(lambda: not panel.files.progress.running, timeout=60000)
    assert not panel.unsaved.changed
    (leftover,) = leftovers(crashed)
    panel.files.restore(leftover, lambda: None)
    qtbot.waitUntil(lambda: workspace.is_inside, timeout=60000)
    rest(panel, qtbot)
    assert workspace.opened == (1,)
    assert workspace.session.state.placements.keys() == out
    commands.leave_container()
    assert workspace.session is workspace.document


def test_objects_that_took_long_to_find_are_work_when_the_window_closes(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot
) -> None:
    _, expert = add_bag(viewer)
    controller_with(panel, qtbot, expert)
    window = compat.native_window(viewer)
    panel.unsaved.found_in(59)
    assert not panel.unsaved.worth_keeping
    panel.unsaved.found_in(61)
    # Their labels stay in the viewer, so that nothing else would lose them.
    assert not panel.unsaved.changed
    window.close()
    answer(panel, qtbot, Button.Cancel)
    assert window.isVisible()


def test_a_viewer_closed_by_a_program_asks_nobody(
    viewer: Any, worked: UnpackingWidget, qtbot: QtBot
) -> None:
    scheduler, unsaved = worked.workspace.scheduler, worked.unsaved
    assert unsaved.changed
    with qtbot.captureExceptions() as errors:
        viewer.close()
        qtbot.waitUntil(lambda: scheduler.closed, timeout=5000)
        qtbot.wait(50)
    assert errors == []
    assert unsaved.question is None
