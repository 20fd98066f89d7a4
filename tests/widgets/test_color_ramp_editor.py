"""Colours along the density axis, under the mouse and the keyboard, and in the session."""

from __future__ import annotations

import pytest
from qtpy.QtCore import QPoint, Qt
from qtpy.QtGui import QColor

import napari_unpack as nu
from napari_unpack.widgets import color_ramp_editor
from napari_unpack.widgets.color_ramp_editor import ColorRampEditor
from napari_unpack.widgets.color_section import ColorSection
from napari_unpack.widgets.commands import Commands
from napari_unpack.widgets.workspace import Workspace
from opened_panel import pile_of_balls

LEFT, RIGHT = Qt.MouseButton.LeftButton, Qt.MouseButton.RightButton
STOPS = [(500.0, (1.0, 0.0, 0.0)), (1280.0, (0.0, 0.0, 1.0))]


@pytest.fixture
def strip(qtbot):
    made = ColorRampEditor()
    qtbot.addWidget(made)
    # Two hundred pixels between the margins, for the square root of two thousand densities.
    made.resize(216, 22)
    made.show_colors(STOPS, (0.0, 2000.0))
    made.show()
    return made


@pytest.fixture
def dialog(monkeypatch):
    """Answer the colour dialog with what is put here; an invalid colour leaves it."""
    answers = [QColor("#33cc66")]
    monkeypatch.setattr(color_ramp_editor.QColorDialog, "getColor", lambda *_: answers[0])
    return answers


def at(x: int) -> QPoint:
    return QPoint(x, 11)


def test_a_double_click_adds_a_colour_and_changes_one(qtbot, strip, dialog) -> None:
    with qtbot.waitSignal(strip.edited) as heard:
        qtbot.mouseDClick(strip, LEFT, pos=at(8 + 20))
    # A tenth of the way is a hundredth of the densities.
    density, rgb = heard.args[0][0]
    assert density == pytest.approx(20.0)
    assert rgb == pytest.approx((0.2, 0.8, 0.4), abs=1e-3)
    assert [d for d, _ in strip.stops[1:]] == [500.0, 1280.0]
    dialog[0] = QColor("#ffff00")
    qtbot.mouseDClick(strip, LEFT, pos=strip.position(1280.0).toPoint())
    assert strip.stops[2] == (1280.0, pytest.approx((1.0, 1.0, 0.0)))
    dialog[0] = QColor()
    qtbot.mouseDClick(strip, LEFT, pos=at(60))
    assert len(strip.stops) == 3


def test_a_dragged_colour_stays_between_its_neighbours(qtbot, strip) -> None:
    qtbot.mousePress(strip, LEFT, pos=strip.position(500.0).toPoint())
    qtbot.mouseMove(strip, at(8 + 120))
    assert strip.stops[0] == (pytest.approx(0.36 * 2000), (1.0, 0.0, 0.0))
    qtbot.mouseMove(strip, at(8 + 199))
    assert strip.stops[0][0] == 1278.0
    strip.show_colors(None, (0.0, 1.0))
    assert len(strip.stops) == 2
    qtbot.mouseRelease(strip, LEFT)
    strip.show_colors(None, (0.0, 1.0))
    assert strip.stops == []
    assert strip.color_at(0.3) == (1.0, 1.0, 1.0)


def test_keys_and_a_right_click_act_on_the_chosen_colour(qtbot, strip, dialog) -> None:
    qtbot.mouseClick(strip, LEFT, pos=strip.position(500.0).toPoint())
    qtbot.keyClick(strip, Qt.Key.Key_Right)
    assert strip.stops[0][0] == pytest.approx(0.505**2 * 2000)
    qtbot.keyClick(strip, Qt.Key.Key_Return)
    assert strip.stops[0][1] == pytest.approx((0.2, 0.8, 0.4), abs=1e-3)
    qtbot.keyClick(strip, Qt.Key.Key_Delete)
    assert [d for d, _ in strip.stops] == [1280.0]
    qtbot.mousePress(strip, RIGHT, pos=strip.position(1280.0).toPoint())
    assert strip.stops == []


def test_a_second_right_click_as_fast_as_a_double_click_asks_for_no_colour(
    qtbot, strip, dialog
) -> None:
    here = strip.position(500.0).toPoint()
    qtbot.mouseClick(strip, RIGHT, pos=here)
    qtbot.mouseDClick(strip, RIGHT, pos=here)
    assert strip.stops == STOPS[1:]


@pytest.mark.parametrize("density", [500.0, 900.0])
def test_a_colour_chosen_for_the_bag_before_is_none_of_the_bag_that_came_meanwhile(
    qtbot, strip, monkeypatch, density
) -> None:
    def ask(*_: object) -> QColor:
        strip.show_colors(STOPS[1:], (0.0, 2000.0))
        return QColor("#33cc66")

    monkeypatch.setattr(color_ramp_editor.QColorDialog, "getColor", ask)
    with qtbot.assertNotEmitted(strip.edited):
        qtbot.mouseDClick(strip, LEFT, pos=strip.position(density).toPoint())
    assert strip.stops == STOPS[1:]


