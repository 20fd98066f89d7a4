"""The opacity curve under the mouse and the keyboard."""

from typing import Any

import numpy as np
import pytest
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QPoint, QPointF, Qt

import napari_unpack as nu
from napari_unpack.widgets.color_section import AUTOMATIC, CUSTOM, ct_offset, transfer_function
from napari_unpack.widgets.opacity_editor import OpacityEditor, histogram, round_densities
from napari_unpack.widgets.typed_points import TypedPoints, points_of
from opened_panel import pile_of_balls, rest

CURVE = [(0.0, 0.0), (500.0, 0.0), (1000.0, 0.125), (2000.0, 1.0)]


@pytest.fixture
def editor(qtbot: QtBot) -> OpacityEditor:
    made = OpacityEditor()
    qtbot.addWidget(made)
    made.resize(216, 130)
    made.show_curve(CURVE, (0.0, 2000.0))
    made.show()
    return made


def _spot(editor: OpacityEditor, k: int, across: float = 0.0, down: float = 0.0) -> object:
    return (editor.position(editor.points[k]) + QPointF(across, down)).toPoint()


def test_a_dragged_point_moves_and_says_so(qtbot: QtBot, editor: OpacityEditor) -> None:
    with qtbot.waitSignal(editor.edited) as heard:
        qtbot.mousePress(editor, Qt.MouseButton.LeftButton, pos=_spot(editor, 2))
        qtbot.mouseMove(editor, _spot(editor, 2, 20, -25))
    # 200 px for the square root of 2000 densities, 100 px for the cubic root of opacity:
    # 1000 is drawn at 141 px, and 161 px of 200 are 0.65 of 2000.
    density, opacity = heard.args[0][2]
    assert density == pytest.approx(1300, abs=10)
    assert opacity == pytest.approx(0.75**3, abs=0.03)
    qtbot.mouseRelease(editor, Qt.MouseButton.LeftButton)
    qtbot.mouseMove(editor, _spot(editor, 2, -40, 0))
    assert editor.points[2][0] == pytest.approx(1300, abs=10)


def test_the_chosen_point_is_named_in_plain_numbers_until_another_curve_is_shown(
    qtbot: QtBot, editor: OpacityEditor
) -> None:
    assert editor.label_text == ""
    metal = [(0.0, 0.0), (9000.0, 0.0), (12340.0, 0.9)]
    editor.show_curve(metal, (0.0, 16000.0))
    qtbot.mousePress(editor, Qt.MouseButton.LeftButton, pos=_spot(editor, 2))
    qtbot.mouseRelease(editor, Qt.MouseButton.LeftButton, pos=_spot(editor, 2))
    assert editor.label_text == "density 12340, opacity 0.9"
    editor.show_curve([*metal[:2], (12000.0, 0.8)], (0.0, 16000.0))
    assert editor.label_text == "density 12000, opacity 0.8"
    editor.show_curve(CURVE, (0.0, 16000.0))
    assert editor.label_text == ""


def test_a_point_cannot_pass_its_neighbours(qtbot: QtBot, editor: OpacityEditor) -> None:
    qtbot.mousePress(editor, Qt.MouseButton.LeftButton, pos=_spot(editor, 2))
    qtbot.mouseMove(editor, _spot(editor, 2, -90, 0))
    assert editor.points[2][0] == 502.0


def test_a_double_click_adds_a_point_and_a_right_click_removes_it(
    qtbot: QtBot, editor: OpacityEditor
) -> None:
    empty = _spot(editor, 0, 60, -50)
    qtbot.mouseDClick(editor, Qt.MouseButton.LeftButton, pos=empty)
    assert len(editor.points) == 5
    assert editor.points[1] == pytest.approx((0.09 * 2000, 0.125), abs=3)
    qtbot.mouseRelease(editor, Qt.MouseButton.LeftButton)
    qtbot.mousePress(editor, Qt.MouseButton.RightButton, pos=empty)
    assert editor.points == CURVE


def test_a_second_right_click_as_fast_as_a_double_click_adds_nothing(
    qtbot: QtBot, editor: OpacityEditor
) -> None:
    right, here, beside = Qt.MouseButton.RightButton, _spot(editor, 1), _spot(editor, 2)
    qtbot.mouseClick(editor, right, pos=here)
    qtbot.mouseDClick(editor, right, pos=here)
    assert editor.points == [CURVE[0], *CURVE[2:]]
    # It is a right click as any other.
    qtbot.mouseDClick(editor, right, pos=beside)
    assert editor.points == [CURVE[0], CURVE[3]]


