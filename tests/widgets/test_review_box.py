"""A review in a real viewer: questions, a picture, keys, undo, and what is kept of answers."""

import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from napari.utils.notifications import notification_manager
from pytestqt.qtbot import QtBot
from qtpy.QtCore import Qt
from qtpy.QtWidgets import QScrollArea

from napari_unpack.io.session_json import state_record
from napari_unpack.layers import compat
from napari_unpack.segmentation.common.density_regions import DensityScale
from napari_unpack.segmentation.common.joins import JoinLog, Level, Seen, Steps
from napari_unpack.segmentation.review.doubts import doubts
from napari_unpack.segmentation.review.evidence import gather
from napari_unpack.session import Session
from napari_unpack.session.errors import OutsideError
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import controller_with, press

BAR, CUBE = 1, 2


def bag(matter: int) -> tuple[np.ndarray, np.ndarray, Any]:
    """Return volume, labels and evidence, of so much matter (255 is all) in every object."""
    parts = np.zeros((24, 24, 64), np.int32)
    parts[6:18, 6:18, 4:24], parts[6:18, 6:18, 24:44], parts[8:16, 8:16, 48:56] = 1, 2, 3
    labels = np.array([0, BAR, BAR, CUBE], np.int32)[parts]
    volume = np.array([0, 900, 1500, 1200], np.uint16)[parts]
    level = Level.of(JoinLog([(1, 2, 0.3)]), parts, np.array([[1, 2]]), np.ones(1))
    seen = Seen(volume, DensityScale(0.0, 250.0), np.full(parts.shape, matter, np.uint8))
    return volume, labels, gather(labels, Steps([level], seen))


@pytest.fixture
def session(viewer: Any, panel: UnpackingWidget, qtbot: QtBot) -> Any:
    """Two touching blocks that are one object, hardly sure of it, and a cube beside them."""
    volume, labels, evidence = bag(255)
    layer = viewer.add_labels(labels, name="found", visible=False)
    viewer.add_image(volume, name="bag")
    made = controller_with(panel, qtbot, layer)
    panel.workspace.controller.recolor_at_rest = False
    made.review.evidence = evidence
    assert panel.workspace.controller.settle(200)
    return made


def asked(panel: UnpackingWidget, qtbot: QtBot, answered: int) -> Any:
    """Wait for the question after so many answers, with its picture; return the box."""
    box = panel.objects.review
    qtbot.waitUntil(lambda: f"{answered + 1} of" in box.sentence.text(), timeout=20000)
    qtbot.waitUntil(lambda: not box.picture.pixmap().isNull(), timeout=60000)
    return box