def test_a_colour_is_none_of_another_bag_with_the_same_colours(
    piled, panel, qtbot, monkeypatch
) -> None:
    other, ramp = nu.Session(*pile_of_balls()), panel.color.ramp
    panel.color.curve.toggle.setChecked(True)
    colors = piled.transfer_function.colors
    assert other.transfer_function.colors == colors

    def ask(*_: object) -> QColor:
        panel.workspace.open(other)
        return QColor("#33cc66")

    monkeypatch.setattr(color_ramp_editor.QColorDialog, "getColor", ask)
    with qtbot.assertNotEmitted(ramp.edited):
        qtbot.mouseDClick(ramp, LEFT, pos=at(60))
    assert ramp.stops == list(colors)


def test_keys_alone_add_choose_and_change_colours(qtbot, strip, dialog) -> None:
    key, shift = Qt.Key, Qt.KeyboardModifier.ShiftModifier
    strip.show_colors(None, (0.0, 2000.0))
    qtbot.keyClick(strip, key.Key_PageDown)
    # In the middle of the axis, and the next one between that and the end.
    qtbot.keyClick(strip, key.Key_Plus)
    qtbot.keyClick(strip, key.Key_Plus)
    assert [d for d, _ in strip.stops] == pytest.approx([0.25 * 2000, 0.5625 * 2000])
    qtbot.keyClick(strip, key.Key_PageUp)
    qtbot.keyClick(strip, key.Key_Left, shift)
    assert strip.stops[0][0] == pytest.approx(0.45**2 * 2000)
    dialog[0] = QColor("#ffff00")
    qtbot.keyClick(strip, key.Key_Return)
    assert [rgb for _, rgb in strip.stops] == [
        pytest.approx((1.0, 1.0, 0.0)),
        pytest.approx((0.2, 0.8, 0.4), abs=1e-3),
    ]


def test_colours_are_the_sessions_and_the_curve_stays(
    make_napari_viewer_proxy, session, qtbot, dialog
) -> None:
    workspace = Workspace(make_napari_viewer_proxy())
    section = ColorSection(workspace, Commands(workspace))
    qtbot.addWidget(section)
    workspace.open(session)
    section.curve.toggle.setChecked(True)
    before = session.transfer_function
    assert section.ramp.stops == list(before.colors or ())
    low, high = before.domain
    stops = [(low, (1.0, 0.5, 0.0)), (high, (0.0, 0.5, 1.0))]
    section.ramp.edited.emit(stops)
    qtbot.waitUntil(lambda: session.transfer_function is not before, timeout=5000)
    assert session.transfer_function.colors == tuple(stops)
    assert session.transfer_function.points == before.points
    assert section.preset.currentText() == "My own curve"
    # A curve drawn afterwards keeps the colours; none at all are white.
    section.editor.edited.emit([(low, 0.0), (high, 0.5)])
    qtbot.waitUntil(lambda: session.transfer_function.points[-1][1] == 0.5, timeout=5000)
    assert session.transfer_function.colors == tuple(stops)
    section.ramp.edited.emit([])
    qtbot.waitUntil(lambda: session.transfer_function.colors is None, timeout=5000)
    section.background.end()
    workspace.close()


def test_the_name_of_the_curve_follows_undo_and_sessions_that_open(piled, panel, qtbot) -> None:
    section, commands = panel.color, panel.commands
    preset = section.preset

    def named(name: str) -> None:
        qtbot.waitUntil(lambda: preset.currentText() == name, timeout=10000)

    preset.setCurrentText("Metal")
    preset.activated.emit(preset.currentIndex())
    metal = piled.transfer_function
    commands.undo()
    named("Automatic")
    commands.redo()
    named("Metal")
    panel.workspace.open(piled)
    named("Metal")
    # Who asks for a curve of their own gets the editor, with the one that is shown.
    preset.setCurrentText("My own curve")
    preset.activated.emit(preset.currentIndex())
    named("My own curve")
    assert section.curve.toggle.isChecked()
    assert piled.transfer_function == metal
    section.editor.edited.emit([(0.0, 0.0), (2000.0, 0.5)])
    qtbot.waitUntil(lambda: piled.transfer_function != metal, timeout=10000)
    panel.workspace.open(piled)
    named("My own curve")
    # One step with the preset before it.
    commands.undo()
    named("Automatic")


def test_the_menu_keeps_the_colours_of_chosen_objects(piled, panel) -> None:
    ids = sorted(piled.states)[:2]
    panel.objects.table.show_selection(frozenset(ids))
    entries = {action.text(): action for action in panel.objects.pane.menu().actions()}
    assert not entries["Let colour change"].isEnabled()
    entries["Keep colour"].trigger()
    assert piled.locked_hues == frozenset(ids)
    entries = {action.text(): action for action in panel.objects.pane.menu().actions()}
    assert not entries["Keep colour"].isEnabled()
    entries["Let colour change"].trigger()
    assert piled.locked_hues == frozenset()
