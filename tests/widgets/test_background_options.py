"""The panel's options for background, box and scale."""

from __future__ import annotations

import pytest

from napari_unpack.appearance import Decorations
from napari_unpack.widgets import background_options
from napari_unpack.widgets.background_options import DARK, NAPARIS, BackgroundOptions
from napari_unpack.widgets.commands import Commands
from napari_unpack.widgets.preferences import Preferences
from napari_unpack.widgets.workspace import Workspace


@pytest.fixture
def workspace(make_napari_viewer_proxy):
    return Workspace(make_napari_viewer_proxy())


@pytest.fixture
def options(workspace, session, qtbot):
    made = BackgroundOptions(workspace, Commands(workspace))
    qtbot.addWidget(made)
    workspace.open(session)
    yield made
    made.end()
    workspace.close()


def test_choices_become_the_sessions_decorations(workspace, options, session) -> None:
    options.choose("Light")
    options.box.setChecked(True)
    options.scale.setChecked(True)
    around = session.decorations
    assert (around.background.name, around.box, around.scale) == ("light", True, True)
    options.choose(NAPARIS)
    assert session.decorations.background.name == "napari"
    viewer = workspace.viewer
    assert viewer.canvas.background_color_override is None
    dark = session.decorations.background.colors
    viewer.theme = "light"
    assert session.decorations.background.is_light
    assert session.decorations.background.colors != dark


def test_a_colour_dialog_that_is_left_changes_nothing(options, session, monkeypatch) -> None:
    from qtpy.QtGui import QColor

    monkeypatch.setattr(background_options.QColorDialog, "getColor", lambda *_: QColor())
    options.background.setCurrentText(background_options.COLOR)
    options.choose(background_options.COLOR)
    assert options.background.currentText() == DARK
    assert session.decorations.background.name == "dark"
    monkeypatch.setattr(background_options.QColorDialog, "getColor", lambda *_: QColor("#336699"))
    options.choose(background_options.COLOR)
    assert session.decorations.background.colors[0] == pytest.approx((0.2, 0.4, 0.6, 1.0))


def test_a_damaged_picture_changes_nothing_and_leaves_the_rest_to_be_chosen(
    options, session, monkeypatch, tmp_path
) -> None:
    (tmp_path / "bad.png").write_bytes(b"no picture")
    chosen = lambda *_: (str(tmp_path / "bad.png"), "")  # noqa: E731
    monkeypatch.setattr(background_options.QFileDialog, "getOpenFileName", chosen)
    options.background.setCurrentText(background_options.IMAGE)
    options.choose(background_options.IMAGE)
    assert options.background.currentText() == DARK
    options.box.setChecked(True)
    assert session.decorations.box
    assert session.decorations.background.name == "dark"


def test_a_sessions_own_decorations_are_shown(workspace, options, session) -> None:
    workspace.close()
    session.decorations = Decorations.of("daylight", ["box"])
    workspace.open(session)
    assert options.background.currentText() == "Daylight, a gradient"
    assert options.box.isChecked()
    assert not options.scale.isChecked()


def test_names_follow_the_preference_where_it_was_changed_and_else_the_box(
    workspace, options, session, monkeypatch
) -> None:
    stored = Preferences()
    monkeypatch.setattr(background_options, "preferences", lambda: stored)
    options.names.setChecked(True)
    workspace.close()
    workspace.open(session)
    assert workspace.controller.names.shown
    # In napari's preferences, while the panel is open.
    options.names.setChecked(False)
    stored = Preferences(names=True)
    workspace.close()
    workspace.open(session)
    assert options.names.isChecked()
    assert workspace.controller.names.shown
