"""A dock that is closed and opened again: by napari's own buttons and its menu."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import Qt

from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import SMALL, add_bag, controller_with, press, rest, states

Viewers = Callable[..., Any]
LEFT = Qt.MouseButton.LeftButton


@pytest.fixture
def viewer(make_napari_viewer: Viewers) -> Any:
    """Return a shown viewer itself, whose menus are looked at."""
    made = make_napari_viewer(show=True)
    made.window.resize(*SMALL)
    return made


@pytest.fixture
def docked(viewer: Any, qtbot: QtBot) -> Iterator[tuple[Any, UnpackingWidget]]:
    """Return (dock, panel), opened from napari's menu, with two objects unpacked."""
    from_the_menu(viewer)
    (panel,) = viewer.window.dock_widgets.values()
    dock = panel.parent()
    _, expert = add_bag(viewer)
    controller_with(panel, qtbot, expert)
    panel.workspace.controller.seconds = 0.15
    for _ in range(2):
        press(qtbot, panel.unpack.next)
    rest(panel, qtbot)
    yield dock, panel
    if not panel.workspace.scheduler.closed:
        panel.end()


def from_the_menu(viewer: Any) -> None:
    """Choose Virtual Unpacking in the menu Plugins."""
    menus = [viewer.window.plugins_menu]
    for menu in menus:
        menu.aboutToShow.emit()
        for action in menu.actions():
            if action.menu() is not None:
                menus.append(action.menu())
            elif "Virtual Unpacking" in action.text():
                action.trigger()
                return
    raise AssertionError("the menu Plugins does not hold the panel")


def test_a_dock_closed_and_opened_again_is_as_it_was(
    viewer: Any, docked: tuple[Any, UnpackingWidget], qtbot: QtBot
) -> None:
    dock, panel = docked
    session, before = panel.workspace.session, states(panel.workspace.session)
    layers = list(viewer.layers)
    panel.unpack.fold.setChecked(True)
    qtbot.mouseClick(dock.title.close_button, LEFT)
    qtbot.waitUntil(lambda: not panel.isVisible(), timeout=5000)
    qtbot.wait(50)
    assert list(viewer.window.dock_widgets) == []
    # The 3D view goes on without its panel.
    assert list(viewer.layers) == layers
    assert panel.workspace.session is session

    from_the_menu(viewer)
    (again,) = viewer.window.dock_widgets.values()
    assert again is panel
    qtbot.waitUntil(panel.isVisible, timeout=5000)
    assert panel.unpack.fold.isChecked()
    assert panel.workspace.session is session
    assert states(session) == before
    panel.unpack.fold.setChecked(False)
    press(qtbot, panel.unpack.next)
    rest(panel, qtbot)
    assert list(states(session).values()).count("UNPACKED") == 3

    # napari's API knows the dock by another name than its menu: the panel moves, none is empty.
    _, again = viewer.window.add_plugin_dock_widget("napari-unpack", "Virtual Unpacking")
    qtbot.wait(50)
    assert again is panel
    qtbot.waitUntil(panel.isVisible, timeout=5000)
    assert list(viewer.window.dock_widgets.values()) == [panel]
    assert panel.workspace.session is session


def test_a_dock_that_is_hidden_or_floats_ends_nothing(
    viewer: Any, docked: tuple[Any, UnpackingWidget], qtbot: QtBot
) -> None:
    dock, panel = docked
    session = panel.workspace.session
    for floating in (False, True):
        dock.setFloating(floating)
        qtbot.mouseClick(dock.title.hide_button, LEFT)
        qtbot.waitUntil(lambda: not panel.isVisible(), timeout=5000)
        qtbot.wait(50)
        from_the_menu(viewer)
        qtbot.waitUntil(panel.isVisible, timeout=5000)
        assert panel.workspace.session is session
    dock.setFloating(False)


def test_a_window_closed_without_its_dock_ends_the_work(
    viewer: Any, docked: tuple[Any, UnpackingWidget], qtbot: QtBot
) -> None:
    dock, panel = docked
    scheduler = panel.workspace.scheduler
    qtbot.mouseClick(dock.title.close_button, LEFT)
    qtbot.wait(50)
    with qtbot.captureExceptions() as errors:
        viewer.close()
        qtbot.waitUntil(lambda: scheduler.closed, timeout=5000)
    assert errors == []
