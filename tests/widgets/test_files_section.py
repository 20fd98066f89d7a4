"""Sessions saved and opened by the panel, exports, and the bar over the steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from threading import Event
from types import SimpleNamespace
from typing import Any

import imageio.v3 as iio
import numpy as np
import pytest
from napari.layers import Image
from napari.utils.notifications import notification_manager
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QMimeData, QPoint, QPointF, Qt, QUrl
from qtpy.QtGui import QCursor, QDropEvent
from qtpy.QtWidgets import QApplication, QFileDialog, QMessageBox, QSplitter

import napari_unpack as nu
from napari_unpack import file_sizes, memory
from napari_unpack.geometry.view import View
from napari_unpack.io.headless import packed_copy
from napari_unpack.layers import compat
from napari_unpack.session.framing import contained, fitted
from napari_unpack.widgets import notifications
from napari_unpack.widgets.contributions import get_session_reader, open_dropped
from napari_unpack.widgets.file_names import bag_name, with_suffix
from napari_unpack.widgets.files_section import EXPORTS
from napari_unpack.widgets.object_columns import Column
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import RADIUS, add_bag, controller_with, pile_of_balls, press, rest, states

Viewers = Callable[..., Any]


@pytest.fixture
def staged(viewer: Any, panel: UnpackingWidget, qtbot: QtBot) -> UnpackingWidget:
    _, expert = add_bag(viewer)
    controller_with(panel, qtbot, expert)
    panel.workspace.controller.seconds = 0.15
    panel.color.at_rest.setChecked(False)
    rest(panel, qtbot)
    return panel


def done(panel: UnpackingWidget, qtbot: QtBot) -> None:
    qtbot.waitUntil(lambda: not panel.files.progress.running, timeout=60000)


def shot(viewer: Any) -> Any:
    return viewer.screenshot(canvas_only=True, flash=False)[..., :3].astype(int)


def assert_same_picture(seen: Any, wanted: Any, most: int) -> None:
    """Fail with where and how two pictures differ by more than `most` levels."""
    apart = np.abs(seen - wanted).max(axis=-1) > most
    where = np.argwhere(apart)
    assert not len(where), (
        f"{len(where)} of {apart.size} pixels differ, rows and columns {where.min(0)} to "
        f"{where.max(0)}; in the mean {seen[apart].mean(0)}, wanted {wanted[apart].mean(0)}"
    )


def out(panel: UnpackingWidget) -> list[int]:
    return [i for i, state in states(panel.workspace.session).items() if state == "UNPACKED"]


def test_the_bar_runs_the_unpacking_forwards_and_backwards(
    viewer: Any, staged: UnpackingWidget, qtbot: QtBot
) -> None:
    panel, slider = staged, staged.unpack.step_slider
    session = panel.workspace.session
    # Outlines of who is free come when a worker knows, before this picture or after it.
    panel.unpack.outlines.setChecked(False)
    rest(panel, qtbot)
    first, hues = shot(viewer), dict(session.hues)
    verbs = [step.verb for step in session.history.done]
    assert (slider.slider.minimum(), slider.slider.value(), slider.slider.maximum()) == (0, 0, 6)
    slider.slider.setValue(4)
    assert session.step == 4
    assert not session.flights
    rest(panel, qtbot)
    four, where = out(panel), session.poses
    assert len(four) == 4
    name = session.objects["name"][session.steps[3][0]]
    assert slider.sentence.text() == f"Step 4 of 6: {name}"
    assert np.abs(shot(viewer) - first).max() > 40

    for step in (1, 6, 2, 5, 3):
        slider.slider.setValue(step)
        qtbot.wait(20)
    slider.slider.setValue(4)
    rest(panel, qtbot)
    assert out(panel) == four
    for i, pose in where.items():
        np.testing.assert_array_equal(session.poses[i].center, pose.center)

    slider.slider.setValue(0)
    rest(panel, qtbot)
    assert set(states(session).values()) == {"PACKED"}
    assert session.hues == hues
    # Windows of the packed picture that are cast anew may round a pixel otherwise.
    assert_same_picture(shot(viewer), first, most=1)
    assert slider.sentence.text() == "Everything packed, 6 steps known"

    # There and back, the dragging was no step, and what is known stays so; the bar follows other
    # commands.
    assert [step.verb for step in session.history.done] == verbs
    press(qtbot, panel.unpack.next)
    rest(panel, qtbot)
    assert slider.slider.value() == 1
    press(qtbot, panel.unpack.back)
    rest(panel, qtbot)
    assert slider.slider.value() == 0


def test_play_flies_one_object_after_another_and_stops_when_asked(
    staged: UnpackingWidget, qtbot: QtBot
) -> None:
    panel, slider = staged, staged.unpack.step_slider
    session = panel.workspace.session
    slider.play.click()
    assert slider.playing
    qtbot.waitUntil(lambda: session.step >= 2, timeout=20000)
    slider.play.click()
    assert not slider.playing
    reached = session.step
    rest(panel, qtbot)
    assert session.step == reached < 6
    panel.workspace.controller.seconds = 0.05
    slider.play.click()
    qtbot.waitUntil(lambda: not slider.play.isChecked(), timeout=30000)
    rest(panel, qtbot)
    assert len(out(panel)) == 6
    # At the end, play begins again with the packed bag; dragging stops it.
    slider.play.click()
    assert session.step <= 1
    slider.slider.setValue(3)
    assert not slider.playing
    panel.workspace.close()
    assert not slider.isEnabled()


def answer_about_size(qtbot: QtBot, answer: str) -> str:
    """Press a button of the question about a large file; return what it said."""
    windows = QApplication.topLevelWidgets()
    (box,) = [w for w in windows if isinstance(w, QMessageBox) and w.isVisible()]
    said = f"{box.text()} {box.informativeText()}"
    qtbot.mouseClick(box.button(QMessageBox.StandardButton[answer]), Qt.MouseButton.LeftButton)
    return said


def test_a_volume_that_would_fill_the_memory_is_opened_on_a_persons_word(
    viewer: Any, qtbot: QtBot, tmp_path: Path, monkeypatch: Any
) -> None:
    path = tmp_path / "bag.npz"
    np.savez(path, volume=np.arange(60).reshape(3, 4, 5), spacing=[1, 1, 1])
    monkeypatch.setattr(file_sizes, "free_memory", lambda: 1)
    viewer.open(path, plugin="napari-unpack")
    said = answer_about_size(qtbot, "Cancel")
    assert "bag.npz holds" in said
    assert "--large" not in said
    assert not viewer.layers
    viewer.open(path, plugin="napari-unpack")
    answer_about_size(qtbot, "Open")
    assert [(layer.name, layer.data.shape) for layer in viewer.layers] == [("bag", (3, 4, 5))]


def test_a_session_saved_in_the_panel_opens_as_it_was(
    viewer: Any, staged: UnpackingWidget, qtbot: QtBot, tmp_path: Path, monkeypatch: Any
) -> None:
    panel = staged
    session = panel.workspace.session
    panel.color.at_rest.setChecked(True)
    panel.unpack.step_slider.slider.setValue(3)
    session.rename(session.ids[0], "first")
    session.select(session.ids[1:3])
    viewer.scene.camera.angles = (20, 50, 10)
    viewer.scene.camera.zoom *= 1.1
    rest(panel, qtbot)
    before, where = states(session), {i: p.center for i, p in session.poses.items()}
    hues, names, seen = session.hues, session.objects["name"], shot(viewer)
    path = tmp_path / "bag.unpack"
    panel.files.save_to(path)
    assert panel.files.progress.isVisibleTo(panel)
    assert not panel.files.save.isEnabled()
    done(panel, qtbot)
    assert panel.files.status == "bag.unpack written"
    assert path.exists()

    panel.workspace.close()
    assert not panel.files.save.isEnabled()
    # What can be done next is open to see, and folded away once it is done.
    assert panel.segment.start.isVisibleTo(panel)
    for layer in list(viewer.layers):
        viewer.layers.remove(layer.name)
    # A session that would fill the memory is opened once a person says so.
    with monkeypatch.context() as full:
        full.setattr(file_sizes, "free_memory", lambda: 1)
        panel.files.open_from(path)
        done(panel, qtbot)
        assert panel.workspace.session is None
        assert "bag.unpack holds" in answer_about_size(qtbot, "Cancel")
        assert panel.workspace.session is None
        panel.files.open_from(path)
        # Dropped meanwhile, another is refused, and the answer is not about it.
        panel.files.open_from(tmp_path / "other.unpack")
        done(panel, qtbot)
        answer_about_size(qtbot, "Open")
        done(panel, qtbot)
    again = panel.workspace.session
    assert again is not session
    assert not panel.segment.start.isVisibleTo(panel)
    rest(panel, qtbot)
    assert states(again) == before
    assert again.hues == hues
    assert set(panel.objects.table.selected_ids()) == set(session.selected)
    assert again.objects["name"].to_dict() == names.to_dict()
    assert [layer.name for layer in viewer.layers][:2] == ["bag", "bag objects"]
    for i, center in where.items():
        np.testing.assert_allclose(again.poses[i].center, center, atol=1e-9)
    np.testing.assert_allclose(again.camera.rotation, session.camera.rotation, atol=1e-6)
    np.testing.assert_allclose(again.camera.height, session.camera.height, rtol=1e-6)
    # The camera went through napari's angles: a pixel here and there may round otherwise.
    assert (np.abs(shot(viewer) - seen).max(-1) > 40).mean() < 0.01
    assert panel.unpack.step_slider.slider.value() == 3
    viewer.dims.ndisplay = 2
    assert viewer.layers["bag"].visible


def test_a_session_saved_in_another_window_shows_as_much(
    viewer: Any, staged: UnpackingWidget, qtbot: QtBot, tmp_path: Path
) -> None:
    """Where all had been brought into view it is so again, and what was zoomed shows as much."""
    panel, tall = staged, (900, 300)
    left = packed_copy(panel.workspace.session)
    left.canvas_size = tall
    whole = fitted(left)
    near = replace(whole, height=whole.height / 2)
    left.look(near)
    near_path = nu.save_session(left, tmp_path / "near.unpack")
    left.look(whole)
    whole_path = nu.save_session(left, tmp_path / "whole.unpack")
    # As a script saves it.
    left.view = View((0.0, 0.2, 1.0))
    for path in (whole_path, nu.save_session(left, tmp_path / "script.unpack")):
        panel.files.open_from(path)
        done(panel, qtbot)
        rest(panel, qtbot)
        assert panel.workspace.controller.framing.is_fit
        apart = np.abs(shot(viewer) - shot(viewer)[2, 2]).max(axis=-1) > 25
        rows, cols = apart.any(axis=1).nonzero()[0], apart.any(axis=0).nonzero()[0]
        assert max(np.ptp(rows), np.ptp(cols)) >= 0.7 * min(apart.shape)
    panel.files.open_from(near_path)
    done(panel, qtbot)
    rest(panel, qtbot)
    now = panel.workspace.session
    wanted = contained(near, tall, now.canvas_size).height
    np.testing.assert_allclose(now.camera.height, wanted, rtol=1e-5)
    assert not panel.workspace.controller.framing.is_fit


def test_what_had_to_be_assumed_of_a_scan_is_told_of_its_session_too(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot, tmp_path: Path
) -> None:
    volume, labels = pile_of_balls()
    told, place = "it gives no voxel size: 1 mm was assumed", np.eye(4)
    place[:3, 3] = 10.0, -20.0, 30.0
    metadata = {"assumed": (told,), "scanner_from_scan": place}
    viewer.add_image(volume, name="bare", metadata=metadata)
    objects = viewer.add_labels(labels)
    session = controller_with(panel, qtbot, objects)
    path = nu.save_session(session, tmp_path / "bare.unpack")
    viewer.layers.clear()
    panel.files.open_from(path)
    done(panel, qtbot)
    rest(panel, qtbot)
    shown = panel.segment.voxels.assumed
    assert not shown.isHidden()
    assert shown.text() == f"Of the file: {told}."
    # A session made anew of the reopened scan knows it as well.
    image = next(layer for layer in viewer.layers if type(layer) is Image)
    assert image.metadata["assumed"] == (told,)
    np.testing.assert_array_equal(image.metadata["scanner_from_scan"], place)


def test_faults_of_files_are_told_and_change_nothing(
    viewer: Any, staged: UnpackingWidget, qtbot: QtBot, tmp_path: Path, monkeypatch: Any
) -> None:
    panel = staged
    said: list[str] = []
    monkeypatch.setattr(notifications, "warn", said.append)
    session, names = panel.workspace.session, [layer.name for layer in viewer.layers]
    whole = nu.save_session(session, tmp_path / "whole.unpack").read_bytes()
    (tmp_path / "cut.unpack").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "empty.unpack").touch()
    for name in ("cut.unpack", "empty.unpack", "missing.unpack"):
        panel.files.open_from(tmp_path / name)
        done(panel, qtbot)
    assert len(said) == 3
    assert "not whole" in said[0]
    assert "is empty" in said[1]
    assert "No such session" in said[2]
    panel.files.save_to(tmp_path / "good.unpack")
    done(panel, qtbot)
    assert panel.files.status == "good.unpack written"
    panel.files.save_to(tmp_path / "nowhere" / "s.unpack")
    done(panel, qtbot)
    assert "No folder" in said[3]
    assert panel.files.status == ""
    assert panel.workspace.session is session
    assert [layer.name for layer in viewer.layers] == names
    # Too large for memory: told at once, and nothing is written.
    with monkeypatch.context() as patch:
        patch.setattr(memory, "free_memory", lambda: 10**6)
        for kind in EXPORTS[:2]:
            panel.files.export_to(kind, tmp_path / f"large{kind.suffixes[0]}")
            done(panel, qtbot)
    assert said[4:] == [
        f"A {what} of 1280 x 960 pixels needs 0.{needs} GB of memory, and 0.0 GB of memory are "
        "free: ask for fewer pixels."
        for what, needs in (("picture", 1), ("movie", 6))
    ]
    # Cancelled before it was done, nothing is written.
    panel.files.save_to(tmp_path / "late.unpack")
    panel.files.progress.cancel.click()
    done(panel, qtbot)
    assert len(said) == 6
    assert sorted(p.name for p in tmp_path.iterdir())[:2] == ["cut.unpack", "empty.unpack"]


def test_a_dropped_session_opens_in_the_panel(
    viewer: Any, staged: UnpackingWidget, qtbot: QtBot, tmp_path: Path
) -> None:
    panel = staged
    panel.workspace.session.unpack(2)
    rest(panel, qtbot)
    path = nu.save_session(panel.workspace.session, tmp_path / "dropped.unpack")
    assert get_session_reader(str(path)) is open_dropped
    assert get_session_reader([str(path)]) is open_dropped
    assert get_session_reader([str(path), str(path)]) is None
    assert get_session_reader(str(tmp_path)) is None
    folder = nu.save_session(panel.workspace.session, tmp_path / "folder")
    assert get_session_reader(str(folder)) is open_dropped
    panel.workspace.close()
    viewer.open(str(path), plugin="napari-unpack")
    _, other = viewer.window.add_plugin_dock_widget("napari-unpack", "Virtual Unpacking")
    qtbot.waitUntil(lambda: other.workspace.session is not None, timeout=30000)
    assert len(out(other)) == 2
    other.end()


def test_a_session_opens_in_the_viewer_that_it_was_dropped_on(
    viewer: Any,
    make_napari_viewer: Viewers,
    qtbot: QtBot,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = nu.save_session(nu.Session(*pile_of_balls()), tmp_path / "dropped.unpack")
    other = make_napari_viewer(show=True)
    windows = [compat.native_window(one) for one in (viewer, other)]
    # The one that was made last is in front, and is the one that napari calls current.
    windows[0].move(0, 0)
    windows[1].move(windows[0].width() // 2, 200)
    inside = windows[0].mapToGlobal(QPoint(40, 150))
    QCursor.setPos(inside)
    qtbot.waitUntil(lambda: QCursor.pos() == inside, timeout=5000)
    qtbot.waitUntil(lambda: QApplication.topLevelAt(inside) is windows[0], timeout=5000)
    # What one opens in the active window is no drop, wherever the mouse is.
    monkeypatch.setattr(type(windows[1]), "isActiveWindow", lambda _: True)
    assert compat.unwrap(compat.viewer_dropped_on()) is compat.unwrap(other)
    # It is the other program's from which one drags.
    monkeypatch.setattr(type(windows[1]), "isActiveWindow", lambda _: False)
    drop(viewer, path)
    (panel,) = windows[0].findChildren(UnpackingWidget)
    assert windows[1].findChildren(UnpackingWidget) == []
    done(panel, qtbot)
    panel.end()


def test_a_dropped_file_leaves_the_panel_where_it_stands(
    viewer: Any, qtbot: QtBot, tmp_path: Path
) -> None:
    panel = from_the_menu(viewer)
    dock = panel.parent()
    dock.setFloating(True)
    nonsense = tmp_path / "nonsense.unpack"
    nonsense.write_bytes(b"PK nothing")
    path = nu.save_session(nu.Session(*pile_of_balls()), tmp_path / "dropped.unpack")
    for dropped in (nonsense, path):
        # Hidden, with its progress.
        dock.hide()
        drop(viewer, dropped)
        done(panel, qtbot)
        assert panel.parent() is dock
        assert dock.isFloating()
        assert dock.isVisible()
    assert panel.workspace.session is not None
    panel.end()


def from_the_menu(viewer: Any) -> UnpackingWidget:
    """Choose Virtual Unpacking in the menu Plugins; return the panel."""
    menus = [viewer.window.plugins_menu]
    for menu in menus:
        menu.aboutToShow.emit()
        menus += [action.menu() for action in menu.actions() if action.menu() is not None]
    actions = [action for menu in menus for action in menu.actions()]
    next(one for one in actions if "Virtual Unpacking" in one.text() and not one.menu()).trigger()
    (panel,) = compat.native_window(viewer).findChildren(UnpackingWidget)
    return panel


def drop(viewer: Any, path: Path) -> None:
    """Drop a file on a viewer's canvas, wherever the mouse is."""
    told = QMimeData()
    told.setUrls([QUrl.fromLocalFile(str(path))])
    action, button = Qt.DropAction.CopyAction, Qt.MouseButton.LeftButton
    event = QDropEvent(QPointF(40, 150), action, told, button, Qt.KeyboardModifier.NoModifier)
    # napari's viewer is the splitter around its canvas.
    splitters = compat.native_window(viewer).findChildren(QSplitter)
    next(one for one in splitters if one.acceptDrops()).dropEvent(event)


