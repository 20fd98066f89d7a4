"""The table of objects: what it shows, how it sorts, filters, selects and answers clicks."""

import unicodedata
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from pytestqt.modeltest import ModelTester
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QEvent, QPoint, Qt
from qtpy.QtGui import QFont, QFontMetrics, QKeyEvent
from qtpy.QtWidgets import QApplication, QLineEdit

from napari_unpack.geometry.length_unit import MM
from napari_unpack.session import ObjectState
from napari_unpack.widgets.object_cells import PADDING, SMALLER
from napari_unpack.widgets.object_columns import MARKS, Column
from napari_unpack.widgets.object_model import ID, ObjectModel
from napari_unpack.widgets.object_table import ObjectTable
from napari_unpack.widgets.objects_pane import FILTERS

DISPLAY = Qt.ItemDataRole.DisplayRole


def _session(names: tuple[str, ...], ids: tuple[int, ...]) -> SimpleNamespace:
    """Object k of n is a box of 2 x 3 x (4 + k) voxels of 1 x 2 x 5 mm."""
    count = len(ids)
    lower = np.zeros((count, 3), np.int64)
    upper = np.stack([np.full(count, 2), np.full(count, 3), 4 + np.arange(count)], axis=1)
    objects = pd.DataFrame(
        {
            "name": names,
            "volume_mm3": np.prod(upper, axis=1) * 10.0,
            "mean_density": 1000.0 + np.arange(count),
            "confidence": [0.5, np.nan, *[0.9] * count][:count],
        },
        index=list(ids),
    )
    session = SimpleNamespace(
        spacing=(1.0, 2.0, 5.0),
        boxes=SimpleNamespace(ids=np.array(ids), lower=lower, upper=upper),
        objects=objects,
        states=dict.fromkeys(ids, ObjectState.PACKED),
        hues={ids[0]: 0.0},
        tint_mode="hsv",
        length_unit=MM,
        selected=frozenset(),
        examples=frozenset(),
        annotations=SimpleNamespace(colors={}, notes={}, flags={}),
        steps=(),
        step=0,
        label_of=lambda object_id: object_id,
        queries=SimpleNamespace(unpackable_groups=lambda: (), blockers=lambda: {}),
    )
    session.rename = lambda i, name: objects.__setitem__(
        "name", objects["name"].where(objects.index != i, name)
    )
    return session


@pytest.fixture
def session() -> SimpleNamespace:
    return _session(("Object 10", "Shoe", "Object 2"), (3, 5, 8))


@pytest.fixture
def table(qtbot: QtBot, session: SimpleNamespace) -> ObjectTable:
    edges = {3: (20.0, 6.0, 2.0), 5: (25.0, 6.0, 2.0), 8: (30.0, 6.0, 2.0)}
    sizes = SimpleNamespace(known=lambda: edges)
    model = ObjectModel(session.rename, sizes=sizes)
    model.load(session)
    made = ObjectTable(model)
    qtbot.addWidget(made)
    made.resize(300, 240)
    made.show()
    return made


def _shown(table: ObjectTable, column: Column) -> list[str]:
    rows = table.rows
    return [rows.index(k, column).data(DISPLAY) for k in range(rows.rowCount())]


def test_the_model_keeps_qts_rules(qtmodeltester: ModelTester, session: SimpleNamespace) -> None:
    model = ObjectModel(session.rename)
    model.load(session)
    qtmodeltester.check(model)


def test_every_fact_is_shown_in_the_units_of_its_title(table: ObjectTable) -> None:
    # Object 5 is 2 x 3 x 5 voxels: 2, 6 and 25 mm, 300 mm^3.
    row = _shown(table, Column.NAME).index("Shoe")
    cells = {column: table.rows.index(row, column).data(DISPLAY) for column in Column}
    title = table.rows.headerData(Column.VOLUME, Qt.Orientation.Horizontal, DISPLAY)
    assert (cells[Column.VOLUME], title) == ("300", "mm³")
    assert cells[Column.SIZE] == "25 × 6 × 2"
    assert cells[Column.DENSITY] == "1001"
    assert cells[Column.CONFIDENCE] == "–"
    assert cells[Column.STATE] == "in the bag"


