"""What ITK lets pass in NIfTI files: early ends, voxel sizes that are none, NaN and infinity."""

from __future__ import annotations

import gzip
import math
import struct
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.io.file_data import NO_UNIT

# The length of NIfTI-1's header, as its first four bytes say it in either order.
_HEADER = 348

# The length of NIfTI-2's.
_HEADER_2 = 540

# Where it says what its sizes are in; 1, 2 and 3 are metres, mm and micrometres.
_UNITS = 123
_LAST_UNIT = 3

# How it calls floats of 32 and 64 bits.
_FLOATS = {16: "f4", 64: "f8"}

_CHUNK = 1 << 22


def refuse_nifti_2(path: Path) -> None:
    """Refuse a file of the format's second version, of which ITK says only that it is none.

    Raises
    ------
    ValueError
        If it is one, or cannot be read.
    """
    begins = _head(path)[:4]
    if begins in (_HEADER_2.to_bytes(4, "little"), _HEADER_2.to_bytes(4, "big")):
        raise ValueError(
            f"{path} is NIfTI-2, which is not read: save it as NIfTI-1 (.nii, .nii.gz) or NRRD"
        )


def _packed(path: Path) -> bool:
    return path.name.lower().endswith(".gz")


def _head(path: Path) -> bytes:
    try:
        with gzip.open(path) if _packed(path) else path.open("rb") as stream:
            return stream.read(_HEADER)
    except (OSError, EOFError, zlib.error) as error:
        raise ValueError(f"{path} is not a readable NIfTI file: {error}") from error


def _order(head: bytes) -> str | None:
    """Return the order of bytes as `struct` has it; None where it is no whole header."""
    orders = {_HEADER.to_bytes(4, "little"): "<", _HEADER.to_bytes(4, "big"): ">"}
    return orders.get(head[:4]) if len(head) == _HEADER else None


def planes_not_finite(
    path: Path, size: Sequence[int]
) -> Iterator[tuple[int, NDArray[np.floating[Any]]]]:
    """Yield every plane with NaN or infinity in it, which ITK turns into 0: its number and voxels.

    Parameters
    ----------
    path : Path
        As `check_nifti` passed it.
    size : sequence of int
        Voxels along each axis, the fastest first.

    Yields
    ------
    k : int
        How many planes come before it.
    plane : (Y, X) ndarray of float
        As stored, and turned over where the file's slope is negative.
    """
    head = _head(path)
    order = _order(head)
    stored = _FLOATS.get(struct.unpack_from(f"{order}h", head, 70)[0]) if order else None
    if stored is None:
        return
    offset, slope = struct.unpack_from(f"{order}2f", head, 108)
    dtype, (columns, rows) = np.dtype(f"{order}{stored}"), size[:2]
    with gzip.open(path) if _packed(path) else path.open("rb") as stream:
        stream.seek(max(int(offset), _HEADER))
        for k in range(math.prod(size[2:])):
            data = stream.read(columns * rows * dtype.itemsize)
            plane = np.frombuffer(data, dtype).reshape(rows, columns)
            if not np.isfinite(plane).all():
                yield k, -plane if slope < 0 else plane


def check_nifti(path: Path) -> tuple[str, ...]:
    """Check that a NIfTI file is as long as its header says; return what is assumed of it.

    ITK fills what is missing with zeros, and takes 1 mm for a voxel size that is none, and mm for
    a unit that is none.

    Raises
    ------
    ValueError
        If it is shorter, or does not say where its voxels begin.
    """
    packed, head = _packed(path), _head(path)
    order = _order(head)
    # ITK says what else it is.
    if order is None:
        return ()
    dims = struct.unpack_from(f"{order}8h", head, 40)
    bits = struct.unpack_from(f"{order}h", head, 72)[0]
    steps = struct.unpack_from(f"{order}8f", head, 76)
    offset = struct.unpack_from(f"{order}f", head, 108)[0]
    if not math.isfinite(offset):
        raise ValueError(f"{path} says that its voxels begin at byte {offset:g}: is it damaged?")
    axes = dims[0] if 0 < dims[0] < 8 else 0
    expected = int(offset) + math.prod(max(n, 1) for n in dims[1 : axes + 1]) * bits // 8
    found = _unpacked_size(path, expected) if packed else path.stat().st_size
    if found < expected:
        raise ValueError(
            f"{path} is not whole: its header asks for {expected:,} bytes, but it holds {found:,}"
        )
    wrong = [f"{step:g}" for step in steps[1 : min(axes, 3) + 1] if not 0 < abs(step) < math.inf]
    assumed = []
    if wrong:
        assumed.append(f"its voxel size holds {', '.join(wrong)}: 1 mm was assumed there")
    # ITK turns metres and micrometres into mm, and takes all else for mm.
    code = head[_UNITS] & 7
    if not code:
        assumed.append(NO_UNIT)
    elif code > _LAST_UNIT:
        assumed.append(f"its unit of length ({code}) is not known: mm was assumed")
    return tuple(assumed)


def _unpacked_size(path: Path, enough: int) -> int:
    """Return the bytes in a gzip file as far as they can be read, and are needed."""
    # Read through and not by the length at its end: where the end is missing, so is that.
    size = 0
    try:
        with gzip.open(path) as stream:
            while size < enough and (chunk := stream.read(_CHUNK)):
                size += len(chunk)
    except (OSError, EOFError, zlib.error):
        # What was unpacked before still counts: bytes after the data are no matter.
        pass
    return size