def test_exports_are_written_and_the_view_is_not_disturbed(
    viewer: Any, staged: UnpackingWidget, qtbot: QtBot, tmp_path: Path
) -> None:
    panel = staged
    panel.unpack.step_slider.slider.setValue(2)
    panel.commands.select([1])
    rest(panel, qtbot)
    before, seen = states(panel.workspace.session), shot(viewer)
    panel.files.width_px.setValue(96)
    panel.files.height_px.setValue(64)
    panel.files.fps.setValue(2)
    for kind in EXPORTS:
        path = tmp_path / f"{kind.title}{kind.suffixes[0]}"
        panel.files.export_to(kind, path)
        done(panel, qtbot)
        assert panel.files.status == f"{path.name} written"
        assert path.stat().st_size > 100
        if kind.suffixes[0] in (".png", ".mp4"):
            assert iio.imread(path).shape[-3:-1] == (64, 96)
    assert states(panel.workspace.session) == before
    np.testing.assert_array_equal(shot(viewer), seen)


def test_suffixes_are_added_where_they_are_missing() -> None:
    assert with_suffix("/a/bag", ".unpack") == Path("/a/bag.unpack")
    assert with_suffix("/a/bag.v2", ".unpack") == Path("/a/bag.v2.unpack")
    assert with_suffix("/a/film.GIF", ".mp4", ".gif") == Path("/a/film.GIF")