def test_larger_objects_are_measured_in_cubic_centimetres(
    table: ObjectTable, session: SimpleNamespace
) -> None:
    session.objects["volume_mm3"] = [123456.0, 2340.0, 10.0]
    table.objects.load(session)
    title = table.rows.headerData(Column.VOLUME, Qt.Orientation.Horizontal, DISPLAY)
    assert title == "cm³"
    assert sorted(_shown(table, Column.VOLUME)) == ["0.01", "123", "2.3"]


def test_swatches_wear_the_tints_of_the_picture(
    table: ObjectTable, session: SimpleNamespace
) -> None:
    swatch = table.objects.index(0, Column.SWATCH)
    color = swatch.data(Qt.ItemDataRole.DecorationRole)
    assert color.getRgb()[:3] == (255, 0, 0)
    session.tint_mode = "perceptual"
    table.objects.refresh()
    assert swatch.data(Qt.ItemDataRole.DecorationRole).getRgb()[:3] != (255, 0, 0)


def test_names_sort_as_people_count_and_volumes_as_numbers(table: ObjectTable) -> None:
    assert _shown(table, Column.NAME) == ["Object 2", "Object 10", "Shoe"]
    table.sortByColumn(Column.VOLUME, Qt.SortOrder.DescendingOrder)
    assert _shown(table, Column.NAME) == ["Object 2", "Shoe", "Object 10"]


def test_search_finds_names_and_ids(table: ObjectTable) -> None:
    table.rows.keep_text("obj")
    assert _shown(table, Column.NAME) == ["Object 2", "Object 10"]
    table.rows.keep_text("5")
    assert _shown(table, Column.NAME) == ["Shoe"]
    table.rows.keep_text("")
    assert len(_shown(table, Column.NAME)) == 3


def test_search_finds_the_ids_that_people_know(
    table: ObjectTable, session: SimpleNamespace
) -> None:
    session.label_of = {3: 70001, 5: 3, 8: 70003}.get
    table.objects.load(None)
    table.objects.load(session)
    table.rows.keep_text("3")
    assert _shown(table, Column.NAME) == ["Shoe"]


def test_objects_of_unknown_density_come_before_all_that_are_known(qtbot: QtBot) -> None:
    session = _session(tuple("abcdef"), (1, 2, 3, 4, 5, 6))
    session.objects["mean_density"] = [700.0, 300.0, np.nan, 900.0, 100.0, np.nan]
    model = ObjectModel(session.rename)
    model.load(session)
    table = ObjectTable(model)
    qtbot.addWidget(table)
    table.sortByColumn(Column.DENSITY, Qt.SortOrder.AscendingOrder)
    assert "".join(_shown(table, Column.NAME)) == "cfebad"


@pytest.mark.parametrize("form", ["NFC", "NFD"])
def test_accents_are_found_however_they_are_written(
    table: ObjectTable, session: SimpleNamespace, form: str
) -> None:
    # A key gives one letter, and a file of macOS a letter and its accent.
    session.rename(5, unicodedata.normalize(form, "Café tin"))
    table.objects.refresh()
    for typed in ("NFC", "NFD"):
        table.rows.keep_text(unicodedata.normalize(typed, "CAFÉ"))
        assert len(_shown(table, Column.NAME)) == 1


def test_a_search_that_finds_nothing_says_so(table: ObjectTable) -> None:
    def ink() -> int:
        image = table.viewport().grab().toImage()
        ground = image.pixelColor(0, 0)
        places = ((x, y) for x in range(image.width()) for y in range(image.height()))
        return sum(image.pixelColor(x, y) != ground for x, y in places)

    table.show()
    table.rows.keep_text("no such thing")
    assert _shown(table, Column.NAME) == []
    assert ink() > 50
    # Without any object there is nothing to search.
    table.objects.load(None)
    assert ink() == 0


def test_states_filter_and_follow_the_session(table: ObjectTable, session: SimpleNamespace) -> None:
    table.rows.keep(FILTERS["Hidden"])
    assert _shown(table, Column.NAME) == []
    session.states[5] = ObjectState.HIDDEN
    table.objects.refresh()
    assert _shown(table, Column.STATE) == ["hidden"]