def test_dragging_beside_the_points_moves_the_whole_curve(
    qtbot: QtBot, editor: OpacityEditor
) -> None:
    start = _spot(editor, 0, 40, -60)
    qtbot.mousePress(editor, Qt.MouseButton.LeftButton, pos=start)
    qtbot.mouseMove(editor, _spot(editor, 0, 60, -60))
    moved = [density for density, _ in editor.points]
    assert moved == pytest.approx([100, 600, 1100, 2100], abs=1)
    assert [opacity for _, opacity in editor.points] == [opacity for _, opacity in CURVE]


def test_dragging_with_shift_widens_the_window(qtbot: QtBot, editor: OpacityEditor) -> None:
    shift = Qt.KeyboardModifier.ShiftModifier
    start = _spot(editor, 0, 40, -60)
    qtbot.mousePress(editor, Qt.MouseButton.LeftButton, shift, pos=start)
    qtbot.mouseMove(editor, _spot(editor, 0, 60, -60))
    # A hundred densities of 2000 stretch by a tenth, about the middle of 1000 to 2000.
    moved = [density for density, _ in editor.points]
    assert moved == pytest.approx([-150, 400, 950, 2050], abs=2)
    assert [opacity for _, opacity in editor.points] == [opacity for _, opacity in CURVE]


def test_delete_and_arrows_act_on_the_chosen_point(qtbot: QtBot, editor: OpacityEditor) -> None:
    qtbot.mouseClick(editor, Qt.MouseButton.LeftButton, pos=_spot(editor, 1))
    qtbot.keyClick(editor, Qt.Key.Key_Right)
    assert editor.points[1][0] == pytest.approx(0.505**2 * 2000)
    qtbot.keyClick(editor, Qt.Key.Key_Delete)
    assert len(editor.points) == 3


def test_keys_alone_choose_move_and_add_points(qtbot: QtBot, editor: OpacityEditor) -> None:
    key, shift = Qt.Key, Qt.KeyboardModifier.ShiftModifier
    qtbot.keyClick(editor, key.Key_PageDown)
    assert editor.label_text == "density 0, opacity 0"
    qtbot.keyClick(editor, key.Key_PageUp)
    assert editor.label_text == "density 2000, opacity 1"
    qtbot.keyClick(editor, key.Key_PageUp)
    # Of 100 pixels opacity 0.125 is drawn at 50; ten less, and then one less.
    qtbot.keyClick(editor, key.Key_Down, shift)
    assert editor.points[2] == pytest.approx((1000, 0.4**3))
    qtbot.keyClick(editor, key.Key_Down)
    assert editor.points[2] == pytest.approx((1000, 0.39**3))
    # Halfway in pixels: from 39 to 100, and from 141 of 200 to 200.
    qtbot.keyClick(editor, key.Key_Plus)
    share = (np.sqrt(0.5) + 1) / 2
    assert editor.points[3] == pytest.approx((share**2 * 2000, 0.695**3))
    assert editor.points[4] == CURVE[3]
    qtbot.keyClick(editor, key.Key_Delete)
    qtbot.keyClick(editor, key.Key_Left)
    assert editor.label_text == "density 0, opacity 0"


def test_two_points_always_stay(qtbot: QtBot, editor: OpacityEditor) -> None:
    editor.show_curve([(0.0, 0.0), (2000.0, 1.0)], (0.0, 2000.0))
    qtbot.mousePress(editor, Qt.MouseButton.RightButton, pos=_spot(editor, 0))
    assert len(editor.points) == 2


def test_a_curve_from_elsewhere_does_not_tear_the_point_from_the_hand(
    qtbot: QtBot, editor: OpacityEditor
) -> None:
    qtbot.mousePress(editor, Qt.MouseButton.LeftButton, pos=_spot(editor, 2))
    editor.show_curve([(0.0, 0.0), (8000.0, 1.0)], (0.0, 8000.0))
    assert editor.points == CURVE
    # 200 px from 8 on: the axis too is another one only once the mouse lets go.
    assert editor.position((2000.0, 0.0)).x() == pytest.approx(208)
    qtbot.mouseRelease(editor, Qt.MouseButton.LeftButton, pos=_spot(editor, 2))
    assert editor.points == CURVE
    assert editor.position((2000.0, 0.0)).x() == pytest.approx(108)