def test_a_name_completed_to_that_of_a_file_is_asked_about(
    staged: UnpackingWidget, qtbot: QtBot, tmp_path: Path, monkeypatch: Any
) -> None:
    (tmp_path / "bag.unpack").write_text("of last year")
    (tmp_path / "table.csv").write_text("of last year")
    written, proposed, asked = ["bag", "other", "table", "bag.unpack"], [], []

    def chosen(_parent: Any, _title: str, path: str, _kinds: str) -> tuple[str, str]:
        proposed.append(Path(path).name)
        return str(tmp_path / written.pop(0)), ""

    def question(_parent: Any, _title: str, text: str) -> QMessageBox.StandardButton:
        asked.append(text)
        kinds = QMessageBox.StandardButton
        return kinds.Yes if "table" in text else kinds.No

    monkeypatch.setattr(QFileDialog, "getSaveFileName", chosen)
    monkeypatch.setattr(QMessageBox, "question", question)
    press(qtbot, staged.files.save)
    done(staged, qtbot)
    # Asked once more for a name, beginning with the one that was not to be replaced.
    assert proposed == ["bag.unpack", "bag.unpack"]
    assert (tmp_path / "bag.unpack").read_text() == "of last year"
    assert (tmp_path / "other.unpack").is_file()
    (table,) = [a for a in staged.files.menu.actions() if a.text() == "Table…"]
    table.trigger()
    done(staged, qtbot)
    assert (tmp_path / "table.csv").read_text() != "of last year"
    assert [text.split(" is ")[0] for text in asked] == ["bag.unpack", "table.csv"]
    # The dialog itself has asked about a name that was written whole.
    press(qtbot, staged.files.save)
    done(staged, qtbot)
    assert len(asked) == 2
    assert len(nu.open_session(tmp_path / "bag.unpack").ids) == 6