def test_what_is_flagged_or_has_a_note_is_listed_alone(
    table: ObjectTable, session: SimpleNamespace
) -> None:
    table.rows.keep(FILTERS["Flagged"])
    session.annotations.flags[5] = "cleared"
    session.annotations.notes[8] = "look at this"
    table.objects.refresh()
    assert _shown(table, Column.NAME) == ["Shoe"]
    table.rows.keep(FILTERS["With a note"])
    assert _shown(table, Column.NAME) == ["Object 2"]
    table.rows.keep(FILTERS["All"])
    assert len(_shown(table, Column.NAME)) == 3


def test_only_rows_that_changed_are_told(table: ObjectTable, session: SimpleNamespace) -> None:
    told = []
    table.objects.dataChanged.connect(lambda a, b: told.append((a.row(), a.column(), b.column())))
    session.hues[8] = 0.5
    table.objects.refresh()
    assert told == [(2, Column.SWATCH, Column.SWATCH)]
    session.states[3] = ObjectState.UNPACKED
    table.objects.refresh()
    assert told[1:] == [(0, Column.EYE, Column.NOTE)]


def test_an_unpackable_object_says_so_until_it_leaves(
    table: ObjectTable, session: SimpleNamespace
) -> None:
    table.objects.refresh(unpackable={3})
    words = dict(zip(_shown(table, Column.NAME), _shown(table, Column.STATE), strict=True))
    assert words == {"Object 10": "unpackable", "Shoe": "in the bag", "Object 2": "in the bag"}
    session.states[3] = ObjectState.FLYING_OUT
    table.objects.refresh()
    assert "flying" in _shown(table, Column.STATE)


def test_a_rename_reaches_the_session_and_an_empty_one_does_not(
    table: ObjectTable, session: SimpleNamespace
) -> None:
    cell = table.rows.index(_shown(table, Column.NAME).index("Shoe"), Column.NAME)
    assert table.rows.setData(cell, " Boot ")
    assert session.objects.at[5, "name"] == "Boot"
    assert not table.rows.setData(table.rows.index(0, Column.NAME), "  ")
    assert sorted(_shown(table, Column.NAME)) == ["Boot", "Object 10", "Object 2"]


def _typing(qtbot: QtBot, table: ObjectTable, object_id: int, text: str) -> QLineEdit:
    """Open the name of an object, type over it and go back by one letter; return the field."""
    table.activateWindow()
    qtbot.waitUntil(table.isActiveWindow, timeout=5000)
    cell = table.rows.index_of(object_id)
    table.setCurrentIndex(cell)
    table.edit(cell)
    field = table.focusWidget()
    assert isinstance(field, QLineEdit)
    qtbot.keyClicks(field, text)
    qtbot.keyClick(field, Qt.Key.Key_Left)
    return field


def test_a_name_is_typed_on_while_all_rows_are_read_anew(
    qtbot: QtBot, table: ObjectTable, session: SimpleNamespace
) -> None:
    first, told = _typing(qtbot, table, 5, "Red t"), []
    table.ids_selected.connect(told.append)
    session.objects["confidence"] = 0.5
    table.objects.load(session)
    field = table.focusWidget()
    assert isinstance(field, QLineEdit)
    assert field is not first
    qtbot.keyClicks(field, "boo")
    qtbot.keyClick(field, Qt.Key.Key_Return)
    # Qt gives it back once the key is dealt with.
    qtbot.waitUntil(lambda: session.objects.at[5, "name"] == "Red boot", timeout=5000)
    assert _shown(table, Column.NAME) == ["Object 2", "Object 10", "Red boot"]
    assert told == []


def test_a_name_typed_for_what_is_gone_is_given_to_nothing_else(
    qtbot: QtBot, table: ObjectTable, session: SimpleNamespace
) -> None:
    other = _session(("Object 10", "Shoe", "Object 2"), (3, 5, 8))
    _typing(qtbot, table, 5, "Red t")
    table.objects.load(other)
    assert table.focusWidget() is table
    assert other.objects.at[5, "name"] == "Shoe"
    _typing(qtbot, table, 5, "Red t")
    boxes, left = other.boxes, [0, 2]
    boxes.ids, boxes.lower, boxes.upper = boxes.ids[left], boxes.lower[left], boxes.upper[left]
    table.objects.load(other)
    assert table.focusWidget() is table
    assert _shown(table, Column.NAME) == ["Object 2", "Object 10"]


