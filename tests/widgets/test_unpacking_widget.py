"""The panel before anything happened, and what it says when something cannot be done."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from napari.utils.notifications import notification_manager
from pytestqt.qtbot import QtBot
from qtpy.QtCore import Qt
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QFileDialog

from napari_unpack.layers import compat
from napari_unpack.session import Session
from napari_unpack.tasks import Progress
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import SMALL, add_bag, controller_with, open_panel, pile_of_balls, press

Viewers = Callable[..., Any]


@pytest.fixture
def viewer(make_napari_viewer_proxy: Viewers) -> Any:
    """Return a viewer that is not shown: nothing here draws."""
    return make_napari_viewer_proxy()


def _said(since: int) -> list[str]:
    return [notice.message for notice in notification_manager.records[since:]]


def _refused(panel: UnpackingWidget, qtbot: QtBot) -> list[str]:
    """Press the first step's button, wait for the end of the work, return what was said."""
    before = len(notification_manager.records)
    press(qtbot, panel.segment.start)
    qtbot.waitUntil(lambda: not panel.segment.progress.running, timeout=30000)
    qtbot.waitUntil(lambda: len(notification_manager.records) > before, timeout=20000)
    return _said(before)


def test_a_new_panel_is_narrow_says_what_each_control_does_and_what_to_do_first(
    panel: UnpackingWidget,
) -> None:
    for step in (panel.color, panel.unpack, panel.objects):
        assert "step 1" in step.reason
        assert not step.body.isEnabled()
    assert panel.segment.reason == ""
    assert not panel.segment.start.isEnabled()
    assert not panel.segment.sample.isHidden()
    every_control_says_what_it_does(panel)
    assert panel.sizeHint().width() <= 330
    assert panel.minimumSizeHint().width() <= 330
    assert panel.minimumSizeHint().height() <= 500
    for verb in (panel.commands.unpack, panel.commands.undo):
        notification_manager.records.clear()
        verb()
        assert len(_said(0)) == 1
        assert "step 1" in _said(0)[0]


def every_control_says_what_it_does(panel: UnpackingWidget) -> None:
    from qtpy.QtWidgets import QAbstractButton, QAbstractSlider, QComboBox, QLineEdit, QSpinBox

    kinds = (QAbstractButton, QComboBox, QLineEdit, QSpinBox, QAbstractSlider)
    controls = [w for kind in kinds for w in panel.findChildren(kind)]
    ours = [w for w in controls if type(w).__module__.startswith(("napari_unpack", "PyQt"))]
    silent = [
        w
        for w in ours
        if not w.toolTip()
        and not w.objectName().startswith("qt_")
        and w.parent() is not None
        and not isinstance(w.parent(), (QComboBox, QSpinBox, QLineEdit))
        and "QAbstractScrollArea" not in str(type(w.parent()))
        and type(w).__name__ not in ("QScrollBar", "QTableCornerButton")
        and type(w) is not QAbstractButton
    ]
    assert [(type(w).__name__, w.parent()) for w in silent] == []


def test_a_volume_is_chosen_by_itself_and_pictures_are_passed_over(
    viewer: Any, panel: UnpackingWidget
) -> None:
    viewer.add_image(np.zeros((5, 6)), name="slice")
    add_bag(viewer)
    panel.segment.volume_input.refresh()
    assert panel.segment.volume_input.count() == 2
    assert panel.segment.volume_input.layer.name == "bag"
    assert panel.segment.start.text() == "Segment"
    assert panel.segment.sample.isHidden()


def test_labels_of_another_shape_are_listed_with_the_reason_and_cannot_be_chosen(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot
) -> None:
    add_bag(viewer)
    other = viewer.add_labels(np.zeros((4, 4, 4), np.uint8), name="other", visible=False)
    box = panel.segment.labels_input
    assert [box.itemText(k) for k in range(box.count())] == [
        "Find the objects",
        "expert",
        "other (4 x 4 x 4, not 48 x 48 x 48)",
    ]
    for _ in range(3):
        QTest.keyClick(box, Qt.Key.Key_Down)
    assert box.currentText() == "expert"
    box.choose(other)
    assert box.currentText() == "Find the objects"
    # Other data may have the right shape.
    other.data = np.zeros((48, 48, 48), np.uint8)
    assert box.itemText(2) == "other"