@pytest.mark.parametrize("name", ["work.zip", "folder"])
def test_an_opened_session_is_saved_where_it_is_proposed(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot, tmp_path: Path, monkeypatch: Any, name: str
) -> None:
    panel.files.open_from(nu.save_session(nu.Session(*pile_of_balls()), tmp_path / name))
    done(panel, qtbot)
    panel.workspace.session.rename(1, "a knife")
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *given: (given[2], ""))
    press(qtbot, panel.files.save)
    done(panel, qtbot)
    saved = tmp_path / ("folder.unpack" if name == "folder" else name)
    assert nu.open_session(saved).objects["name"][1] == "a knife"
    assert {path.name for path in tmp_path.iterdir()} == {name, saved.name}


def test_what_is_written_is_of_the_moment_it_was_asked_for(
    staged: UnpackingWidget, qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from napari_unpack.io import sessions, surfaces

    session, changed = staged.workspace.session, Event()
    told, meshed = sessions.manifest_of, surfaces.object_surface

    def late(*given: Any) -> Any:
        assert changed.wait(20)
        return told(*given)

    def late_surface(*given: Any) -> Any:
        assert changed.wait(20)
        return meshed(*given)

    monkeypatch.setattr(sessions, "manifest_of", late)
    monkeypatch.setattr(surfaces, "object_surface", late_surface)
    staged.files.save_to(tmp_path / "bag.unpack")
    session.delete([6])
    changed.set()
    done(staged, qtbot)
    assert nu.open_session(tmp_path / "bag.unpack").ids == (1, 2, 3, 4, 5, 6)
    assert staged.unsaved.changed
    changed.clear()
    (kind,) = [kind for kind in EXPORTS if kind.title == "Surfaces of all objects"]
    staged.files.export_to(kind, tmp_path / "bag.obj")
    session.delete([5])
    changed.set()
    done(staged, qtbot)
    assert staged.files.status == "bag.obj written"
    bodies = [s for s in (tmp_path / "bag.obj").read_text().splitlines() if s.startswith("o ")]
    assert len(bodies) == 5


def test_a_session_opens_where_its_layers_stood(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot, tmp_path: Path
) -> None:
    image, expert = add_bag(viewer)
    tilted = np.eye(4)
    tilted[1, 0], tilted[:3, 3] = 0.25, (7, -30, 12)
    for layer in (image, expert):
        layer.scale = layer.scale * (1, 1, -1)
        layer.rotate = (9.0, 50.0, 7.0)
        layer.translate = (0, 40, 90)
        layer.affine = tilted
    points = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9], [3, 8, 5]])
    wanted = [image.data_to_world(p) for p in points]
    controller_with(panel, qtbot, expert)
    rest(panel, qtbot)
    camera = panel.workspace.session.camera
    assert np.linalg.det(camera.stretch) < 0
    path = tmp_path / "bent.unpack"
    panel.files.save_to(path)
    done(panel, qtbot)
    panel.workspace.close()
    for layer in list(viewer.layers):
        viewer.layers.remove(layer.name)
    panel.files.open_from(path)
    done(panel, qtbot)
    rest(panel, qtbot)
    np.testing.assert_allclose(
        [viewer.layers["bent"].data_to_world(p) for p in points], wanted, atol=1e-6
    )
    again = panel.workspace.session.camera
    np.testing.assert_allclose(again.linear, camera.linear, atol=1e-5)
    np.testing.assert_allclose(again.center, camera.center, atol=1e-4)


