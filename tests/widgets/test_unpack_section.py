"""What the third step says about unpackable objects, and what it does where there is none."""

from collections.abc import Callable
from typing import Any

import numpy as np
from napari.utils.notifications import notification_manager
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QPoint, Qt
from qtpy.QtTest import QTest

from mouse import drag, move
from napari_unpack.demo import await_unpackable, open_panel
from napari_unpack.geometry.view import Camera
from napari_unpack.io import Scan
from napari_unpack.layers import compat
from napari_unpack.widgets.directions import words_of
from napari_unpack.widgets.object_columns import Column
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import controller_with, pile_of_balls, press, rest, states

Viewers = Callable[..., Any]


def _marked_unpackable(panel: UnpackingWidget) -> set[int]:
    model = panel.objects.model
    words = {
        model.id_at(row): model.index(row, Column.STATE).data(Qt.ItemDataRole.DisplayRole)
        for row in range(model.rowCount())
    }
    return {i for i, word in words.items() if word == "unpackable"}


def _leave(panel: UnpackingWidget, qtbot: QtBot, direction: str, unpackable: set[int]) -> None:
    panel.unpack.direction.setCurrentText(direction)
    qtbot.waitUntil(lambda: _marked_unpackable(panel) == unpackable, timeout=10000)


def test_the_unpackable_objects_are_counted_and_marked_for_every_direction(
    panel: UnpackingWidget, piled: Any, qtbot: QtBot
) -> None:
    # Balls 1 and 3 stand at x = 14, 2 and 4 behind them at x = 34. Ball 5 lies on all four, its
    # rim just behind those of 1 and 3: voxel column (20, 26) is 9.8 from its centre and 10.0
    # from that of 1. It hides 6. Upwards 5 and 6 lie free, side by side.
    _leave(panel, qtbot, "Left (−x)", {1, 3})
    assert panel.unpack.sentence.text() == "2 of 6 are unpackable now."
    _leave(panel, qtbot, "Up (−y)", {5, 6})

    # The queue is used up before it is asked anew, but what the step says is always true: with
    # 5 gone, 1 and 3 are free; 2 and 4 still lie under the rim of 6.
    panel.workspace.controller.seconds = 0.1
    panel.commands.unpack([5])
    qtbot.waitUntil(lambda: _marked_unpackable(panel) == {1, 3, 6}, timeout=10000)
    assert states(piled)[5] == "UNPACKED"
    assert panel.unpack.sentence.text() == "3 of 5 are unpackable now."


def test_the_count_tells_what_leaves_together(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot
) -> None:
    # Bars that hook into each other along z; seen from there none is unpackable alone.
    labels = np.zeros((12, 12, 12), np.uint16)
    for y, (a, b) in {0: (1, 2), 6: (3, 4)}.items():
        labels[8, y : y + 4, :5] = labels[2, y : y + 4, 5:10] = labels[2:9, y, 4:6] = a
        labels[4, y + 1 : y + 4, :5] = labels[6, y + 1 : y + 4, 5:10] = b
        labels[4:7, y + 3, 4:6] = b
    layer = viewer.add_labels(labels, name="hooks")
    viewer.add_image(np.where(labels > 0, 1000, 0).astype(np.uint16), name="bag")
    session = controller_with(panel, qtbot, layer)
    session.direction, sentence = "+z", panel.unpack.sentence
    qtbot.waitUntil(lambda: sentence.text().startswith("4 of 4"), timeout=20000)
    assert sentence.text() == "4 of 4 are unpackable now, 2 and 2 together."
    panel.workspace.controller.seconds = 0.1
    panel.commands.unpack(1)
    qtbot.waitUntil(lambda: sentence.text().startswith("2 of 2"), timeout=20000)
    assert sentence.text() == "2 of 2 are unpackable now, all together."


def test_unpacking_what_is_blocked_says_who_stands_in_front(
    panel: UnpackingWidget, piled: Any, qtbot: QtBot
) -> None:
    panel.unpack.direction.setCurrentText("Left (−x)")
    piled.rename(1, "Bottle")
    piled.rename(2, "Shoe")
    before = len(notification_manager.records)
    panel.commands.unpack([2])
    (notice,) = notification_manager.records[before:]
    assert "Shoe cannot leave" in notice.message
    assert "Bottle" in notice.message
    assert set(states(piled).values()) == {"PACKED"}


def test_facts_of_an_inspected_object_say_the_names_of_now(
    panel: UnpackingWidget, piled: Any, qtbot: QtBot
) -> None:
    facts = panel.unpack.inspection.facts
    panel.commands.inspect(1)
    qtbot.waitUntil(lambda: "touches" in facts.text(), timeout=20000)
    assert facts.text().startswith("<b>Object 1</b>")
    assert facts.text().endswith("touches Objects 2 and 3")
    for object_id, name in ((1, "Camera"), (2, "Hair dryer")):
        panel.commands.rename(object_id, name)
    qtbot.waitUntil(lambda: facts.text().startswith("<b>Camera</b>"), timeout=5000)
    assert facts.text().endswith("touches Hair dryer and Object 3")
    # After it there is no object whose name could be asked for.
    panel.commands.leave()
    panel.commands.rename(3, "Shoe")
    rest(panel, qtbot)
    assert not facts.isVisible()