def test_a_curve_under_the_hand_is_none_of_another_bag(panel, piled, qtbot: QtBot) -> None:
    panel.color.curve.toggle.setChecked(True)
    editor, other = panel.color.editor, nu.Session(*pile_of_balls())
    curve = other.transfer_function.points
    qtbot.mousePress(editor, Qt.MouseButton.LeftButton, pos=editor.rect().center())
    qtbot.mouseMove(editor, editor.rect().center() + QPoint(20, 0))
    assert tuple(editor.points) != curve
    panel.workspace.open(other)
    assert tuple(editor.points) == curve
    qtbot.mouseMove(editor, editor.rect().center())
    qtbot.mouseRelease(editor, Qt.MouseButton.LeftButton)
    assert tuple(editor.points) == curve
    rest(panel, qtbot)
    assert other.transfer_function.points == curve


def test_a_point_that_was_dragged_out_with_the_curve_is_taken_hold_of_there(
    qtbot: QtBot, editor: OpacityEditor
) -> None:
    qtbot.mousePress(editor, Qt.MouseButton.LeftButton, pos=_spot(editor, 2, 0, -30))
    qtbot.mouseMove(editor, _spot(editor, 0, 40, -80))
    qtbot.mouseRelease(editor, Qt.MouseButton.LeftButton)
    assert editor.points[1][0] < 0
    qtbot.mousePress(editor, Qt.MouseButton.LeftButton, pos=_spot(editor, 0))
    qtbot.mouseMove(editor, _spot(editor, 0, 2, -10))
    densities = [density for density, _ in editor.points]
    assert densities == sorted(densities)


def test_the_axis_grows_to_a_curve_that_is_dragged_or_typed_beyond_it(
    panel, piled, qtbot: QtBot
) -> None:
    panel.color.curve.toggle.setChecked(True)
    editor, line = panel.color.editor, panel.color.typed
    left, right = editor.position((20.0, 0.0)).x(), editor.position((4500.0, 0.0)).x()
    line.selectAll()
    qtbot.keyClicks(line, "3000 0, 6000 1")
    qtbot.keyClick(line, Qt.Key.Key_Return)
    qtbot.waitUntil(lambda: editor.points == [(3000.0, 0.0), (6000.0, 1.0)], timeout=5000)
    assert editor.position((6000.0, 0.0)).x() == pytest.approx(right)
    assert editor.position((20.0, 0.0)).x() == pytest.approx(left)
    assert editor.position((1000.0, 0.0)).x() > left + 20


def test_the_histogram_is_logarithmic_and_ignores_nan() -> None:
    volume = np.full((4, 4, 4), np.nan)
    volume[:, :, 0] = 8.1
    volume[0, 0, 1] = 72.1
    heights = histogram(volume, (0.0, 128.0))
    assert heights[32] == 1.0
    assert heights[96] == pytest.approx(np.log(2) / np.log(17))
    assert np.count_nonzero(heights) == 2


def test_the_axis_has_round_numbers() -> None:
    assert round_densities(0.0, 4000.0) == [0.0, 100.0, 400.0, 1000.0, 2000.0, 3000.0, 4000.0]
    assert round_densities(0.0, 1.0)[-1] == 1.0
    assert round_densities(-1000.0, 3000.0)[0] == -1000.0


def test_points_are_typed_and_what_cannot_be_is_told(qtbot: QtBot, monkeypatch) -> None:
    line, told, warned = TypedPoints(), [], []
    monkeypatch.setattr("napari_unpack.widgets.notifications.warn", warned.append)
    qtbot.addWidget(line)
    line.edited.connect(told.append)
    line.show_points(CURVE)
    assert line.text() == "0 0, 500 0, 1000 0.125, 2000 1"
    # A longer one is seen from its beginning.
    assert line.cursorPosition() == 0
    qtbot.keyClick(line, Qt.Key.Key_Return)
    assert told == []
    line.selectAll()
    qtbot.keyClicks(line, "0 0, 700 0.25; 3000 1")
    qtbot.keyClick(line, Qt.Key.Key_Return)
    assert told == [[(0.0, 0.0), (700.0, 0.25), (3000.0, 1.0)]]
    line.show_points(told[0])
    line.selectAll()
    qtbot.keyClicks(line, "0 0, 700")
    qtbot.keyClick(line, Qt.Key.Key_Return)
    assert len(told) == 1
    assert "densities ascending and opacities from 0 to 1" in warned[0]
    assert line.text() == "0 0, 700 0.25, 3000 1"
    for wrong in ("", "1 0", "1 0, 1 1", "2 0, 1 1", "0 0, 1 2", "0 0,5 0, 1"):
        with pytest.raises(ValueError, match="pairs of density and opacity"):
            points_of(wrong)


