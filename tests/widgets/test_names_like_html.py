"""Names that look like HTML are shown sign by sign, wherever the panel tells them."""

from __future__ import annotations

from typing import Any

import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import Qt
from qtpy.QtGui import QTextDocument
from qtpy.QtWidgets import QLabel, QMessageBox, QStatusBar, QToolTip

from napari_unpack.layers import compat
from napari_unpack.widgets.object_columns import Column
from napari_unpack.widgets.section import label
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import controller_with, press, rest

NAMES = ("Doll <body>", "A<B", "Tube <5 mm", "<b>5 ml</b> syringe", "A &lt; B", "Salt & <i>sugar")
Format = Qt.TextFormat


def seen(text: str, form: Any = Format.AutoText) -> str:
    """Return what Qt shows of a text."""
    if form == Format.PlainText or (form == Format.AutoText and not Qt.mightBeRichText(text)):
        return text
    document = QTextDocument()
    document.setHtml(text)
    return str(document.toPlainText())


def shown(words: QLabel) -> str:
    return seen(words.text(), words.textFormat())


@pytest.fixture
def named(panel: UnpackingWidget, piled: Any, qtbot: QtBot) -> Any:
    """Return the session of the pile, its objects with odd names."""
    panel.workspace.controller.recolor_at_rest = False
    panel.workspace.controller.seconds = 0.05
    for object_id, name in zip(piled.ids, NAMES, strict=True):
        piled.rename(object_id, name)
    rest(panel, qtbot)
    return piled


def test_names_are_whole_in_sentences(panel: UnpackingWidget, named: Any, qtbot: QtBot) -> None:
    said, words = set(), panel.unpack.step_slider.sentence
    for step in range(1, 7):
        panel.commands.go_to(step)
        qtbot.waitUntil(lambda n=step: f"Step {n} of" in words.text(), timeout=20000)
        said.add(shown(words).split(": ", 1)[1])
    assert said == set(NAMES)
    facts = panel.unpack.inspection.facts
    for object_id, name in zip(named.ids, NAMES, strict=True):
        panel.commands.inspect(object_id)
        rest(panel, qtbot)
        qtbot.waitUntil(lambda name=name: shown(facts).startswith(f"{name}\n"), timeout=20000)
        panel.commands.leave()
        rest(panel, qtbot)
    panel.commands.restore_all()
    rest(panel, qtbot)
    panel.commands.inspect(1)
    rest(panel, qtbot)
    qtbot.waitUntil(lambda: "touches" in facts.text(), timeout=20000)
    touching = shown(facts).splitlines()[-1]
    assert sum(name in touching for name in NAMES) >= 2


def test_the_status_bar_is_as_it_was_when_the_panel_is_closed(
    viewer: Any, panel: UnpackingWidget, expert: Any, qtbot: QtBot
) -> None:
    labels = compat.native_window(viewer).statusBar().findChildren(QLabel)
    before = [words.textFormat() for words in labels]
    controller_with(panel, qtbot, expert)
    assert {words.textFormat() for words in labels} == {Format.PlainText}
    panel.end()
    assert [words.textFormat() for words in labels] == before


def test_every_label_says_how_it_is_read(panel: UnpackingWidget, named: Any) -> None:
    # Qt's own guess is right until an object, a layer or a file has such a name.
    guessed = [
        words.text()
        for words in panel.findChildren(QLabel)
        if words.textFormat() == Format.AutoText and words.text()
    ]
    assert guessed == []
    assert shown(label(NAMES[0], "hint")) == NAMES[0]


def test_names_are_whole_in_tooltips_and_in_the_status_bar(
    viewer: Any, panel: UnpackingWidget, named: Any, qtbot: QtBot
) -> None:
    model, table = panel.objects.model, Column.NAME
    for row, name in enumerate(NAMES):
        for column in (table, Column.SWATCH, Column.FLAG, Column.CONFIDENCE):
            tip = model.index(row, column).data(Qt.ItemDataRole.ToolTipRole)
            assert seen(tip).startswith(name)
        assert "\n" in seen(model.index(row, table).data(Qt.ItemDataRole.ToolTipRole))
        panel.workspace.controller.interaction.point_at(named.ids[row])
        qtbot.waitUntil(lambda name=name: seen(QToolTip.text()).startswith(name), timeout=5000)
        bar = compat.native_window(viewer).findChild(QStatusBar)
        qtbot.waitUntil(
            lambda name=name, bar=bar: any(
                shown(words).startswith(name) for words in bar.findChildren(QLabel)
            ),
            timeout=5000,
        )
    panel.files.set_status("a<b>.unpack written")
    words = next(w for w in panel.files.findChildren(QLabel) if "written" in w.text())
    assert seen(words.toolTip()) == shown(words) == "a<b>.unpack written"


def test_names_of_layers_are_whole_in_the_question_about_unsaved_work(
    viewer: Any, panel: UnpackingWidget, named: Any, qtbot: QtBot
) -> None:
    panel.workspace.controller.sources[0].name = "bag <b>2"
    panel.unsaved.ask("Opening bag <i>3 ends it.", lambda: None)
    box = panel.unsaved.question
    said = [shown(words) for words in box.findChildren(QLabel)]
    assert any("bag <b>2?" in one for one in said)
    assert any("bag <i>3 ends" in one for one in said)
    press(qtbot, box.button(QMessageBox.StandardButton.Cancel))
