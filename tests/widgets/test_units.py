"""The unit chosen in step 1 is that of everything told."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from napari.layers import Image
from napari.utils.notifications import notification_manager
from pytestqt.qtbot import QtBot
from qtpy.QtCore import QLocale, Qt
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QApplication, QDoubleSpinBox, QLineEdit

from napari_unpack import io
from napari_unpack.geometry.length_unit import MICRO, MM, SIZE_ASSUMED, LengthUnit
from napari_unpack.io import open_session, save_objects_csv, save_session
from napari_unpack.io.file_data import NO_VOXEL_SIZE
from napari_unpack.io.report import save_objects_page
from napari_unpack.session.measurements import SurfacePoint
from napari_unpack.widgets.narrow import SIZED
from napari_unpack.widgets.object_model import Column
from napari_unpack.widgets.segment_options import SegmentOptions
from napari_unpack.widgets.theme import GAP
from napari_unpack.widgets.voxel_size import VoxelSize, edges_of
from opened_panel import add_bag, controller_with, pile_of_balls, press, rest

ONE, TWO = ("\u2009×\u2009".join(edges) for edges in ("111", "211"))


def _told(panel: Any) -> tuple[str, str, str]:
    """Return title and first cell of the volumes, and the title of the sizes."""
    model, across = panel.objects.model, Qt.Orientation.Horizontal
    titles = [model.headerData(c, across, 0) for c in (Column.VOLUME, Column.SIZE)]
    return titles[0], model.data(model.index(0, Column.VOLUME)), titles[1]


def test_table_facts_page_and_csv_follow_the_unit(
    panel: Any, piled: Any, qtbot: QtBot, tmp_path: Path
) -> None:
    voxels, names = panel.segment.voxels, panel.segment.voxels.names
    assert (voxels.size.text(), names.currentText()) == (TWO, "mm")
    assert _told(panel) == ("cm³", "8.9", "Size, mm")
    panel.commands.inspect(1)
    qtbot.waitUntil(lambda: "cm³" in panel.unpack.inspection.facts.text(), timeout=20000)
    # A file that says mm may mean µm: the numbers stay.
    panel.segment.fold.setChecked(False)
    smallest = panel.segment.options.smallest
    smallest.setValue(20.0)
    assert smallest.suffix() == " mm³"
    corner = SurfacePoint(0, (0.0, 0.0, 0.0))
    piled.measurements.add([corner, SurfacePoint(0, (0.0, 0.0, 30.0))])
    QTest.keyClick(names, Qt.Key.Key_Down)
    rest(panel, qtbot)
    assert (smallest.suffix(), smallest.value()) == (" µm³", 20.0)
    assert "500 µm³" in smallest.toolTip()
    assert panel.measure.list.item(0).text() == "30.0 µm"
    assert piled.scene().rulers[0].numbers == ("30.0 µm",)
    volume = float(piled.objects["volume_mm3"][1])
    assert piled.length_unit == LengthUnit(MICRO)
    assert (voxels.size.text(), _told(panel)) == (TWO, ("µm³", f"{volume:.0f}", "Size, µm"))
    assert f"{volume:.0f} µm³" in panel.unpack.inspection.facts.text()
    page = save_objects_page(piled, tmp_path / "page.html", backend="cpu").read_text("utf-8")
    assert "Volume µm³" in page
    assert "Size µm" in page

    QTest.keyClick(names, Qt.Key.Key_Down)
    rest(panel, qtbot)
    count = int(piled.objects["voxels"][1])
    assert _told(panel) == ("voxels", str(count), "Size, voxels")
    # As large as before, in voxels of 2 mm³.
    assert (smallest.suffix(), smallest.value()) == (" voxels", 10.0)
    assert panel.segment.options.settings()["smallest"] == pytest.approx(20.0)
    save_objects_csv(piled, tmp_path / "table.csv")
    table = pd.read_csv(tmp_path / "table.csv", index_col="id")
    assert table["volume_voxels"][1] == pytest.approx(count, rel=1e-5)
    assert table["z_voxels"][1] == pytest.approx(piled.objects["z"][1] / 2, rel=1e-5)
    save_session(piled, tmp_path / "saved.unpack")
    assert open_session(tmp_path / "saved.unpack").length_unit == piled.length_unit


def test_voxel_sizes_are_whole_beside_the_choice_of_unit(qtbot: QtBot) -> None:
    box = VoxelSize()
    qtbot.addWidget(box)
    box.show_layer(Image(np.zeros((2, 2, 2)), scale=(2.5, 1.951, 1.951)))
    measure = box.size.fontMetrics().horizontalAdvance
    # What a line to type into has around its text.
    frame = box.size.sizeHint().width() - SIZED * measure("x")
    beside = box.names.sizeHint().width() + GAP + frame
    wide = "2.5\u2009×\u20091.95\u2009×\u20091.95"
    for text in (wide, "2.5×1.95×1.95", "2.5 1.95 1.95", "2.5 2 2"):
        box.resize(beside + measure(text), 28)
        box.show()
        assert box.size.text() == text


@pytest.mark.parametrize(
    ("units", "scale", "unit", "size"),
    [
        ("um", (2, 1, 1), MICRO, TWO),
        ("nm", (2000, 1000, 1000), MICRO, TWO),
        ("pixel", (2, 1, 1), "mm", TWO),
        ("pixel", (1, 1, 1), "voxels", ONE),
    ],
)
def test_the_unit_is_the_layers_where_napari_knows_it(
    viewer: Any, panel: Any, qtbot: QtBot, units: str, scale: tuple[int, ...], unit: str, size: str
) -> None:
    image, labels = add_bag(viewer)
    for layer in (image, labels):
        layer.scale, layer.units = scale, (units,) * 3
    session = controller_with(panel, qtbot, labels)
    assert (panel.segment.voxels.size.text(), session.length_unit.name) == (size, unit)
    if units == "um":
        assert float(_told(panel)[1]) == pytest.approx(session.objects["voxels"][1] * 2, rel=1e-3)


def test_what_had_to_be_assumed_of_the_file_stands_below_the_voxel_size(
    qtbot: QtBot, tmp_path: Path
) -> None:
    from napari_unpack.io.napari_reader import get_reader

    np.save(tmp_path / "bag.npy", np.zeros((4, 5, 6), np.uint8))
    read = get_reader(str(tmp_path / "bag.npy"))
    assert read is not None
    with pytest.warns(UserWarning, match="1 mm was assumed"):
        (data, about, _), *_ = read(str(tmp_path / "bag.npy"))
    shown = VoxelSize()
    qtbot.addWidget(shown)
    shown.show_layer(Image(data, **about))
    assert shown.assumed.isVisibleTo(shown)
    assert shown.assumed.text() == "Of the file: it gives no voxel size: 1 mm was assumed."
    shown.show_layer(Image(data))
    assert not shown.assumed.isVisibleTo(shown)


def test_what_readers_assume_of_sizes_is_told_from_all_else_that_they_assume() -> None:
    # Read from their sources, so that a sentence that is worded anew is seen here.
    found = {
        text
        for file in Path(io.__file__).parent.glob("*.py")
        for text in re.findall(r'"([^"\n]* assumed[^"\n]*)"', file.read_text("utf-8"))
    }
    of_sizes = {text for text in found if SIZE_ASSUMED.search(text)}
    assert len(of_sizes) == 9
    assert {text.split(":")[0] for text in found - of_sizes} == {
        "it gives no positions of its slices",
        "it gives no direction of its slices",
        "{who} not say what {whose} numbers mean",
    }


def _type_size(panel: Any, text: str) -> None:
    size = panel.segment.voxels.size
    size.setFocus()
    size.selectAll()
    QTest.keyClicks(size, text)
    QTest.keyClick(size, Qt.Key.Key_Return)


def test_the_voxel_size_is_typed_and_is_that_of_the_volume_and_the_labels_on_it(
    viewer: Any, panel: Any, qtbot: QtBot
) -> None:
    volume, ids = np.zeros((8, 9, 10), np.uint16), np.ones((8, 9, 10), np.uint8)
    said = ("it holds 2 images: the first was taken", NO_VOXEL_SIZE)
    image = viewer.add_image(volume, rotate=(0, 0, 30), metadata={"assumed": said})
    labels = viewer.add_labels(ids, rotate=(0, 0, 30))
    # Neither has the shape of the image, or its size.
    small, other = viewer.add_labels(ids[1:]), viewer.add_labels(ids, scale=(5, 5, 5))
    panel.segment.volume_input.choose(image)
    voxels = panel.segment.voxels
    assert (voxels.size.text(), voxels.names.currentText()) == (ONE, "voxels")
    _type_size(panel, "3 0.51234 0.5")
    for layer in (image, labels):
        np.testing.assert_allclose(layer.scale, (3, 0.51234, 0.5))
        np.testing.assert_allclose(layer.data_to_world((2, 0, 0)), (6, 0, 0), atol=1e-12)
    for layer, scale in ((small, 1), (other, 5)):
        np.testing.assert_allclose(layer.scale, (scale,) * 3)
    assert voxels.names.currentText() == "mm"
    assert "3 × 0.51234 × 0.5 mm" in voxels.size.toolTip()
    assert "0.51234" not in voxels.size.text()
    assert voxels.assumed.text() == f"Of the file: {said[0]}."
    # Numbers that are left as they are shown keep what they were rounded from.
    # Qt's keys for tests know no thin space.
    _type_size(panel, voxels.size.text().replace("3", "2").replace("\u2009", " "))
    np.testing.assert_allclose(image.scale, (2, 0.51234, 0.5))


def test_a_voxel_size_that_is_half_typed_is_not_that_of_the_next_layer(qtbot: QtBot) -> None:
    box, told = VoxelSize(), []
    qtbot.addWidget(box)
    box.resize(400, 28)
    box.show()
    box.activateWindow()
    box.size.setFocus()
    qtbot.waitUntil(box.size.hasFocus, timeout=5000)
    box.typed.connect(told.append)
    first, second = (Image(np.zeros((2, 2, 2)), scale=(edge, 1, 1)) for edge in (3, 2))
    box.show_layer(first)
    box.size.selectAll()
    QTest.keyClicks(box.size, "5 5 5")
    # The layer itself is changed, by a script say.
    box.show_layer(first)
    assert box.size.text() == "5 5 5"
    box.show_layer(second)
    assert box.size.text() == TWO
    QTest.keyClick(box.size, Qt.Key.Key_Return)
    assert told == []


@pytest.mark.parametrize(
    "text",
    [
        "3 1", "3 1 1 1", "0 1 1", "-1 1 1", "1 nan 1", "1 1 nan", "inf 1 1", "a b c",
        # Two numbers or three; a point or thousands.
        "2,5 1", "2,5, 1", "1,953 1,953 1,953", "1,000 0.5 0.5", "1,000.5 1 1",
    ],
)  # fmt: skip
def test_a_voxel_size_that_is_none_is_refused_in_a_sentence(
    viewer: Any, panel: Any, text: str
) -> None:
    image = viewer.add_image(np.zeros((8, 9, 10), np.uint16), scale=(2, 1, 1))
    panel.segment.volume_input.choose(image)
    before = len(notification_manager.records)
    _type_size(panel, text)
    (said,) = [notice.message for notice in notification_manager.records[before:]]
    assert said.startswith("A voxel size must be three positive numbers, of z, y and x")
    assert said.endswith(f"got {text!r}.")
    np.testing.assert_allclose(image.scale, (2, 1, 1))
    assert panel.segment.voxels.size.text() == TWO


def test_of_voxels_all_that_is_typed_is_taken_for_millimetres(viewer: Any, panel: Any) -> None:
    image = viewer.add_image(np.zeros((8, 9, 10), np.uint16), scale=(2, 2, 2))
    panel.segment.volume_input.choose(image)
    names = panel.segment.voxels.names
    names.setCurrentText("voxels")
    names.activated.emit(names.currentIndex())
    assert panel.segment.voxels.size.text() == ONE
    _type_size(panel, "3 1 1")
    np.testing.assert_allclose(image.scale, (3, 1, 1))
    assert names.currentText() == "mm"


@pytest.mark.parametrize(
    "text",
    [
        "0,5 0,25 2", "0,5 × 0,25 × 2", "0,5; 0,25; 2", "0,5, 0,25, 2", "0.5, 0.25, 2",
        "0.5,0.25,2", "0,500 0,250 2,000", "0,5x0.25x2",
    ],
)  # fmt: skip
def test_a_voxel_size_is_read_with_points_and_with_decimal_commas(text: str) -> None:
    assert edges_of(text) == (0.5, 0.25, 2.0)


def test_the_smallest_object_stays_as_large_as_it_was_whatever_unit_is_shown_meanwhile(
    qtbot: QtBot,
) -> None:
    options = SegmentOptions()
    qtbot.addWidget(options)
    options.show_unit(LengthUnit(MICRO, 1000.0))
    options.smallest.setValue(100.0)
    shown = options.smallest.text()
    # Of a nucleus, less than a millimetre has digits for: none is set for a CT.
    options.show_unit(MM)
    assert options.smallest.text() == "automatic"
    assert options.settings()["smallest"] is None
    options.show_unit(LengthUnit(MICRO, 1000.0))
    assert options.smallest.text() == shown
    assert options.settings()["smallest"] == pytest.approx(1e-7)


def test_the_largest_smallest_object_is_what_the_box_shows_in_every_unit(qtbot: QtBot) -> None:
    options = SegmentOptions()
    qtbot.addWidget(options)
    # A litre is 2,915,451.9 voxels of 0.7 mm.
    options.show_unit(LengthUnit("voxels", 1 / 0.7))
    options.smallest.setValue(1e9)
    options.show_unit(MM)
    assert options.smallest.value() == options.settings()["smallest"] == 1e6


@pytest.fixture(params=["de_DE", "ar_EG"])
def country(request: pytest.FixtureRequest) -> Iterator[None]:
    """Have the system's numbers be those of a country, until all that counts is made."""
    QLocale.setDefault(QLocale(request.param))
    yield
    QLocale.setDefault(QLocale.c())