def test_one_key_answers_is_applied_at_once_and_undone(
    viewer: Any, panel: UnpackingWidget, session: Any, qtbot: QtBot, tmp_path: Path
) -> None:
    canvas = compat.native_canvas(viewer).native
    session.rename(1, "Tube <5 mm>")
    panel.objects.review.toggle.setChecked(True)
    box = asked(panel, qtbot, 0)
    assert box.doubt.kind == "join"
    assert "Tube &lt;5 mm&gt;" in box.sentence.text()
    assert "Are orange and blue the same thing?" in box.sentence.text()
    assert not box.save.isEnabled()
    # Asked on by the name that is given meanwhile, with the picture that is there.
    doubt = box.doubt
    panel.commands.rename(BAR, "Candle")
    qtbot.waitUntil(lambda: "Candle" in box.sentence.text(), timeout=5000)
    assert box.doubt is doubt
    image = box.picture.pixmap().toImage()
    colors = {image.pixelColor(x, image.height() // 2).name() for x in range(image.width())}
    shown = [tuple(int(name[k : k + 2], 16) for k in (1, 3, 5)) for name in colors]
    assert any(r > 2 * b for r, _, b in shown)
    assert any(b > 2 * r for r, _, b in shown)
    # Two squares on one background with a gap between, and in the first both sides are large.
    rgba = np.array(
        [
            [image.pixelColor(x, y).getRgb() for x in range(image.width())]
            for y in range(image.height())
        ]
    )
    side = len(rgba)
    first, between, second = np.split(rgba, [side, -side], axis=1)
    assert not between.any()
    assert 2 < between.shape[1] < 10
    assert (np.concatenate([first, second])[..., 3] == 255).all()
    assert (first[0, :, :3] == 0).all()
    lit = first[..., :3].max(axis=-1) > 40
    assert 0.8 * side < max(np.ptp(np.flatnonzero(lit.any(axis=k))) for k in (0, 1)) < side - 2

    qtbot.keyClick(canvas, Qt.Key.Key_D)
    qtbot.waitUntil(lambda: len(session.ids) == 3, timeout=20000)
    assert session.labels[12, 12, 10] != session.labels[12, 12, 40]
    assert [a.said for a in session.review.answers] == ["different"]
    qtbot.waitUntil(lambda: box.save.isEnabled(), timeout=20000)

    panel.commands.undo()
    assert len(session.ids) == 2
    assert session.review.answers == ()
    asked(panel, qtbot, 0)
    assert box.doubt.kind == "join"

    press(qtbot, box.answers["same"])
    qtbot.waitUntil(lambda: len(session.review.answers) == 1, timeout=20000)
    assert len(session.ids) == 2
    qtbot.waitUntil(lambda: box.doubt is None or box.doubt.kind != "join", timeout=20000)
    qtbot.waitUntil(lambda: box.save.isEnabled(), timeout=20000)

    from napari_unpack.io.answers import save_answers

    with np.load(save_answers(session, tmp_path / "answers.npz")) as found:
        assert found["said"].tolist() == ["same"]
        assert found["rows"].shape == (1, len(found["features"]))
    assert "answers" in state_record(session)


def test_a_key_gives_no_answer_that_is_not_offered(
    viewer: Any, panel: UnpackingWidget, session: Any, qtbot: QtBot
) -> None:
    canvas = compat.native_canvas(viewer).native
    session.review.evidence = bag(5)[2]
    panel.objects.review.toggle.setChecked(True)
    press(qtbot, asked(panel, qtbot, 0).answers["same"])
    box = asked(panel, qtbot, 1)
    assert box.doubt.kind == "object"
    assert box.answers["different"].isHidden()
    qtbot.keyClick(canvas, Qt.Key.Key_D)
    qtbot.wait(300)
    assert len(session.review.answers) == 1
    qtbot.keyClick(canvas, Qt.Key.Key_S)
    qtbot.waitUntil(lambda: len(session.review.answers) == 2, timeout=20000)
    assert [a.said for a in session.review.answers] == ["same", "same"]


def test_a_key_answers_no_question_that_is_folded_away(
    viewer: Any, panel: UnpackingWidget, session: Any, qtbot: QtBot
) -> None:
    panel.objects.review.toggle.setChecked(True)
    asked(panel, qtbot, 0)
    panel.objects.fold.setChecked(True)
    canvas = compat.native_canvas(viewer).native
    qtbot.keyClick(canvas, Qt.Key.Key_X)
    assert not panel.objects.repair.running
    assert session.history.done == ()
    panel.objects.fold.setChecked(False)
    qtbot.keyClick(canvas, Qt.Key.Key_K)
    qtbot.waitUntil(lambda: len(session.review.answers) == 1, timeout=20000)


def test_a_key_brings_a_question_into_sight_before_it_answers(
    viewer: Any, panel: UnpackingWidget, session: Any, qtbot: QtBot
) -> None:
    panel.objects.review.toggle.setChecked(True)
    box = asked(panel, qtbot, 0)
    qtbot.wait(400)
    canvas = compat.native_canvas(viewer).native
    panel.findChild(QScrollArea).verticalScrollBar().setValue(0)
    assert box.sentence.visibleRegion().isEmpty()
    qtbot.keyClick(canvas, Qt.Key.Key_K)
    assert not panel.objects.repair.running
    assert session.review.answers == ()
    assert not box.sentence.visibleRegion().isEmpty()
    qtbot.keyClick(canvas, Qt.Key.Key_K)
    qtbot.waitUntil(lambda: len(session.review.answers) == 1, timeout=20000)


def test_doubts_about_the_bag_before_are_none_of_the_one_shown(
    panel: UnpackingWidget, session: Any, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    volume, labels, evidence = bag(255)
    after = Session(volume, labels)
    after.review.evidence = evidence
    task = session.review.doubts_task()
    # Only its own session tells one from the other.
    assert task.key == after.review.doubts_task().key
    began, go_on = threading.Event(), threading.Event()

    def finds_none(_progress: Any) -> list[Any]:
        began.set()
        assert go_on.wait(60)
        return []

    none = replace(task, run=finds_none)
    monkeypatch.setattr(session.review, "doubts_task", lambda: none)
    panel.objects.review.toggle.setChecked(True)
    assert began.wait(60)
    panel.workspace.open(after)
    go_on.set()
    assert asked(panel, qtbot, 0).doubt.kind == "join"


def test_a_question_of_labels_that_have_changed_since_is_neither_answered_nor_drawn(
    viewer: Any, panel: UnpackingWidget, session: Any, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    panel.objects.review.toggle.setChecked(True)
    box = asked(panel, qtbot, 0)
    tasks, found, go_on = session.review.doubts_task, threading.Event(), threading.Event()

    def late() -> Any:
        task = tasks()

        def find(progress: Any) -> Any:
            doubts_now = task.run(progress)
            found.set()
            assert go_on.wait(60)
            return doubts_now

        return replace(task, run=find)

    monkeypatch.setattr(session.review, "doubts_task", late)
    session.merge([BAR, CUBE])
    # By key, before the panel has heard of it.
    qtbot.keyClick(compat.native_canvas(viewer).native, Qt.Key.Key_K)
    assert not panel.objects.repair.running
    assert box.doubt is None
    qtbot.waitUntil(found.is_set, timeout=20000)
    monkeypatch.undo()
    panel.commands.undo()
    told = len(notification_manager.records)
    go_on.set()
    assert asked(panel, qtbot, 0).doubt.revision == session.label_data.revision
    assert session.review.answers == ()
    assert len(notification_manager.records) == told


def test_what_is_in_the_bag_is_asked_first_and_the_rest_waits_until_it_is_restored(
    panel: UnpackingWidget, session: Any, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    evidence = session.review.evidence = bag(5)[2]
    session.animated = False
    task = session.review.doubts_task()
    # The cube, too small to be worth a question, is asked about as well.
    every = replace(task, run=lambda _: doubts(evidence, session.labels, (), share=1.0))
    assert [d.objects for d in every.run(None)] == [(BAR, BAR), (BAR, 0), (CUBE, 0)]
    monkeypatch.setattr(session.review, "doubts_task", lambda: every)
    session.force_unpack(BAR)
    panel.objects.review.toggle.setChecked(True)
    box = asked(panel, qtbot, 0)
    assert box.doubt.objects == (CUBE, 0)
    assert "Restore" not in box.sentence.text()
    assert box.answers["nothing"].isEnabled()
    assert box.answers["same"].toolTip() == "It is an object: leave it as it is (S)."
    session.force_unpack(CUBE)
    box.toggle.setChecked(False)
    box.toggle.setChecked(True)
    qtbot.waitUntil(lambda: box.doubt is not None and box.doubt.kind == "join", timeout=20000)
    assert box.sentence.text().endswith("Restore Object 1 to change it.")
    offered = {said for said, one in box.answers.items() if one.isEnabled()}
    assert offered == {"same", "skip"}
    session.restore([BAR])
    qtbot.waitUntil(lambda: box.answers["different"].isEnabled(), timeout=5000)
    assert "Restore" not in box.sentence.text()
    with pytest.raises(OutsideError, match=r"^Object 2 must be in the bag"):
        session.label_editor.change_task("review", [CUBE, CUBE], lambda *_: None)


def test_labels_of_ones_own_have_no_questions_and_keys_then_do_nothing(
    viewer: Any, panel: UnpackingWidget, session: Any, qtbot: QtBot
) -> None:
    session.review.evidence = None
    box = panel.objects.review
    box.toggle.setChecked(True)
    assert "only objects that Segment has found" in box.sentence.text()
    assert not any(b.isEnabled() for b in (*box.answers.values(), box.save))
    for key in (Qt.Key.Key_S, Qt.Key.Key_D, Qt.Key.Key_X, Qt.Key.Key_K):
        qtbot.keyClick(compat.native_canvas(viewer).native, key)
    assert session.review.answers == ()