def _knot(viewer: Any, panel: UnpackingWidget, qtbot: QtBot) -> Any:
    """Stage two objects of which, along x, each stands in front of the other."""
    labels = np.zeros((8, 8, 8), np.uint8)
    labels[1:4, 1:7, 1:3], labels[4:7, 1:7, 5:7] = 1, 1
    labels[4:7, 1:7, 1:3], labels[1:4, 1:7, 5:7] = 2, 2
    viewer.add_image(1000.0 * (labels > 0), name="knot")
    expert = viewer.add_labels(labels, name="expert", visible=False)
    return controller_with(panel, qtbot, expert)


def test_a_step_names_all_who_leave_together(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot
) -> None:
    _knot(viewer, panel, qtbot)
    panel.unpack.direction.setCurrentText("Left (−x)")
    panel.commands.unpack(1)
    said, sentence = "Step 1 of 1: Objects 1 and 2", panel.unpack.step_slider.sentence
    qtbot.waitUntil(lambda: sentence.text() == said, timeout=20000)
    assert sentence.toolTip() == ""
    # A word that is longer than a line loses its middle, and stands whole in the tooltip.
    panel.commands.rename(1, "R" + 150 * "e" + "d")
    qtbot.waitUntil(lambda: "…" in sentence.text(), timeout=5000)
    assert sentence.text().endswith("d and Object 2")
    assert "R" + 150 * "e" + "d" in sentence.toolTip()
    measure = sentence.fontMetrics()
    words = sentence.text().split(" ")
    assert max(map(measure.horizontalAdvance, words)) <= sentence.width()
    panel.commands.go_to(0)
    packed = "Everything packed, 1 step known"
    qtbot.waitUntil(lambda: sentence.text() == packed, timeout=20000)


def test_the_demos_picture_of_the_window_waits_until_nothing_is_looked_for(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot
) -> None:
    session = _knot(viewer, panel, qtbot)
    session.max_group_size = 1
    panel.unpack.direction.setCurrentText("Left (−x)")
    qtbot.waitUntil(lambda: "Looking" in panel.unpack.sentence.text(), timeout=10000)
    assert not panel.unpack.answered
    await_unpackable(panel)
    assert panel.unpack.reveal.text() == "Reveal…"
    assert " unpackable." in panel.unpack.sentence.text()


def test_the_demo_keeps_what_a_file_says_of_its_scan(viewer: Any) -> None:
    volume, labels = pile_of_balls()
    place = np.array([[0, 0, 1.0, 5], [0, 1, 0, 6], [-1, 0, 0, 7], [0, 0, 0, 1]])
    scan = Scan(volume, (2.0, 1.0, 1.0), labels, "bag", {2: "Shoe"}, ("no unit",), place)
    session = open_panel(viewer, scan, lambda _, text: None).workspace.session
    assert session.objects["name"].tolist()[:3] == ["Object 1", "Shoe", "Object 3"]
    assert session.assumed == ("no unit",)
    np.testing.assert_array_equal(session.scanner_from_scan, place)


def test_where_nobody_is_free_the_setting_decides(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot
) -> None:
    session = _knot(viewer, panel, qtbot)
    session.max_group_size = 1
    panel.unpack.take_least.setChecked(False)
    panel.unpack.direction.setCurrentText("Left (−x)")
    qtbot.waitUntil(
        lambda: "Nothing is unpackable this way." in panel.unpack.sentence.text(),
        timeout=10000,
    )
    assert "Least occluded: Object" in panel.unpack.sentence.text()
    # Of another direction that says nothing, until it has been looked along.
    panel.unpack.direction.setCurrentText("Up (−y)")
    qtbot.waitUntil(lambda: "Looking for unpackable" in panel.unpack.sentence.text(), timeout=10000)
    qtbot.waitUntil(lambda: "are unpackable now" in panel.unpack.sentence.text(), timeout=10000)
    panel.unpack.direction.setCurrentText("Left (−x)")
    qtbot.waitUntil(lambda: "Least occluded" in panel.unpack.sentence.text(), timeout=10000)

    before = len(notification_manager.records)
    press(qtbot, panel.unpack.next)
    assert "Nothing is unpackable" in notification_manager.records[before].message
    assert set(states(session).values()) == {"PACKED"}

    assert not panel.unpack.force.isHidden()
    press(qtbot, panel.unpack.force)
    assert set(states(session).values()) == {"PACKED", "FLYING_OUT"}
    assert not session.take_least_occluded
    panel.commands.undo()
    panel.workspace.controller.finish()
    assert set(states(session).values()) == {"PACKED"}

    notification_manager.records.clear()
    panel.unpack.take_least.setChecked(True)
    assert panel.unpack.force.isHidden()
    press(qtbot, panel.unpack.next)
    qtbot.waitUntil(lambda: "FLYING_OUT" in states(session).values(), timeout=20000)
    # The panel's line has said it; nothing is laid over the sprites.
    assert notification_manager.records == []
    assert sorted(states(session).values())[1] == "PACKED"
    assert set(states(session).values()) != {"PACKED"}


