"""Where MetaImage and NRRD headers say that their voxels are: in the same folder, or refused."""

from __future__ import annotations

import os
import re
from pathlib import Path, PurePosixPath, PureWindowsPath

from napari_unpack.file_sizes import check_plain_file

LONGEST_HEADER = 1 << 22
"""Bytes: thousands of lines of notes need less."""

# Anywhere in a line: MetaIO goes on reading where the value before it ends.
_META = re.compile(rb"ElementDataFile\s*[=:][ \t]*([^\r\n]*)", re.I)
_META_PACKED = re.compile(
    rb"CompressedData\s*[=:]\s*[1ty]|BinaryData(?:ByteOrder)?\s*[=:]\s*[0fn]", re.I
)
_NRRD = re.compile(rb"\s*data\s*file\s*:(?!=)\s*(.*)", re.I)
_NRRD_RAW = re.compile(rb"\s*encoding\s*:\s*raw\s*", re.I)


def check_beside(name: str, header: Path) -> None:
    """Refuse a file that a header names outside its own folder, without asking for it.

    Parameters
    ----------
    name : str
        As the header has it.
    header : Path

    Raises
    ------
    ValueError
        If it leads elsewhere on any system: to the root, upwards, to a drive or into a network.
    """
    windows, posix = PureWindowsPath(name), PurePosixPath(name)
    # A server's name or a drive's letter leads away even without a root.
    if windows.anchor or posix.is_absolute() or ".." in (*windows.parts, *posix.parts):
        raise ValueError(
            f"{header} says that its voxels are in {name!r}, outside its folder: put them beside "
            "it, and only the file's name into the header"
        )


def stored_as(path: Path) -> tuple[str, int, bool]:
    """Return how ITK calls a file's format, the bytes that hold its voxels, whether compressed.

    Parameters
    ----------
    path : Path
        .nii, .nii.gz, .mha, .mhd, .nrrd or .nhdr; what stands in it counts, and not its name.

    Raises
    ------
    FileNotFoundError
        If the file with the voxels is not there.
    ValueError
        If it is outside the header's folder, or the header does not end.
    """
    with path.open("rb") as stream:
        head = stream.read(LONGEST_HEADER)
    ended, own = len(head) < LONGEST_HEADER, path.stat().st_size
    if head.startswith(b"NRRD"):
        lines = head.splitlines()
        ended = ended or b"" in lines
        lines = lines[: lines.index(b"")] if b"" in lines else lines
        named = [k for k, line in enumerate(lines) if _NRRD.fullmatch(line)]
        packed = not any(_NRRD_RAW.fullmatch(line) for line in lines)
        values = [_NRRD.fullmatch(lines[k])[1] for k in named]  # type: ignore[index]
        listed = lines[named[0] + 1 :] if named else []
        kind = "NrrdImageIO"
    elif path.name.lower().endswith((".nii", ".nii.gz")):
        return "NiftiImageIO", own, path.name.lower().endswith(".gz")
    else:
        found = list(_META.finditer(head))
        ended = ended or bool(found)
        if not found and ended:
            raise ValueError(f"{path} is neither NRRD nor MetaImage: it names no voxels")
        packed = _META_PACKED.search(head[: found[0].start()] if found else head) is not None
        values = [match[1] for match in found if match[1].strip().upper() != b"LOCAL"]
        listed = head[found[0].end() :].splitlines() if found else []
        kind = "MetaImageIO"
    if not ended:
        raise ValueError(f"{path} has a header that does not end within {LONGEST_HEADER:,} bytes")
    if not values:
        return kind, own, packed
    whole = values[0].upper().startswith(b"LIST")
    names = [os.fsdecode(name).strip() for name in (listed if whole else values)]
    for name in filter(None, names):
        check_beside(name, path)
    if len(names) == 1 and "%" not in names[0]:
        file = path.parent / names[0]
        if not file.exists():
            raise FileNotFoundError(
                f"{path} says that its voxels are in {file}, which is not there"
            )
        check_plain_file(file)
        return kind, file.stat().st_size, packed
    # Slices in files of their own, here or in folders below: what is there is the most they hold.
    return kind, sum(f.stat().st_size for f in path.parent.iterdir() if f.is_file()), True