def _centre(table: ObjectTable, row: int, column: Column) -> QPoint:
    return table.visualRect(table.rows.index(row, column)).center()


@pytest.mark.parametrize(
    ("column", "signal"),
    [
        (Column.EYE, "eye_clicked"),
        (Column.SWATCH, "swatch_clicked"),
        (Column.FLAG, "flag_clicked"),
    ],
)
def test_a_click_on_a_picture_acts_and_selects_nothing(
    qtbot: QtBot, table: ObjectTable, column: Column, signal: str
) -> None:
    with qtbot.waitSignal(getattr(table, signal), timeout=1000) as heard:
        qtbot.mouseClick(table.viewport(), Qt.MouseButton.LeftButton, pos=_centre(table, 1, column))
    assert heard.args == [table.rows.index(1, column).data(ID)]
    assert table.selected_ids() == []
    # The same by the keyboard.
    table.setCurrentIndex(table.rows.index(2, column))
    with qtbot.waitSignal(getattr(table, signal), timeout=1000) as heard:
        qtbot.keyClick(table, Qt.Key.Key_Space)
    assert heard.args == [table.rows.index(2, column).data(ID)]


def test_selection_by_hand_is_told_and_selection_from_elsewhere_is_not(
    qtbot: QtBot, table: ObjectTable
) -> None:
    told = []
    table.ids_selected.connect(told.append)
    qtbot.mouseClick(
        table.viewport(), Qt.MouseButton.LeftButton, pos=_centre(table, 0, Column.NAME)
    )
    assert told == [frozenset({8})]
    table.show_selection(frozenset({3, 5}))
    assert table.selected_ids() == [3, 5]
    assert len(told) == 1


def test_letters_are_left_to_the_viewer(qtbot: QtBot, table: ObjectTable) -> None:
    table.selectRow(0)
    before = table.currentIndex()
    qtbot.keyClick(table, Qt.Key.Key_S)
    assert table.currentIndex() == before


def test_control_a_selects_every_row(table: ObjectTable) -> None:
    # With the text that X11 gives it.
    event = QKeyEvent(
        QEvent.Type.KeyPress, Qt.Key.Key_A, Qt.KeyboardModifier.ControlModifier, "\x01"
    )
    QApplication.sendEvent(table, event)
    assert sorted(table.selected_ids()) == [3, 5, 8]


def test_columns_show_where_there_is_room_and_confidence_first(table: ObjectTable) -> None:
    rare = (Column.CONFIDENCE, Column.SIZE, Column.DENSITY)

    def shown(width: int) -> list[bool]:
        table.resize(width, 240)
        return [not table.isColumnHidden(column) for column in rare]

    # Of the panel's own width, less its margins and two bars to scroll.
    assert shown(274) == [True, False, False]
    assert not table.isColumnHidden(Column.VOLUME)
    # The state moves beneath the name, in rows that are as much taller, and is drawn there.
    assert table.isColumnHidden(Column.STATE)
    assert table.rowHeight(0) > 24
    before = table.grab().toImage()
    table.objects.refresh(unpackable={8})
    assert table.grab().toImage() != before
    assert shown(400) == [True, False, False]
    assert not table.isColumnHidden(Column.STATE)
    assert table.rowHeight(0) == 24
    assert shown(700) == [True, True, True]
    assert not table.horizontalScrollBar().isVisible()


def test_a_column_that_is_chosen_is_seen_and_the_state_stays_beneath_the_name(
    table: ObjectTable,
) -> None:
    # The panel's own width, less its margins and two bars to scroll.
    table.resize(274, 240)
    note = next(one for one in table.columns_menu().actions() if one.text() == "Note")
    note.trigger()
    header = table.horizontalHeader()
    end = header.sectionViewportPosition(Column.NOTE) + header.sectionSize(Column.NOTE)
    assert 0 < end <= table.viewport().width()
    assert table.isColumnHidden(Column.STATE)
    assert table.rowHeight(0) > 24


