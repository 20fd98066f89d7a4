"""The web page of objects: whole, safe, and true to the table."""

from __future__ import annotations

import base64
import io
from html.parser import HTMLParser
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pandas as pd
import pytest

import napari_unpack as nu
from napari_unpack.geometry.length_unit import MICRO, LengthUnit
from napari_unpack.io import (
    interactive_page,
    report,
    save_interactive_page,
    save_measurements_csv,
    save_objects_page,
)
from napari_unpack.io.report import save_objects_csv
from napari_unpack.io.table_page import number_cell
from napari_unpack.session.measurements import SurfacePoint
from napari_unpack.tasks import Cancelled


class Cells(HTMLParser):
    """Collect tags, table cells and sources."""

    def __init__(self) -> None:
        super().__init__()
        self.sources: list[str] = []
        self.rows: list[list[str]] = []
        self.values: list[list[str | None]] = []
        self.tags: set[str] = set()
        self._inside = False

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        self.tags.add(tag)
        self.sources += [v for k, v in attrs if k in ("src", "href")]
        if tag == "tr":
            self.rows.append([])
            self.values.append([])
        if tag in ("td", "th"):
            self._inside = True
            self.rows[-1].append("")
            self.values[-1].append(found.get("data-value"))

    def handle_endtag(self, tag):
        if tag in ("td", "th"):
            self._inside = False

    def handle_data(self, data):
        if self._inside:
            self.rows[-1][-1] += data


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> tuple[str, Cells, nu.Session]:
    labels = np.zeros((20, 22, 40), np.uint16)
    for i in (1, 2, 3):
        labels[4:16, 4:18, 12 * i - 8 : 12 * i + 2] = i
    session = nu.Session(np.where(labels > 0, 1500, 0).astype(np.uint16), labels, (1, 1, 2))
    session.direction = "-x"
    session.unpack(1)
    session.rename(2, "<b>a & b</b>")
    session.hide([3])
    session.annotations.set_flag(2, "suspicious")
    session.annotations.set_note(2, "<i>ask</i>")
    corner = SurfacePoint(2, (4.0, 4.0, 32.0))
    session.measurements.add([corner, SurfacePoint(1, (4.0, 4.0, 42.0))])
    session.measurements.add(
        [SurfacePoint(0, (7.0, 4.0, 32.0)), corner, SurfacePoint(2, (4, 8, 32))]
    )
    before = dict(session.states)
    path = save_objects_page(session, tmp_path_factory.mktemp("p") / "bag.html", "A <bag>")
    assert session.states == before
    text = Path(path).read_text(encoding="utf-8")
    cells = Cells()
    cells.feed(text)
    return text, cells, session