def test_inspect_is_also_the_way_back(panel: UnpackingWidget, piled: Any, qtbot: QtBot) -> None:
    panel.workspace.controller.seconds = 0.1
    press(qtbot, panel.unpack.next)
    qtbot.waitUntil(panel.unpack.inspect.isEnabled, timeout=10000)
    (out,) = [i for i, state in states(piled).items() if state != "PACKED"]
    qtbot.waitUntil(lambda: not panel.workspace.controller.flying, timeout=10000)
    press(qtbot, panel.unpack.inspect)
    assert states(piled)[out] == "INSPECTED"
    qtbot.waitUntil(lambda: panel.unpack.inspect.text() == "Back to the bag", timeout=20000)
    assert panel.unpack.sentence.text().startswith("One object alone: a drag")
    assert not panel.unpack.next.isEnabled()
    press(qtbot, panel.unpack.inspect)
    qtbot.waitUntil(lambda: states(piled)[out] == "UNPACKED", timeout=10000)
    qtbot.waitUntil(lambda: panel.unpack.inspect.text() == "Inspect", timeout=20000)
    # What is inspected where it lies has not left the bag.
    steps = panel.unpack.step_slider.slider.maximum()
    panel.commands.inspect(next(i for i, state in states(piled).items() if state == "PACKED"))
    qtbot.waitUntil(lambda: panel.unpack.inspect.text() == "Back to the bag", timeout=20000)
    assert panel.unpack.status == "5 in, 1 out"
    assert panel.unpack.sentence.text().startswith("One object in the bag: a drag")
    assert panel.unpack.step_slider.slider.maximum() == steps


def test_play_is_offered_only_where_it_plays(
    panel: UnpackingWidget, piled: Any, qtbot: QtBot
) -> None:
    play = panel.unpack.step_slider.play
    assert play.isEnabled()
    panel.commands.inspect(next(iter(states(piled))))
    qtbot.waitUntil(lambda: not play.isEnabled(), timeout=20000)
    assert panel.unpack.step_slider.slider.isEnabled()
    press(qtbot, panel.unpack.inspect)
    qtbot.waitUntil(play.isEnabled, timeout=20000)


def test_an_arrow_is_drawn_in_3d_also_by_who_looks_at_slices(
    viewer: Any, panel: UnpackingWidget, piled: Any, qtbot: QtBot
) -> None:
    viewer.dims.ndisplay = 2
    press(qtbot, panel.unpack.draw)
    assert viewer.dims.ndisplay == 3
    assert piled.direction is None
    canvas = compat.native_canvas(viewer).native
    drag(canvas, QPoint(200, 200), QPoint(90, 0), qtbot)
    qtbot.waitUntil(lambda: not panel.unpack.draw.isChecked(), timeout=10000)
    assert piled.direction is not None


def test_restore_all_brings_everything_back(
    panel: UnpackingWidget, piled: Any, qtbot: QtBot
) -> None:
    panel.workspace.controller.seconds = 0.1
    panel.unpack.count.setValue(4)
    assert panel.unpack.several.text() == "Unpack 4"
    press(qtbot, panel.unpack.several)
    qtbot.waitUntil(panel.unpack.all_back.isEnabled, timeout=10000)
    press(qtbot, panel.unpack.all_back)
    qtbot.waitUntil(lambda: set(states(piled).values()) == {"PACKED"}, timeout=10000)
    qtbot.waitUntil(lambda: panel.unpack.status == "6 in, 0 out", timeout=20000)


def test_a_bag_of_hidden_objects_is_not_called_empty_and_a_link_shows_them(
    panel: UnpackingWidget, piled: Any, qtbot: QtBot
) -> None:
    sentence = panel.unpack.sentence
    piled.hide([1, 2, 3, 4, 5, 6])
    qtbot.waitUntil(lambda: "6 objects are hidden" in sentence.text(), timeout=10000)
    assert "empty" not in sentence.text()
    assert panel.unpack.status == "0 in, 0 out, 6 hidden"
    # A click on the words Show all.
    spots = (QPoint(x, y) for y in range(4, 40, 6) for x in range(4, 260, 8))
    spot = next(
        at for at in spots if _shape_over(sentence, at) == Qt.CursorShape.PointingHandCursor
    )
    QTest.mouseClick(sentence, Qt.MouseButton.LeftButton, pos=spot)
    assert set(states(piled).values()) == {"PACKED"}
    qtbot.waitUntil(lambda: "hidden" not in sentence.text(), timeout=10000)


def _shape_over(widget: Any, at: QPoint) -> Any:
    move(widget, at)
    return widget.cursor().shape()


def test_a_direction_with_the_words_of_another_says_how_it_differs() -> None:
    camera = Camera.looking((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 0.0), 100.0)
    towards = -camera.direction
    near = towards + 0.2 * camera.up
    assert words_of(near, camera) == words_of(towards, camera) == "towards you"
    assert words_of(near, camera, towards) == "towards you, slightly up"
    assert words_of(camera.up, camera, towards) == "up"