def test_names_and_states_are_whole_in_the_narrow_panel(
    table: ObjectTable, session: SimpleNamespace, qtbot: QtBot
) -> None:
    # The panel's own width, less its margins and two bars to scroll.
    table.resize(274, 240)
    session.queries.unpackable_groups = lambda: ((3, 5),)
    table.objects.refresh(unpackable={3, 5})
    assert not table.isColumnHidden(Column.CONFIDENCE)
    advance = table.fontMetrics().horizontalAdvance
    # The state stands beneath the name, and smaller.
    needed = [advance("Object 12, part"), *(SMALLER * advance(mark) for mark in MARKS)]
    assert table.columnWidth(Column.NAME) >= max(needed) + PADDING
    assert not table.horizontalScrollBar().isVisible()
    # Where the state has a column, what can leave is written bold.
    bold = QFont(table.font())
    bold.setBold(True)
    table.resize(420, 240)
    assert not table.isColumnHidden(Column.STATE)
    for mark in MARKS:
        width = QFontMetrics(bold).horizontalAdvance(mark) + PADDING
        assert table.columnWidth(Column.STATE) >= width
    assert not table.horizontalScrollBar().isVisible()


@pytest.mark.parametrize("width", [274, 420])
@pytest.mark.parametrize(
    "names",
    [
        ("Object 1, part", "Object 12, part"),
        ("Object 1, part, part, part of it", "Object 12, part, part, part of it"),
        ("Brown shoe of the left foot 1", "Brown shoe of the left foot 2"),
    ],
)
def test_names_that_are_cut_short_are_told_apart(
    table: ObjectTable, session: SimpleNamespace, names: tuple[str, str], width: int
) -> None:
    session.objects["name"] = [*names, "Shoe"]
    table.objects.load(session)
    table.resize(width, 240)
    shown = table.viewport().grab().toImage()
    scale = shown.devicePixelRatio()
    rows = [_shown(table, Column.NAME).index(name) for name in names]
    cells = [table.visualRect(table.rows.index(row, Column.NAME)) for row in rows]
    first, second = (
        shown.copy(*(round(scale * v) for v in (c.x(), c.y(), c.width(), c.height())))
        for c in cells
    )
    assert first != second


def test_what_blocks_an_object_is_told_from_its_beginning_on(table: ObjectTable) -> None:
    table.resize(1400, 240)
    needed = table.fontMetrics().horizontalAdvance("Objects 10, 11, 12 and 9 others") + PADDING
    assert table.columnWidth(Column.BLOCKERS) >= needed
    assert table.textElideMode() == Qt.TextElideMode.ElideRight


def test_confidence_nobody_knows_takes_no_room(
    table: ObjectTable, session: SimpleNamespace
) -> None:
    session.objects["confidence"] = np.nan
    table.objects.load(session)
    assert table.isColumnHidden(Column.CONFIDENCE)


def test_a_row_tells_all_facts_in_its_tooltip(table: ObjectTable) -> None:
    row = _shown(table, Column.NAME).index("Shoe")
    tip = table.rows.index(row, Column.NAME).data(Qt.ItemDataRole.ToolTipRole)
    assert tip == "Shoe, object 5, in the bag\n300 mm³, 25 × 6 × 2 mm\nmean density 1001"


def test_the_confidence_says_why_it_is_low(session: SimpleNamespace) -> None:
    model = ObjectModel(session.rename, reasons=lambda i: f"Lowered because of {i}.")
    session.objects["confidence"] = [0.2, np.nan, 0.9]
    model.load(session)
    tips = [
        model.index(row, Column.CONFIDENCE).data(Qt.ItemDataRole.ToolTipRole)
        for row in range(model.rowCount())
    ]
    assert [tip.partition("Lowered because")[2] for tip in tips] == [" of 3.", "", " of 8."]


def test_a_thousand_rows_refresh_within_a_frame(qtbot: QtBot) -> None:
    from time import thread_time

    ids = tuple(range(1, 1001))
    session = _session(tuple(f"Object {i}" for i in ids), ids)
    model = ObjectModel(session.rename)
    table = ObjectTable(model)
    qtbot.addWidget(table)
    model.load(session)
    session.states[500] = ObjectState.UNPACKED
    # Of the processor: other tests run at the same time.
    start = thread_time()
    model.refresh()
    assert thread_time() - start < 0.1