def test_names_and_colours_of_another_program_are_one_step_of_undo(
    staged: UnpackingWidget, qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = staged.workspace.session
    file = tmp_path / "bag.ctbl"
    file.write_text("0 Background 0 0 0 0\n2 Left_shoe 255 0 51 255\n77 Nobody 1 2 3 255\n")
    monkeypatch.setattr(QFileDialog, "getOpenFileName", lambda *_: (str(file), ""))
    before = session.objects["name"][2]
    press(qtbot, staged.files.label_names)
    done(staged, qtbot)
    qtbot.waitUntil(lambda: session.objects["name"][2] == "Left shoe", timeout=10000)
    assert session.annotations.colors == {2: (1.0, 0.0, 0.2, 1.0)}
    assert staged.files.status == "1 of 6 named"
    assert staged.objects.model.data(staged.objects.model.index(1, Column.NAME)) == "Left shoe"
    staged.commands.undo()
    assert (session.objects["name"][2], session.annotations.colors) == (before, {})
    file.write_text("700 Nobody 1 2 3 255\n")
    records = notification_manager.records
    press(qtbot, staged.files.label_names)
    done(staged, qtbot)
    qtbot.waitUntil(lambda: "its labels are 700, and those here 1 to 6" in records[-1].message)


def test_names_and_folders_are_proposed(
    viewer: Any, staged: UnpackingWidget, qtbot: QtBot, tmp_path: Path, monkeypatch: Any
) -> None:
    panel, proposed = staged, []

    def asked(_parent: Any, _title: str, path: str, _kinds: str) -> tuple[str, str]:
        proposed.append(Path(path))
        # As a person who goes to another folder, and keeps the name.
        return str(tmp_path / Path(path).name), ""

    monkeypatch.setattr(QFileDialog, "getSaveFileName", asked)
    monkeypatch.setattr(panel.files, "export_to", lambda *_: None)
    for action in panel.files.menu.actions():
        action.trigger()
    names = ["bag.png", "bag unpacking.mp4", "bag steps.mp4", "bag turning.mp4"]
    names += ["bag objects.html", "bag interactive.html", "bag objects.csv"]
    names += ["bag measurements.csv"]
    names += ["bag surfaces.stl", "bag selected surfaces.stl"]
    assert [path.name for path in proposed] == names
    assert {path.parent for path in proposed[1:]} == {tmp_path}
    press(qtbot, panel.files.save)
    done(panel, qtbot)
    assert proposed[-1] == tmp_path / "bag.unpack"
    # Where it was saved last, it is saved again; another bag gets a name of its own.
    (tmp_path / "bag.unpack").rename(tmp_path / "other.unpack")
    panel.files.save_to(tmp_path / "mine.unpack")
    done(panel, qtbot)
    press(qtbot, panel.files.save)
    done(panel, qtbot)
    assert proposed[-1] == tmp_path / "mine.unpack"
    monkeypatch.setattr(
        QFileDialog, "getOpenFileName", lambda *a: (str(Path(a[2]) / "other.unpack"), "")
    )
    press(qtbot, panel.files.open)
    done(panel, qtbot)
    assert panel.files.status == "other opened"
    press(qtbot, panel.files.save)
    assert proposed[-1] == tmp_path / "other.unpack"
    done(panel, qtbot)


def test_a_bag_is_called_after_its_file_without_what_no_file_may_have() -> None:
    image = Image(np.zeros((2, 2, 2)), name="a/b: c?")
    assert bag_name([image]) == "a b c"
    assert bag_name([]) == "bag"
    read = SimpleNamespace(name="x", source=SimpleNamespace(path="/scans/suitcase.nii.gz"))
    assert bag_name([read]) == "suitcase"


def test_slices_of_a_reopened_session_are_not_black(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot, tmp_path: Path
) -> None:
    volume, labels = pile_of_balls()
    # A little metal, which no slice should be dimmed for.
    volume[24, 24, 24] = 32000
    path = nu.save_session(nu.Session(volume, labels), tmp_path / "metal.unpack")
    panel.files.open_from(path)
    done(panel, qtbot)
    low, high = viewer.layers["metal"].contrast_limits
    # As many voxels are of less than 1350 as of more, and white is at three times that above air.
    assert (low, high) == (20, 20 + 3 * (1350 - 20))
    viewer.dims.ndisplay = 2
    viewer.layers["metal objects"].visible = False
    viewer.dims.set_current_step(0, 14)
    rest(panel, qtbot)
    # The slice goes through the middle of two balls, and white is at 4010: the one of 3000 is at
    # 190 of 255 grey values, the one of 600 at 37, and all else is black.
    grey = shot(viewer).max(axis=-1)
    disc = np.pi * RADIUS**2 * viewer.scene.camera.zoom**2
    assert (np.abs(grey - 190.0) <= 3).sum() == pytest.approx(disc, rel=0.03)
    assert (np.abs(grey - 37.0) <= 3).sum() == pytest.approx(disc, rel=0.03)


def test_surfaces_of_the_selected_objects_are_exported(
    staged: UnpackingWidget, qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trimesh = pytest.importorskip("trimesh")
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: (str(tmp_path / "two.obj"), ""))
    session, menu = staged.workspace.session, staged.files.menu
    (chosen,) = [action for action in menu.actions() if "selected" in action.text()]
    menu.aboutToShow.emit()
    assert not chosen.isEnabled()
    session.select([2, 3])
    menu.aboutToShow.emit()
    assert chosen.isEnabled()
    chosen.trigger()
    done(staged, qtbot)
    scene = trimesh.load_scene(tmp_path / "two.obj", split_objects=True)
    assert sorted(scene.geometry) == ["Object 2", "Object 3"]
    wanted = session.objects["volume_mm3"][[2, 3]].sum()
    assert scene.volume == pytest.approx(wanted, rel=0.01)