def test_labels_selected_in_the_layer_list_are_offered_and_a_renamed_layer_keeps_its_place(
    viewer: Any, panel: UnpackingWidget
) -> None:
    image, labels = add_bag(viewer)
    labels.visible = True
    viewer.layers.selection.active = labels
    assert panel.segment.start.text() == "Unpack these labels"
    image.name = "suitcase"
    assert panel.segment.volume_input.currentText() == "suitcase"
    viewer.layers.remove("expert")
    viewer.layers.remove("suitcase")
    assert panel.segment.volume_input.layer is None


def test_labels_without_a_volume_are_their_own_volume(viewer: Any, panel: UnpackingWidget) -> None:
    image, _ = add_bag(viewer)
    panel.segment.labels_input.choose(None)
    viewer.layers.remove("bag")
    boxes = panel.segment.volume_input, panel.segment.labels_input
    assert [box.currentText() for box in boxes] == ["expert", "expert"]
    assert panel.segment.start.text() == "Unpack these labels"
    viewer.add_image(image.data, name="bag again")
    assert [box.currentText() for box in boxes] == ["bag again", "Find the objects"]


@pytest.mark.parametrize(
    "volume",
    [np.full((8, 8, 8), 7.0), np.full((8, 8, 8), np.nan)],
    ids=["constant", "all NaN"],
)
def test_a_volume_that_cannot_be_used_gets_one_sentence(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot, volume: np.ndarray
) -> None:
    viewer.add_image(volume, name="bad", contrast_limits=(0, 1))
    (said,) = _refused(panel, qtbot)
    assert said.endswith(".")
    assert "\n" not in said
    assert [layer.name for layer in viewer.layers] == ["bad"]
    assert panel.workspace.controller is None
    assert panel.segment.start.isEnabled()


def test_labels_of_another_shape_than_the_volume_say_why_it_is_not_shown(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot
) -> None:
    image, _ = add_bag(viewer)
    viewer.layers.remove("expert")
    half = (image.data[:20] > 100).astype(np.uint8)
    viewer.add_labels(half, name="half", scale=image.scale, units=image.units)
    before = len(notification_manager.records)
    controller_with(panel, qtbot, panel.segment.labels_input.layer)
    (said,) = _said(before)
    assert said.startswith("'half' has another shape than 'bag'")
    assert panel.segment.status == "1 object"


def test_nothing_found_is_a_sentence(viewer: Any, panel: UnpackingWidget, qtbot: QtBot) -> None:
    image, _ = add_bag(viewer)
    empty = viewer.add_labels(np.zeros_like(image.data), name="empty")
    panel.segment.labels_input.choose(empty)
    (said,) = _refused(panel, qtbot)
    assert "no objects" in said.lower()


def test_a_refusal_leaves_the_open_controller_alone(
    make_napari_viewer_proxy: Viewers, qtbot: QtBot
) -> None:
    viewer = make_napari_viewer_proxy(show=True)
    viewer.window.resize(*SMALL)
    panel = open_panel(viewer, qtbot)
    _, labels = add_bag(viewer)
    session = controller_with(panel, qtbot, labels)
    names = [layer.name for layer in viewer.layers]
    bad = viewer.add_image(np.full((8, 8, 8), 7.0), name="bad", contrast_limits=(0, 1))
    panel.segment.volume_input.choose(bad)
    assert len(_refused(panel, qtbot)) == 1
    assert panel.workspace.session is session
    assert [layer.name for layer in viewer.layers] == [*names, "bad"]
    panel.end()


def test_a_session_that_cannot_be_opened_is_not_shown(
    panel: UnpackingWidget, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compat, "problem", lambda: "No layer of ours can be drawn.")
    with pytest.raises(RuntimeError, match="No layer of ours"):
        panel.workspace.open(Session(*pile_of_balls()))
    assert panel.workspace.controller is None