def test_a_thousand_rows_are_selected_and_read_as_they_are_sorted(qtbot: QtBot) -> None:
    ids = tuple(range(1, 1001))
    session = _session(tuple(f"Object {i}" for i in ids), ids)
    model = ObjectModel(session.rename)
    table = ObjectTable(model)
    qtbot.addWidget(table)
    model.load(session)
    asked: list[int] = []
    flags = model.flags
    model.flags = lambda index: asked.append(1) or flags(index)  # type: ignore[method-assign]
    table.sortByColumn(Column.NAME, Qt.SortOrder.DescendingOrder)
    wanted = frozenset({3, 4, 5, *range(10, 1000)})
    table.show_selection(wanted)
    assert table.selected_ids() == sorted(wanted, reverse=True)
    table.show_selection(frozenset())
    assert table.selected_ids() == []
    # Qt's own list asked for the flags of every cell, each time.
    assert len(asked) < 4 * len(ids)


def test_selected_rows_are_looked_up_once_until_rows_or_selection_change(
    table: ObjectTable, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []
    data = ObjectModel.data

    def counted(self: ObjectModel, index: object, role: int = 0) -> object:
        asked.extend([1] if role == ID else [])
        return data(self, index, role)

    monkeypatch.setattr(ObjectModel, "data", counted)
    table.show_selection(frozenset({3, 8}))
    assert [table.selected_ids() for _ in range(3)] == [[8, 3]] * 3
    assert len(asked) == 2
    table.sortByColumn(Column.NAME, Qt.SortOrder.DescendingOrder)
    assert table.selected_ids() == [3, 8]
    table.rows.keep_text("2")
    assert table.selected_ids() == [8]
    table.rows.keep_text("")
    table.show_selection(frozenset({5}))
    assert table.selected_ids() == [5]
    table.objects.load(None)
    assert table.selected_ids() == []


@pytest.mark.parametrize("points", [8, 12, 18])
def test_nothing_is_cut_off_in_any_font(qtbot: QtBot, table: ObjectTable, points: int) -> None:
    font = table.font()
    font.setPointSize(points)
    table.setFont(font)
    table.resize(1200, 300)
    table.show()
    room = table.columnWidth(Column.CONFIDENCE)
    assert room > table.fontMetrics().horizontalAdvance("99 %") + 8
    assert (
        table.columnWidth(Column.STATE) >= table.fontMetrics().horizontalAdvance("in the bag") + 15
    )


def _many(qtbot: QtBot, count: int) -> tuple[ObjectTable, SimpleNamespace]:
    ids = tuple(range(1, count + 1))
    session = _session(tuple(f"Object {i}" for i in ids), ids)
    model = ObjectModel(session.rename)
    model.load(session)
    table = ObjectTable(model)
    qtbot.addWidget(table)
    return table, session


def test_the_sorted_rows_keep_qts_rules(qtmodeltester: ModelTester, table: ObjectTable) -> None:
    table.sortByColumn(Column.VOLUME, Qt.SortOrder.DescendingOrder)
    qtmodeltester.check(table.rows.sourceModel())


def test_rows_that_are_alike_stay_in_the_order_of_their_ids_up_and_down(qtbot: QtBot) -> None:
    table, session = _many(qtbot, 6)
    for i in (2, 5):
        session.states[i] = ObjectState.HIDDEN
    table.objects.refresh()
    for order, words in (
        (Qt.SortOrder.AscendingOrder, ["2", "5", "1", "3", "4", "6"]),
        (Qt.SortOrder.DescendingOrder, ["1", "3", "4", "6", "2", "5"]),
    ):
        table.sortByColumn(Column.STATE, order)
        assert _shown(table, Column.NAME) == [f"Object {word}" for word in words]


def test_the_order_follows_what_changes_and_takes_the_selection_along(
    table: ObjectTable, session: SimpleNamespace
) -> None:
    assert _shown(table, Column.NAME) == ["Object 2", "Object 10", "Shoe"]
    table.selectRow(2)
    current = table.currentIndex().data(ID)
    session.rename(5, "A shoe")
    table.objects.refresh()
    assert _shown(table, Column.NAME) == ["A shoe", "Object 2", "Object 10"]
    assert table.selected_ids() == [5] == [current]
    assert table.currentIndex().row() == 0
    # Another order of columns that are not sorted by moves nothing.
    table.rows.keep_text("object")
    session.rename(8, "Object 11")
    table.objects.refresh()
    assert _shown(table, Column.NAME) == ["Object 10", "Object 11"]
    table.rows.keep_text("")
    table.objects.load(session)
    assert _shown(table, Column.NAME) == ["A shoe", "Object 10", "Object 11"]


def test_two_tables_of_one_model_have_an_order_each(
    table: ObjectTable, session: SimpleNamespace, qtbot: QtBot
) -> None:
    other = ObjectTable(table.objects, "another")
    qtbot.addWidget(other)
    other.sortByColumn(Column.VOLUME, Qt.SortOrder.AscendingOrder)
    assert _shown(other, Column.NAME) == ["Object 10", "Shoe", "Object 2"]
    assert _shown(table, Column.NAME) == ["Object 2", "Object 10", "Shoe"]


def test_sorting_loading_and_searching_ask_for_a_row_a_few_times(
    qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    table, session = _many(qtbot, 1000)
    asked: list[str] = []
    for name in ("rowCount", "columnCount", "index", "data"):
        monkeypatch.setattr(ObjectModel, name, _counting(getattr(ObjectModel, name), name, asked))

    def count(act: Callable[[], object]) -> float:
        asked.clear()
        act()
        return len(asked) / 1000

    # To compare rows in Qt took some fifty calls a row.
    order = Qt.SortOrder.DescendingOrder
    assert count(lambda: table.sortByColumn(Column.VOLUME, order)) < 3
    assert count(lambda: table.objects.load(session)) < 3
    assert count(lambda: table.rows.keep_text("12")) < 3
    assert count(lambda: table.rows.keep_text("")) < 3


def test_a_change_of_many_rows_is_told_once_and_other_rows_are_not_made_anew(
    qtbot: QtBot,
) -> None:
    table, session = _many(qtbot, 1000)
    model = table.objects
    told: list[tuple[int, ...]] = []
    model.dataChanged.connect(lambda a, b: told.append((a.row(), b.row(), a.column(), b.column())))
    before = [model.row_at(k) for k in range(1000)]
    for i in range(11, 900, 2):
        session.states[i] = ObjectState.HIDDEN
    model.refresh()
    assert told == [(10, 898, Column.EYE, Column.NOTE)]
    session.hues.update(dict.fromkeys(range(1, 1001), 0.3))
    model.refresh()
    assert told[1:] == [(0, 999, Column.SWATCH, Column.SWATCH)]
    # A repair that gives one object another volume makes one row anew.
    before = [model.row_at(k) for k in range(1000)]
    session.objects.loc[7, "volume_mm3"] = 5.0
    model.load(session)
    assert [k for k in range(1000) if model.row_at(k) is not before[k]] == [6]
    assert model.row_at(6).volume == 5.0


def test_many_selected_rows_are_sorted_without_a_look_at_each_cell(
    qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    table, _ = _many(qtbot, 1000)
    told: list[object] = []
    table.ids_selected.connect(told.append)
    wanted = frozenset({3, 4, 5, *range(10, 1000)})
    table.show_selection(wanted)
    asked: list[str] = []
    for name in ("rowCount", "columnCount", "index", "data", "flags"):
        monkeypatch.setattr(ObjectModel, name, _counting(getattr(ObjectModel, name), name, asked))
    table.sortByColumn(Column.VOLUME, Qt.SortOrder.DescendingOrder)
    assert len(asked) < 8 * 1000
    assert table.selected_ids() == sorted(wanted, reverse=True)
    assert told == []


def _counting(method: Callable[..., Any], name: str, asked: list[str]) -> Callable[..., Any]:
    def counted(self: ObjectModel, *args: object) -> object:
        asked.append(name)
        return method(self, *args)

    return counted