@pytest.mark.usefixtures("country")
def test_numbers_have_a_point_whatever_the_systems_are(
    viewer: Any, panel: Any, expert: Any, qtbot: QtBot
) -> None:
    controller_with(panel, qtbot, expert)
    panel.slices.button.click()
    boxes = [b for part in (panel, panel.slices.dock) for b in part.findChildren(QDoubleSpinBox)]
    # The smallest object, the clipping box, and the greys of slices.
    assert len(boxes) == 1 + 6 + 2
    for box in boxes:
        box.setRange(-9.0, 9.0)
        field = box.findChild(QLineEdit)
        for text, shown in (("1.5", "1.5"), ("2,5", "2.5"), ("\u0661\u066b\u0665", "1.5")):
            QApplication.clipboard().setText(text)
            field.selectAll()
            field.paste()
            box.interpretText()
            assert (box.value(), box.cleanText().rstrip("0")) == (float(shown), shown)
        for text in ("0.5", "0,5"):
            field.selectAll()
            QTest.keyClicks(field, text)
            box.interpretText()
            assert box.value() == 0.5


@pytest.mark.parametrize(
    ("pasted", "sentence"),
    [
        ("1,500", "1,500 may be 1.500 or 1500: write one of these."),
        ("-12,345", "12,345 may be 12.345 or 12345: write one of these."),
        ("1,500 mm³", "1,500 may be 1.500 or 1500: write one of these."),
    ],
)
def test_a_pasted_number_whose_comma_may_stand_for_thousands_is_refused_in_a_sentence(
    panel: Any, pasted: str, sentence: str
) -> None:
    box = panel.segment.options.smallest
    box.setRange(-1e6, 1e6)
    box.setDecimals(3)
    box.setSuffix(" mm³")
    box.setValue(7.0)
    shown, field = box.text(), box.findChild(QLineEdit)
    before = len(notification_manager.records)
    QApplication.clipboard().setText(pasted)
    field.selectAll()
    field.paste()
    assert field.text() == shown
    box.interpretText()
    assert box.value() == 7.0
    (said,) = [notice.message for notice in notification_manager.records[before:]]
    assert said == sentence
    # Nothing is in doubt where more digits stand before the comma, or none of worth.
    for text, value in (("12345,678", 12345.678), ("0,500", 0.5)):
        QApplication.clipboard().setText(text)
        field.selectAll()
        field.paste()
        box.interpretText()
        assert box.value() == value
    assert len(notification_manager.records) == before + 1