@pytest.mark.parametrize(
    "text",
    [
        "0 0; 144,38 0; 311 0,2", "0 0, 144,38 0, 311 0,2", "0 0; 144.38 0; 311 0.2",
        "0 0,144.38 0,311 0.2", "0 0;144,38 0,0; 311 0.2",
    ],
)  # fmt: skip
def test_an_opacity_curve_is_read_with_points_and_with_decimal_commas(text: str) -> None:
    assert points_of(text) == [(0.0, 0.0), (144.38, 0.0), (311.0, 0.2)]


def test_a_usual_curve_is_shown_with_as_many_digits_as_fit(panel: Any) -> None:
    line = panel.color.typed
    line.show_points(
        [(0.0, 0.0), (96.462, 0.0), (214.36, 0.2), (415.0, 0.4), (2316.5, 0.65), (30000.0, 1.0)]
    )
    assert line.text() == "0 0, 96.5 0, 214 0.2, 415 0.4, 2316 0.65, 30000 1"
    # Scans that are scaled to 0 to 1.
    line.show_points([(0.0, 0.0), (0.12345, 0.2), (1.0, 1.0)])
    assert line.text() == "0 0, 0.123 0.2, 1 1"


@pytest.mark.parametrize(
    ("points", "shown", "more", "told"),
    [
        (
            [(0.0, 0.0), (1234.567, 0.0012345), (30000.0, 0.5)],
            "0 0, 1235 0.00123, 30000 0.5",
            "6, 31000 1",
            [(0.0, 0.0), (1234.567, 0.0012345), (30000.0, 0.6), (31000.0, 1.0)],
        ),
        # What lies close together is told apart.
        (
            [(0.0, 0.0), (1234.56, 0.2), (1234.58, 0.2), (3000.0, 0.5)],
            "0 0, 1234.56 0.2, 1234.58 0.2, 3000 0.5",
            "6",
            [(0.0, 0.0), (1234.56, 0.2), (1234.58, 0.2), (3000.0, 0.6)],
        ),
    ],
)
def test_points_that_are_left_as_they_stood_are_not_rounded(
    qtbot: QtBot, points: list[Any], shown: str, more: str, told: list[Any]
) -> None:
    line, heard = TypedPoints(), []
    qtbot.addWidget(line)
    line.edited.connect(heard.append)
    line.show_points(points)
    assert line.text() == shown
    line.end(False)
    qtbot.keyClick(line, Qt.Key.Key_Backspace)
    qtbot.keyClicks(line, more)
    qtbot.keyClick(line, Qt.Key.Key_Return)
    assert heard == [told]


def test_presets_are_of_ct_and_follow_its_values() -> None:
    density = np.linspace(0, 3000, 4000).reshape(10, 20, 20)
    assert ct_offset(density) == 0
    assert ct_offset(density - 1000) == -1000
    assert ct_offset(density / 3000) is None
    water = transfer_function("Water", density)
    assert water.opacity_at(1000) > 5 * water.opacity_at(1300)
    assert transfer_function("Water", density - 1000).opacity_at(0) == water.opacity_at(1000)


def test_the_list_of_presets_is_that_of_the_volume(panel, piled, qtbot: QtBot) -> None:
    titles = [panel.color.preset.itemText(k) for k in range(panel.color.preset.count())]
    assert titles[0] == AUTOMATIC
    assert titles[-1] == CUSTOM
    assert {"Soft: cloth to water", "Water", "Plastic", "Metal"} <= set(titles)
    panel.color.curve.toggle.setChecked(True)
    panel.color.typed.selectAll()
    qtbot.keyClicks(panel.color.typed, "0 0, 900 0, 1500 0.5")
    qtbot.keyClick(panel.color.typed, Qt.Key.Key_Return)
    wanted = ((0.0, 0.0), (900.0, 0.0), (1500.0, 0.5))
    qtbot.waitUntil(lambda: tuple(piled.transfer_function.points) == wanted, timeout=5000)
    assert panel.color.preset.currentText() == CUSTOM
