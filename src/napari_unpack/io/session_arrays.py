"""Arrays in session files: compressed slab by slab, and not believed before they are checked."""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

SLAB = 1 << 24
"""Bytes written or read at once."""

QUICK = 1
"""zlib's level: CT shrinks little more at higher ones, and takes several times as long."""

Told = Callable[[float], None]


@dataclass(frozen=True)
class ArrayFacts:
    """What an array must be.

    Parameters
    ----------
    shape : tuple of int
    dtype : str
        As numpy writes it, byte order included.
    sha256 : str
        Of its bytes in C order.
    """

    shape: tuple[int, ...]
    dtype: str
    sha256: str

    @classmethod
    def of(cls, array: NDArray[Any]) -> ArrayFacts:
        """Measure an array."""
        digest = hashlib.sha256()
        for slab in _slabs(array):
            digest.update(slab)
        return cls(array.shape, array.dtype.str, digest.hexdigest())

    def check(self, array: NDArray[Any], name: str) -> None:
        """Raise `ValueError` unless an array is this one."""
        if array.shape != self.shape or array.dtype.str != self.dtype:
            raise ValueError(
                f"{name} must be {self.shape} of {self.dtype}, as it was when the session was "
                f"saved; got {array.shape} of {array.dtype.str}"
            )
        if ArrayFacts.of(array).sha256 != self.sha256:
            raise ValueError(f"{name} is not what it was when the session was saved")


def write_array(stream: IO[bytes], array: NDArray[Any], told: Told) -> ArrayFacts:
    """Write an array as an .npz archive with the one member `array`.

    Parameters
    ----------
    stream : file
        Open for writing.
    array : ndarray
    told : callable
        Given the fraction written; raising in it cancels.
    """
    digest, done = hashlib.sha256(), 0
    method = zipfile.ZIP_DEFLATED
    with (
        zipfile.ZipFile(stream, "w", method, compresslevel=QUICK) as archive,
        archive.open("array.npy", "w", force_zip64=True) as member,
    ):
        header = {"descr": array.dtype.str, "fortran_order": False, "shape": array.shape}
        npy.write_array_header_1_0(member, header)  # type: ignore[no-untyped-call]
        for slab in _slabs(array):
            told(done / max(array.nbytes, 1))
            digest.update(slab)
            member.write(slab)
            done += len(slab)
    return ArrayFacts(array.shape, array.dtype.str, digest.hexdigest())


def read_array(stream: IO[bytes], facts: ArrayFacts, name: str, told: Told) -> NDArray[Any]:
    """Read what `write_array` wrote.

    Parameters
    ----------
    stream : file
        Open for reading, seekable.
    facts : ArrayFacts
        What it must be; nothing larger is read.
    name : str
        For errors.
    told : callable
        Given the fraction read; raising in it cancels.

    Raises
    ------
    ValueError
        If it is another array. What zlib, zipfile and the system raise passes through.
    """
    with zipfile.ZipFile(stream) as archive, archive.open("array.npy") as member:
        version = npy.read_magic(member)  # type: ignore[no-untyped-call]
        if version != (1, 0):
            raise ValueError(f"{name} has an array of an unknown form {version}")
        shape, fortran, dtype = npy.read_array_header_1_0(member)  # type: ignore[no-untyped-call]
        if tuple(shape) != facts.shape or dtype.str != facts.dtype or fortran:
            raise ValueError(
                f"{name} holds {tuple(shape)} of {dtype.str}, but the session says "
                f"{facts.shape} of {facts.dtype}"
            )
        if dtype.kind not in "biuf":
            raise ValueError(f"{name} must hold real numbers, got {dtype}")
        array = np.empty(shape, dtype)
        if archive.getinfo("array.npy").file_size != member.tell() + array.nbytes:
            raise ValueError(f"{name} is not whole")
        digest, done = hashlib.sha256(), 0
        flat = memoryview(array.reshape(-1).view(np.uint8))  # type: ignore[arg-type]
        while done < array.nbytes:
            told(done / array.nbytes)
            slab = member.read(min(SLAB, array.nbytes - done))
            if not slab:
                raise ValueError(f"{name} is not whole")
            flat[done : done + len(slab)] = slab
            digest.update(slab)
            done += len(slab)
    if digest.hexdigest() != facts.sha256:
        raise ValueError(f"{name} is damaged: its checksum is wrong")
    return array


def _slabs(array: NDArray[Any]) -> Any:
    """Yield the bytes of an array in C order."""
    planes = max(1, SLAB // max(array[:1].nbytes, 1))
    for start in range(0, len(array), planes):
        yield np.ascontiguousarray(array[start : start + planes]).tobytes()