def test_closing_the_viewer_stops_long_work_of_the_panel(viewer: Any, qtbot: QtBot) -> None:
    panel = open_panel(viewer, qtbot)
    scheduler, stopped = panel.workspace.scheduler, threading.Event()
    began = threading.Event()

    def endless(progress: Progress) -> None:
        try:
            while True:
                progress(0.5, "Cutting")
                began.set()
        finally:
            stopped.set()

    panel.segment.progress.begin(endless)
    assert began.wait(20)
    with qtbot.captureExceptions() as errors:
        viewer.close()
        qtbot.waitUntil(stopped.is_set, timeout=20000)
        qtbot.wait(50)
    assert errors == []
    assert scheduler.closed


def test_cancelling_leaves_everything_as_it_was(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    import napari_unpack.segmentation as segmentation

    deaf, go_on = threading.Event(), threading.Event()

    def endless(*_: Any, progress: Any, **__: Any) -> None:
        while not deaf.is_set():
            progress(0.25, "Cutting")
        go_on.wait(20)

    monkeypatch.setattr(segmentation, "segment", endless)
    add_bag(viewer)
    press(qtbot, panel.segment.start)
    qtbot.waitUntil(lambda: panel.segment.progress.text.text() == "Cutting", timeout=20000)
    qtbot.waitUntil(lambda: panel.segment.progress.bar.value() == 225, timeout=20000)
    assert not panel.segment.progress.isHidden()
    # In a library's code, say, or while a kernel is compiled.
    deaf.set()
    press(qtbot, panel.segment.progress.cancel)
    qtbot.waitUntil(lambda: not panel.segment.progress.running, timeout=1000)
    assert panel.segment.start.isEnabled()
    go_on.set()
    qtbot.waitUntil(lambda: not panel.workspace.scheduler.busy, timeout=20000)
    assert panel.segment.progress.isHidden()
    assert panel.workspace.controller is None
    assert [layer.name for layer in viewer.layers] == ["expert", "bag"]


def test_a_defect_is_not_dressed_up_as_a_message(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    import napari_unpack.segmentation as segmentation

    def broken(*_: Any, **__: Any) -> None:
        raise ZeroDivisionError("a defect")

    monkeypatch.setattr(segmentation, "segment", broken)
    add_bag(viewer)
    with qtbot.captureExceptions() as caught:
        press(qtbot, panel.segment.start)
        qtbot.waitUntil(lambda: bool(caught), timeout=20000)
    assert caught[0][0] is ZeroDivisionError
    assert panel.segment.start.isEnabled()


def test_details_reach_the_segmentation_and_its_advice_is_about_the_panel(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    import napari_unpack.segmentation as segmentation

    given = {}

    def nothing(*_: Any, progress: Any, **settings: Any) -> None:
        given.update(settings)
        raise ValueError("nothing found: all is air; pass a lower foreground=")

    monkeypatch.setattr(segmentation, "segment", nothing)
    add_bag(viewer)
    options = panel.segment.options
    assert not options.isHidden()
    options.foreground.setCurrentText("Fixed density")
    options.threshold.setText("dense")
    press(qtbot, panel.segment.start)
    assert "must be a number, got 'dense'" in _said(-1)[0]
    options.threshold.setText("350")
    options.smallest.setValue(20)
    options.noise.setCurrentText("Keep")
    options.shell.setChecked(False)
    (said,) = _refused(panel, qtbot)
    assert said.startswith("Nothing found: all is air; under Details in step 1")
    del given["spacing"]
    assert given == {
        "foreground": 350.0,
        "grainy": False,
        "smallest": 20.0,
        "supports": True,
        "shell": False,
    }
    options.smallest.setValue(0)
    options.noise.setCurrentText("Remove")
    assert options.settings()["smallest"] is None
    assert options.settings()["grainy"] is True
    assert not options.shell.isEnabled()
    options.foreground.setCurrentText("One level")
    assert options.threshold.text() == ""
    assert options.settings()["foreground"] == "otsu"
    options.threshold.clear()
    qtbot.keyClicks(options.threshold, "420")
    assert options.settings()["foreground"] == 420.0
    panel.segment.labels_input.choose(viewer.layers["expert"])
    assert options.isHidden()


def test_the_look_follows_naparis_theme(viewer: Any, panel: UnpackingWidget) -> None:
    dark = panel.styleSheet()
    viewer.theme = "light"
    assert panel.styleSheet() != dark
    viewer.theme = "dark"
    assert panel.styleSheet() == dark


def test_the_simulated_bag_is_one_click_away(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    from napari_unpack.widgets import segment_section

    volume, labels = pile_of_balls()
    monkeypatch.setattr(
        segment_section,
        "packed_bag",
        lambda progress: [
            (volume, {"name": "sample"}, "image"),
            (labels, {"visible": False}, "labels"),
        ],
    )
    press(qtbot, panel.segment.sample)
    qtbot.waitUntil(lambda: len(viewer.layers) == 2, timeout=20000)
    assert panel.segment.volume_input.layer.name == "sample"
    assert panel.segment.start.isEnabled()
    assert panel.segment.start.text() == "Segment"
    assert panel.segment.sample.isHidden()


def test_the_sample_of_nuclei_is_in_micrometres_and_opens_by_its_name(viewer: Any) -> None:
    image, truth = viewer.open_sample("napari-unpack", "nuclei")
    assert [str(unit) for unit in image.units] == ["micrometer"] * 3
    assert tuple(image.scale) == tuple(truth.scale) == (1.0, 0.5, 0.5)
    assert truth.visible is False
    assert len(np.unique(truth.data)) == 61


def test_the_sample_is_the_volume_to_segment_and_above_it_labels_unseen() -> None:
    from napari_unpack.widgets.contributions import SAMPLE_COUNT, SAMPLE_SHAPE, packed_bag

    heard = []
    (volume, about_volume, kind), (labels, about_labels, _) = packed_bag(
        progress=lambda fraction, text: heard.append(fraction)
    )
    assert kind == "image"
    assert labels.shape == volume.shape == SAMPLE_SHAPE
    assert len(np.unique(labels)) == SAMPLE_COUNT + 1
    assert about_labels["visible"] is False
    assert about_volume["scale"] == about_labels["scale"]
    assert heard


def test_what_was_asked_of_one_bag_is_not_done_to_the_bag_that_came_meanwhile(
    viewer: Any,
    panel: UnpackingWidget,
    piled: Session,
    qtbot: QtBot,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # As a segmentation brings it, when its work ends.
    def another() -> Session:
        panel.workspace.open(Session(*pile_of_balls()), panel.workspace.controller.sources)
        return panel.workspace.session

    def chosen(*_: Any) -> tuple[str, str]:
        another()
        return str(tmp_path / "table.csv"), ""

    warned: list[str] = []
    monkeypatch.setattr("napari_unpack.widgets.notifications.warn", warned.append)
    monkeypatch.setattr(QFileDialog, "getSaveFileName", chosen)
    (table,) = [a for a in panel.files.menu.actions() if a.text() == "Table…"]
    table.trigger()
    assert not panel.files.progress.running
    assert len(warned) == 1
    assert not (tmp_path / "table.csv").exists()

    names, before = tmp_path / "bag.ctbl", panel.workspace.session
    names.write_text("0 Background 0 0 0 0\n2 Left_shoe 255 0 51 255\n")
    panel.files.name_from(names)
    after = another()
    qtbot.waitUntil(lambda: not panel.files.progress.running, timeout=20000)
    assert len(warned) == 2
    assert "another bag is shown now" in warned[0] == warned[1]
    for session in (before, after):
        assert "Left shoe" not in set(session.objects["name"])
    panel.files.name_from(names)
    panel.workspace.close()
    qtbot.waitUntil(lambda: not panel.files.progress.running, timeout=20000)
    assert warned[2:] == ["Nothing was done: the bag that it was asked for is closed."]