@pytest.mark.parametrize("text", ["1.234,5", "1,234.5", "1.234.567"])
def test_a_number_with_two_separators_is_not_cut_short_without_a_word(
    panel: Any, text: str
) -> None:
    box = panel.segment.options.smallest
    box.setDecimals(1)
    # A sentence that is still shown, of the test before, would not be shown again.
    notification_manager.records.clear()
    field = box.findChild(QLineEdit)
    field.selectAll()
    QTest.keyClicks(field, text)
    (said,) = [notice.message for notice in notification_manager.records]
    assert said == "A number has one point or comma, before its decimals, as in 1234.5."


def test_a_voxel_size_typed_in_micrometres_is_that_of_a_layer_in_micrometres(
    viewer: Any, panel: Any
) -> None:
    image = viewer.add_image(np.zeros((8, 9, 10), np.uint16), scale=(2, 1, 1), units=("um",) * 3)
    panel.segment.volume_input.choose(image)
    _type_size(panel, "4 × 1.5 × 1.5")
    np.testing.assert_allclose(image.scale, (4, 1.5, 1.5))
    assert panel.segment.voxels.names.currentText() == MICRO


@pytest.mark.parametrize("found", [False, True])
def test_that_units_clash_is_said_once(
    viewer: Any, panel: Any, piled: Any, qtbot: QtBot, found: bool
) -> None:
    volume, labels = pile_of_balls()

    def said() -> int:
        return sum("Inconsistent units" in r.message for r in notification_manager.records)

    before = said()
    second = viewer.add_image(volume, name="second")
    true = None if found else viewer.add_labels(labels, name="true", visible=False)
    rest(panel, qtbot)
    qtbot.waitUntil(lambda: said() > before, timeout=10000)
    told = said()
    panel.segment.volume_input.choose(second)
    panel.segment.labels_input.choose(true)
    press(qtbot, panel.segment.start)
    qtbot.waitUntil(lambda: panel.workspace.session is not piled, timeout=90000)
    qtbot.waitUntil(lambda: panel.workspace.controller is not None, timeout=90000)
    rest(panel, qtbot)
    panel.workspace.close()
    qtbot.wait(200)
    assert said() == told
