"""What ITK lets pass in NRRD and MetaImage headers: units, a time axis, no voxel size."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from napari_unpack.io.file_data import MILLIMETRES, NO_VOXEL_SIZE, in_millimetres, plain_unit
from napari_unpack.io.itk_header import LONGEST_HEADER

# MetaIO knows more names for it than its documents; without any of them it takes 1.
_META_SIZE = re.compile(rb"Element(Spacing|Size)\s*[=:]", re.I)
# As NRRD writes them.
_NO_NUMBERS = ("nan", "inf", "infinity")
_QUOTED = re.compile(r'"([^"]*)"')
# Kinds of axes that may be of space; two of them say that the kind is not known.
_OF_SPACE = ("space", "domain", "???", "none")


@dataclass(frozen=True)
class HeaderFields:
    """What a header says beyond what ITK tells.

    Parameters
    ----------
    millimetres : float
        Of one unit of its voxel size and place.
    axes : str, optional
        A letter for each axis, the slowest first, where one of them is time; None elsewhere.
    assumed : tuple of str
        A sentence for each thing that the file does not say and that was assumed.
    """

    millimetres: float = 1.0
    axes: str | None = None
    assumed: tuple[str, ...] = ()


def fields_of(path: Path) -> HeaderFields:
    """Return what an NRRD or MetaImage header says of units, time and voxel size.

    Parameters
    ----------
    path : Path

    Raises
    ------
    ValueError
        If axes of space are in several units.
    """
    with path.open("rb") as stream:
        head = stream.read(LONGEST_HEADER)
    if not head.startswith(b"NRRD"):
        end = head.find(b"ElementDataFile")
        told = _META_SIZE.search(head[: end if end >= 0 else len(head)])
        return HeaderFields(assumed=() if told else (NO_VOXEL_SIZE,))
    lines = head.split(b"\n\n", 1)[0].split(b"\r\n\r\n", 1)[0].decode("utf-8", "replace")
    pairs = (line.partition(":") for line in lines.splitlines() if not line.startswith("#"))
    # Of the fields alone: what has := is a note of somebody's.
    fields = {
        "".join(name.lower().split()): value.strip()
        for name, colon, value in pairs
        if colon and not value.startswith("=")
    }
    assumed: list[str] = []
    if not {"spacings", "spacedirections"} & set(fields):
        assumed.append(NO_VOXEL_SIZE)
    kinds = fields.get("kinds", "").lower().split()
    # ITK takes 1 for what is no number.
    sides = _of_space(fields.get("spacings", "").split(), kinds)
    wrong = [side for side in sides if side.lower().lstrip("+-") in _NO_NUMBERS]
    if wrong:
        assumed.append(f"its voxel size holds {', '.join(wrong)}: 1 mm was assumed there")
    units = _QUOTED.findall(fields.get("spaceunits", fields.get("units", "")))
    units = _of_space(units, [] if "spaceunits" in fields else kinds)
    named = {unit for unit in units if unit not in ("", "???", "none")}
    if len({MILLIMETRES.get(plain_unit(unit), unit) for unit in named}) > 1:
        raise ValueError(f"{path} must have one unit of length, got {', '.join(sorted(named))}")
    scale = in_millimetres(min(named, default=None), "mm", assumed)
    return HeaderFields(scale, _axes(kinds), tuple(assumed))


def _of_space(values: list[str], kinds: list[str]) -> list[str]:
    """Return the values of a field for the axes of space: the first three, where none says more."""
    if len(values) != len(kinds):
        return values[:3]
    return [value for value, kind in zip(values, kinds, strict=True) if kind in _OF_SPACE][:3]


def _axes(kinds: list[str]) -> str | None:
    """Return letters for kinds of axes, which count from the fastest."""
    if kinds.count("time") != 1 or len(kinds) > 4:
        return None
    space = iter("xyz")
    return "".join("t" if kind == "time" else next(space) for kind in kinds)[::-1]
