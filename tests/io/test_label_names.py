"""Names and colours that 3D Slicer and ITK-SNAP write."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from napari_unpack.io import load_labels
from napari_unpack.io.label_names import NamedLabel, load_label_names, segment_names
from napari_unpack.io.napari_reader import read_layers

CTBL = """# Color table file /home/someone/Bag.ctbl
# 4 values
0 Background 0 0 0 0
1 Left_shoe 255 128 0 255
2 Bottle 0 0 255 255
40 Zipper 51 51 51
"""
SNAP = """################################################
# ITK-SnAP Label Description File
# IDX   -R-  -G-  -B-  -A--  VIS MSH  LABEL
################################################
    0     0    0    0        0  0  0    "Clear Label"
    1   255  128    0        1  1  1    "Left shoe"
    2     0    0  255      0.5  1  0    "Bottle"
   40    51   51   51        1  1  1    "Zipper"
"""
TABLE = """LabelValue,Name,Color_R,Color_G,Color_B,Color_A
1,Left shoe,255,128,0,255
2,Bottle,0,0,255,255
40,Zipper,51,51,51,255
"""
SEGMENTS = """NRRD0004
type: unsigned char
dimension: 3
space: left-posterior-superior
sizes: 4 3 2
space directions: (1,0,0) (0,1,0) (0,0,2)
kinds: domain domain domain
encoding: raw
space origin: (0,0,0)
Segment0_ID:=Segment_1
Segment0_Name:=Left shoe
Segment0_Color:=1 0.50196078431 0
Segment0_LabelValue:=1
Segment0_Layer:=0
Segment1_Name:=Bottle
Segment1_Color:=0 0 1
Segment1_LabelValue:=2
Segment2_Name:=Zipper
Segment2_Color:=0.2 0.2 0.2
Segment2_LabelValue:=40
Segment3_Name:=Overlapping
Segment3_LabelValue:=2
Segment3_Layer:=1
"""
KNOWN = {
    1: NamedLabel("Left shoe", (1.0, 128 / 255, 0.0)),
    2: NamedLabel("Bottle", (0.0, 0.0, 1.0)),
    40: NamedLabel("Zipper", (0.2, 0.2, 0.2)),
}


def segmentation(path: Path) -> Path:
    """Write a segmentation as 3D Slicer does."""
    voxels = np.zeros((2, 3, 4), np.uint8)
    voxels[0, 0], voxels[1, 1], voxels[1, 2] = 1, 2, 40
    path.write_bytes(SEGMENTS.encode() + b"\n" + voxels.tobytes())
    return path


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("bag.ctbl", CTBL),
        ("bag.txt", CTBL),
        ("windows.ctbl", CTBL.replace("\n", "\r\n")),
        ("bag.label", SNAP),
        ("snap.txt", SNAP),
        ("bag.csv", TABLE),
        ("excel.csv", TABLE.replace(",", ";")),
        ("told.csv", "sep=;\r\n" + TABLE.replace(",", ";")),
        ("odd.csv", TABLE + "²,Two,1,2,3,255\n"),
    ],
)
def test_text_files_name_and_colour_labels(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_bytes(text.encode())
    assert load_label_names(tmp_path / name) == KNOWN


def test_the_header_of_a_segmentation_names_and_colours_labels(tmp_path: Path) -> None:
    found = load_label_names(segmentation(tmp_path / "bag.seg.nrrd"))
    assert {i: about.name for i, about in found.items()} == {
        i: about.name for i, about in KNOWN.items()
    }
    for i, about in KNOWN.items():
        assert found[i].color == pytest.approx(about.color, abs=1e-9)


def test_a_segmentation_opens_as_labels_with_names(tmp_path: Path) -> None:
    ((data, about, kind),) = read_layers(str(segmentation(tmp_path / "bag.seg.nrrd")))
    assert kind == "labels"
    assert data[1, 2].tolist() == [40] * 4
    assert about["features"] == {"index": [1, 2, 40], "name": ["Left shoe", "Bottle", "Zipper"]}


def test_a_segmentation_that_names_nothing_is_labels_all_the_same(tmp_path: Path) -> None:
    path = segmentation(tmp_path / "bag.seg.nrrd")
    path.write_bytes(re.sub(rb"Segment\d.*\n", b"", path.read_bytes()))
    ((_, about, kind),) = read_layers(str(path))
    assert (kind, "features" in about) == ("labels", False)
    assert segment_names(path) == {}


def test_segments_that_overlap_are_told(tmp_path: Path) -> None:
    pytest.importorskip("SimpleITK")
    path = tmp_path / "bag.seg.nrrd"
    header = (
        SEGMENTS.replace("dimension: 3", "dimension: 4")
        .replace("sizes: 4", "sizes: 2 4")
        .replace("directions: (1", "directions: none (1")
        .replace("kinds: ", "kinds: list ")
    )
    path.write_bytes(header.encode() + b"\n" + bytes(2 * 24))
    with pytest.raises(ValueError, match=r"overlap, in 2 layers: collapse them in 3D Slicer"):
        load_labels(path)


def test_a_file_that_names_nothing_says_what_is_wanted(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("milk, bread")
    with pytest.raises(ValueError, match=r"notes.txt describes no labels: wanted a colour table"):
        load_label_names(tmp_path / "notes.txt")
    (tmp_path / "bad.seg.nrrd").write_bytes(b"\x00\x01")
    with pytest.raises(ValueError, match=r"bad.seg.nrrd must begin with NRRD"):
        load_label_names(tmp_path / "bad.seg.nrrd")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252"])
def test_letters_of_names_are_those_that_were_written(tmp_path: Path, encoding: str) -> None:
    for name, text in (
        ("bag.ctbl", CTBL.replace("Bottle", "Große_Flasche")),
        ("bag.label", SNAP.replace("Bottle", "Große Flasche")),
        ("bag.csv", TABLE.replace("Bottle", "Große Flasche")),
    ):
        (tmp_path / name).write_bytes(text.encode(encoding))
        assert load_label_names(tmp_path / name)[2].name == "Große Flasche"
    file = segmentation(tmp_path / "bag.seg.nrrd")
    file.write_bytes(file.read_bytes().replace(b"Bottle", "Große Flasche".encode(encoding)))
    assert load_label_names(file)[2].name.endswith("Große Flasche")


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be"])
def test_files_of_windows_programs_that_write_two_bytes_a_letter_are_read(
    tmp_path: Path, encoding: str
) -> None:
    for name, text in (("bag.ctbl", CTBL), ("bag.label", SNAP), ("bag.csv", TABLE)):
        written = "\ufeff" + text.replace("Bottle", "Große")
        (tmp_path / name).write_bytes(written.encode(encoding))
        assert load_label_names(tmp_path / name)[2] == NamedLabel("Große", KNOWN[2].color)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_a_line_in_another_encoding_spoils_no_other(tmp_path: Path, end: str) -> None:
    lines = [f'{i} 255 0 0 1 1 1 "Größe {i}"'.encode() for i in range(1, 5)]
    # A letter of an older program, and another cut in its middle.
    lines[1] = lines[1].decode().encode("cp1252")
    written = end.encode().join(lines)
    (tmp_path / "bag.label").write_bytes(written + end.encode() + b'5 255 0 0 1 1 1 "Gr\xc3')
    found = load_label_names(tmp_path / "bag.label")
    assert {i: about.name for i, about in found.items()} == {i: f"Größe {i}" for i in range(1, 5)}


def test_line_breaks_that_belong_to_a_name_end_no_line(tmp_path: Path) -> None:
    for end in ("\n", "\r\n"):
        table = TABLE.replace("\n", end).replace("Bottle", f'"Bottle,{end}blue"')
        (tmp_path / "bag.csv").write_bytes(table.encode())
        found = load_label_names(tmp_path / "bag.csv")
        assert found[2] == NamedLabel(f"Bottle,{end}blue", (0.0, 0.0, 1.0))
        assert found[40] == KNOWN[40]
    (tmp_path / "bag.label").write_text(SNAP.replace("Bottle", "Bottle\u2028blue"), "utf-8")
    assert load_label_names(tmp_path / "bag.label")[2].name == "Bottle\u2028blue"