@pytest.fixture
def small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw small pictures, where what they show is no matter."""
    monkeypatch.setattr(report, "BAG", (60, 96))
    monkeypatch.setattr(report, "SIDE", 24)
    monkeypatch.setattr(interactive_page, "WINDOW", (144, 192))


def test_it_needs_nothing_from_elsewhere(page):
    text, cells, _ = page
    assert "http" not in text
    assert "@import" not in text
    assert cells.sources
    assert all(source.startswith("data:image/png;base64,") for source in cells.sources)
    assert "<h1>A &lt;bag&gt;</h1>" in text
    assert "prefers-color-scheme: dark" in text


def test_it_says_what_the_table_says(page):
    _, cells, _ = page
    assert cells.rows[4:] == [
        ["Measured", "On"],
        ["10.0 mm", "Object 1, <b>a & b</b>"],
        ["90.0° (3.00 mm, 4.00 mm)", "<b>a & b</b>"],
    ]
    first, second, third = cells.rows[1:4]
    assert first[1:5] == ["1", "Object 1", "unpacked", "1"]
    assert second[1:5] == ["2", "<b>a & b</b>", "in the bag", ""]
    assert third[3] == "hidden"
    # 12 x 14 x 10 voxels of 2 mm3.
    assert cells.values[1][5] == "3360"
    assert first[5:8] == ["3.4", "20 × 14 × 12", "1500"]
    assert first[8:] == ["–", "", ""]
    assert second[9:] == ["suspicious", "<i>ask</i>"]
    assert cells.rows[0][9:] == ["Flag", "Note"]
    assert "b" not in cells.tags


def test_measurements_have_a_table_of_their_own(page, tmp_path):
    session = page[2]
    path = save_measurements_csv(session, tmp_path / "measured.csv")
    table = pd.read_csv(path, index_col="measurement")
    assert table.kind.to_list() == ["length", "angle"]
    assert table.length_mm.to_list() == [10, 3]
    assert table.loc[2, ["second_length_mm", "angle_degrees"]].to_list() == [4, 90]
    assert table.loc[1, ["z1_mm", "y1_mm", "x1_mm"]].to_list() == [4, 4, 32]
    assert table.objects.to_list() == ["Object 1, <b>a & b</b>", "<b>a & b</b>"]
    session.length_unit = "µm"
    table = pd.read_csv(save_measurements_csv(session, path))
    assert table.length_um.to_list() == [10, 3]
    session.length_unit = "mm"


def test_every_picture_shows_its_object(page):
    _, cells, _ = page
    pictures = [
        iio.imread(io.BytesIO(base64.b64decode(source.partition(",")[2])))
        for source in cells.sources
    ]
    assert len(pictures) == 4
    for picture in pictures[1:]:
        assert max(picture.shape) <= 260
        assert (picture[..., 3] > 200).mean() > 0.3


def test_another_suffix_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"must end in .html or .htm, got 'a.txt'"):
        save_objects_page(None, tmp_path / "a.txt")


@pytest.mark.usefixtures("small_pictures")
def test_a_page_is_cancelled_before_any_of_its_objects_and_leaves_no_file(page, tmp_path):
    told: list[str] = []

    def save(until: str) -> None:
        def stop(_fraction: float, text: str) -> None:
            told.append(text)
            if text == until:
                raise Cancelled

        save_objects_page(page[2], tmp_path / "bag.html", progress=stop)

    save("never")
    (tmp_path / "bag.html").unlink()
    *before, last = dict.fromkeys(told)
    assert len([text for text in before if text.startswith("Drawing objects")]) == 3
    # Once it is written nobody can call it off.
    assert last == "Written"
    for text in before:
        with pytest.raises(Cancelled):
            save(text)
        assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("small_pictures")
def test_nobody_is_sure_to_a_hundred_percent_as_in_the_panel(tmp_path):
    labels = np.zeros((12, 12, 24), np.uint16)
    labels[2:10, 2:10, 2:10], labels[2:10, 2:10, 14:22] = 1, 2
    session = nu.Session(np.where(labels > 0, 1500, 0).astype(np.uint16), labels)
    session.use_oracle(None, {1: 0.9999, 2: 0.25})
    cells = Cells()
    path = save_objects_page(session, tmp_path / "bag.html", "A bag")
    cells.feed(Path(path).read_text(encoding="utf-8"))
    assert [row[8] for row in cells.rows] == ["Confidence", "99 %", "25 %"]


def test_long_names_and_notes_wrap_and_the_bag_fills_its_picture(tmp_path: Path) -> None:
    """Else they push the other columns out of the window; empty notes take no room."""
    labels = np.zeros((24, 24, 24), np.uint16)
    labels[4:20, 4:20, 4:11], labels[4:20, 4:20, 13:20] = 1, 2
    session = nu.Session(np.where(labels > 0, 1000, 0).astype(np.uint16), labels)
    session.annotations.set_note(2, "a long note")
    page = save_objects_page(session, tmp_path / "a.html", backend="cpu").read_text("utf-8")
    assert page.count('<td class="name">') == 2
    assert page.count('<td class="long">') == 1
    # Nothing is out, so that no room is left for sprites.
    _, encoded = page.split('<figure><img src="data:image/png;base64,')
    picture = iio.imread(base64.b64decode(encoded.split('"')[0]))[..., :3].astype(int)
    rows = (np.abs(picture - picture[2, 2]).max(axis=-1) > 25).any(axis=1).nonzero()[0]
    assert np.ptp(rows) >= 0.7 * len(picture)


@pytest.mark.parametrize("column", ["name", "note"])
def test_a_carriage_return_in_a_table_ends_no_row(tmp_path: Path, column: str) -> None:
    # Names of a session are one line, those of a table that a script hands over need not be.
    table = pd.DataFrame({column: ["left\rright", "up\r\ndown"]}, index=[1, 2])
    path = save_objects_csv(table, tmp_path / "objects.csv")
    read = pd.read_csv(path, index_col="id")
    assert list(read.index) == [1, 2]
    assert list(read[column]) == ["left\nright", "up\ndown"]


@pytest.mark.parametrize(
    ("unit", "suffix"),
    [(LengthUnit(MICRO, 1000.0), "um"), (LengthUnit("voxels", 0.5), "voxels")],
)
def test_columns_are_named_by_their_unit_and_those_in_mm_as_ever(
    tmp_path: Path, unit: LengthUnit, suffix: str
) -> None:
    told = {
        "voxels": [7], "volume_mm3": [2.0], "mean_density": [3.0], "z": [4.0], "y": [5.0],
        "x": [6.0], "isoperimetric_ratio": [8.0],
    }  # fmt: skip
    objects = pd.DataFrame(told, index=[1])
    plain = pd.read_csv(save_objects_csv(objects, tmp_path / "mm.csv"), index_col="id")
    assert list(plain) == list(told)
    table = pd.read_csv(save_objects_csv(objects, tmp_path / "other.csv", unit), index_col="id")
    assert list(table) == [
        "voxels", f"volume_{suffix}3" if suffix == "um" else "volume_voxels", "mean_density",
        f"z_{suffix}", f"y_{suffix}", f"x_{suffix}", f"isoperimetric_ratio_per_{suffix}",
    ]  # fmt: skip
    assert table[f"y_{suffix}"][1] == 5.0 * unit.per_mm
    assert table[f"isoperimetric_ratio_per_{suffix}"][1] == 8.0 / unit.per_mm


@pytest.mark.usefixtures("small_pictures")
def test_densities_of_a_scan_scaled_to_one_are_told_with_two_digits(tmp_path: Path) -> None:
    labels = np.zeros((12, 12, 24), np.uint16)
    labels[2:10, 2:10, 2:10], labels[2:10, 2:10, 14:22] = 1, 2
    volume = np.select([labels == 1, labels == 2], [0.508, 0.031], 0.0).astype(np.float32)
    path = save_objects_page(nu.Session(volume, labels), tmp_path / "bag.html", backend="cpu")
    cells = Cells()
    cells.feed(path.read_text("utf-8"))
    assert [row[7] for row in cells.rows] == ["Mean density", "0.51", "0.031"]


@pytest.mark.usefixtures("small_pictures")
def test_what_a_table_does_not_say_is_empty_on_both_pages(tmp_path: Path) -> None:
    labels = np.zeros((12, 12, 24), np.uint16)
    labels[2:10, 2:10, 2:10], labels[2:10, 2:10, 14:22] = 1, 2
    given = pd.DataFrame({"note": ["hello", np.nan], "flag": [None, "odd"]}, index=[1, 2])
    session = nu.Session(np.where(labels > 0, 1500, 0).astype(np.uint16), labels, (1, 1, 1), given)
    for save in (save_objects_page, save_interactive_page):
        cells = Cells()
        cells.feed(save(session, tmp_path / "bag.html", backend="cpu").read_text("utf-8"))
        at = slice(cells.rows[0].index("Flag"), cells.rows[0].index("Note") + 1)
        assert [row[at] for row in cells.rows] == [["Flag", "Note"], ["", "hello"], ["odd", ""]]


def test_a_persons_own_numbers_keep_their_digits(tmp_path: Path) -> None:
    own = {"case": [20240117.0, np.nan], "dose": [0.123456789, 1.0]}
    own["half"] = np.array([np.nan, 0.1], np.float32)
    own["third"] = [1 / 3, 0.1]
    told = pd.DataFrame({**own, "volume_mm3": [1 / 3, 2e7 / 3]}, index=[1, 2])
    text = save_objects_csv(told, tmp_path / "objects.csv").read_text("utf-8")
    assert text.splitlines() == [
        "id,case,dose,half,third,volume_mm3",
        "1,20240117,0.123456789,,0.3333333333333333,0.333333",
        "2,,1,0.1,0.1,6666670",
    ]


def test_ids_above_65535_are_those_of_the_labels_in_the_table_too(tmp_path: Path) -> None:
    labels = np.zeros((12, 12, 24), np.int32)
    labels[2:10, 2:10, 2:10], labels[2:10, 2:10, 14:22] = 3, 70000
    own = pd.DataFrame({"dose": [0.5, 2.0]}, index=[3, 70000])
    session = nu.Session(np.where(labels > 0, 1500, 0), labels, (1, 1, 1), own)
    table = pd.read_csv(save_objects_csv(session, tmp_path / "a.csv"), index_col="id")
    assert table["name"].to_dict() == {3: "Object 3", 70000: "Object 70000"}
    # The column of these IDs that the session has beside its own would say them twice.
    assert "label" not in table
    again = nu.Session(np.where(labels > 0, 1500, 0), labels, (1, 1, 1), table)
    assert again.objects["dose"].to_list() == [0.5, 2.0]
    # A person's own column stays, and has another name than that of the IDs.
    own = pd.DataFrame({"id": [17, 18], "label": ["b1", "b2"], "own_id": 4}, index=[3, 70000])
    session = nu.Session(np.where(labels > 0, 1500, 0), labels, (1, 1, 1), own)
    table = pd.read_csv(save_objects_csv(session, tmp_path / "a.csv"), index_col="id")
    assert table["own_own_id"].to_dict() == {3: 17, 70000: 18}
    assert table["own_id"].to_dict() == {3: 4, 70000: 4}
    assert table["label"].to_dict() == {3: "b1", 70000: "b2"}


def test_places_in_voxels_are_where_arrays_have_them(tmp_path: Path) -> None:
    labels = np.zeros((12, 20, 24), np.uint16)
    labels[2:9, 4:15, 6:17] = 1
    session = nu.Session(np.where(labels > 0, 1500, 0), labels, (2.5, 0.7, 0.6))
    session.length_unit = "voxels"
    table = pd.read_csv(save_objects_csv(session, tmp_path / "a.csv"), index_col="id")
    assert table.loc[1, ["z_voxels", "y_voxels", "x_voxels"]].to_list() == [5, 9, 11]
    assert table["volume_voxels"][1] == 7 * 11 * 11
    session.measurements.add([SurfacePoint(1, (5.0, 2.8, 3.6)), SurfacePoint(1, (20.0, 2.8, 3.6))])
    table = pd.read_csv(save_measurements_csv(session, tmp_path / "b.csv"))
    assert table[["z1_voxels", "y1_voxels", "x1_voxels"]].to_numpy().tolist() == [[2, 4, 6]]
    # Along no axis: in edges of a cube as large as a voxel.
    assert table["length_voxels"][0] == pytest.approx(15 / 1.05 ** (1 / 3), rel=1e-5)


def test_long_ids_are_sorted_by_all_their_digits() -> None:
    assert 'data-value="10000000001"' in number_cell(10_000_000_001, "10000000001")
    assert 'data-value="0.333333333"' in number_cell(1 / 3, "0.3")
