"""Names and colours of labels as other programs write them: 3D Slicer and ITK-SNAP."""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from napari_unpack.atomic import given_path
from napari_unpack.file_sizes import check_plain_file
from napari_unpack.read_errors import read_errors_told

# ITK-SNAP: index, red, green, blue, opacity, shown, in the mesh, and the name in quotes.
SNAP_LINE = re.compile(r"\s*(\d+)" + r"\s+(\d+)" * 3 + r'\s+([\d.eE+-]+)\s+\d+\s+\d+\s+"(.*)"\s*$')
# 3D Slicer: index, name without spaces, red, green, blue, opacity.
SLICER_LINE = re.compile(r"\s*(\d+)\s+(\S+)" + r"\s+(\d+)" * 3 + r"(?:\s+(\d+))?\s*$")
SEGMENT_KEY = re.compile(r"Segment(\d+)_(Name|Color|LabelValue|Layer)\s*:=(.*)")

# Bytes of a header: thousands of segments need less, and voxels are never read as text.
LONGEST_HEADER = 4_000_000

SUFFIXES = (".ctbl", ".seg.nrrd", ".label", ".txt", ".csv")

Color = tuple[float, float, float]


@dataclass(frozen=True)
class NamedLabel:
    """What another program says of a label.

    Parameters
    ----------
    name : str
        Empty where it says none.
    color : (float, float, float) or None
        sRGB from 0 to 1.
    """

    name: str
    color: Color | None = None


def is_segmentation(path: Path) -> bool:
    """Return whether a file is a segmentation of 3D Slicer, by its name."""
    return path.name.lower().endswith(".seg.nrrd")


def load_label_names(path: str | Path) -> dict[int, NamedLabel]:
    """Read names and colours by label.

    Parameters
    ----------
    path : str or Path
        A colour table of 3D Slicer (.ctbl, .txt, .csv), the header of its segmentation
        (.seg.nrrd), or label descriptions of ITK-SNAP (.label, .txt). Labels of the background,
        0, are left out.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If no label is described in it.
    """
    file = given_path(path)
    with read_errors_told(file, "a list of labels"):
        check_plain_file(file)
        if is_segmentation(file):
            found = _segments(_header(file))
        else:
            with file.open("rb") as stream:
                # What is longer lists no labels; a volume chosen by mistake is not read as text.
                text = _text(stream.read(LONGEST_HEADER))
            found = dict(_table(text) if file.suffix.lower() == ".csv" else _lines(text))
        found.pop(0, None)
        if not found:
            raise ValueError(
                f"{file} describes no labels: wanted a colour table (.ctbl, .csv) or a "
                "segmentation (.seg.nrrd) of 3D Slicer, or label descriptions of ITK-SNAP (.txt)"
            )
    return found


def segment_names(path: Path) -> dict[int, str]:
    """Read what a segmentation of 3D Slicer calls its labels; nothing where it names none.

    Parameters
    ----------
    path : Path
        .seg.nrrd.

    Raises
    ------
    ValueError
        If it is no NRRD file.
    """
    with read_errors_told(path, "a segmentation (.seg.nrrd)"):
        found = _segments(_header(path))
    return {label: about.name for label, about in found.items() if label and about.name}


def _text(data: bytes) -> str:
    # Notepad and spreadsheets on Windows call it Unicode.
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", errors="replace")
    # Line by line: one that another program wrote, or that is cut, spoils no others.
    return "".join(map(_line_text, data.removeprefix(codecs.BOM_UTF8).splitlines(keepends=True)))


def _line_text(line: bytes) -> str:
    try:
        return line.decode()
    except UnicodeDecodeError:
        # Of an older program on Windows. Five bytes mean nothing there.
        return line.decode("cp1252", errors="replace")


def _lines(text: str) -> Iterator[tuple[int, NamedLabel]]:
    # Not splitlines, which ends a line at signs that may stand in a name.
    for line in io.StringIO(text, newline=None):
        if line.lstrip().startswith("#"):
            continue
        if snap := SNAP_LINE.match(line):
            index, *rgb, _, name = snap.groups()
            yield int(index), NamedLabel(name.strip(), _bytes(rgb))
        elif slicer := SLICER_LINE.match(line):
            index, name, *rgb, _ = slicer.groups()
            # Slicer writes underscores for spaces, and reads them as such.
            yield int(index), NamedLabel(name.replace("_", " ").strip(), _bytes(rgb))


def _table(text: str) -> Iterator[tuple[int, NamedLabel]]:
    # Spreadsheets write semicolons where numbers have a comma for a point; for Excel some programs
    # say so in a line before.
    text = re.sub(r'\A"?sep=.?"?\s*\n', "", text)
    head = text.partition("\n")[0]
    between = ";" if head.count(";") > head.count(",") else ","
    for line in csv.DictReader(io.StringIO(text, newline=""), delimiter=between):
        row = {str(key).strip().lower(): str(value or "").strip() for key, value in line.items()}
        # Not isdigit, which takes ² as well.
        if row.get("labelvalue", "").isdecimal():
            rgb = [row.get(f"color_{channel}", "") for channel in "rgb"]
            color = _bytes(rgb) if all(value.isdecimal() for value in rgb) else None
            yield int(row["labelvalue"]), NamedLabel(row.get("name", ""), color)


def _header(file: Path) -> str:
    """Return what a NRRD file says before its voxels."""
    with file.open("rb") as stream:
        head = stream.read(LONGEST_HEADER)
    if not head.startswith(b"NRRD"):
        raise ValueError(f"{file} must begin with NRRD, got {head[:8]!r}: is it a segmentation?")
    return _text(re.split(rb"\r?\n\r?\n", head, maxsplit=1)[0])


def _segments(header: str) -> dict[int, NamedLabel]:
    told: dict[str, dict[str, str]] = {}
    for segment, key, value in SEGMENT_KEY.findall(header):
        told.setdefault(segment, {})[key] = value.strip()
    found = {}
    for segment, about in told.items():
        # Segments of other layers overlap, and may have the same label values.
        if about.get("Layer", "0") == "0":
            # Versions before 4.11 number segments from 1, and write no label values.
            label = int(about.get("LabelValue", int(segment) + 1))
            found[label] = NamedLabel(about.get("Name", ""), _shares(about.get("Color", "")))
    return found


def _bytes(values: list[str]) -> Color:
    red, green, blue = (min(int(value), 255) / 255 for value in values)
    return red, green, blue


def _shares(text: str) -> Color | None:
    values = [min(max(float(part), 0.0), 1.0) for part in text.split()]
    return (values[0], values[1], values[2]) if len(values) == 3 else None
