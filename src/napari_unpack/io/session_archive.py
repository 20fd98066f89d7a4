"""Arrays in session files: compressed slab by slab, and not believed before they are checked.

Where a session lies: one zip file, or one folder, each with plain files and no other.
"""

from __future__ import annotations

import hashlib
import math
import os
import stat
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from napari_unpack.atomic import (
    folder_written_atomically,
    holds_only,
    recover_folder,
    written_atomically,
)
from napari_unpack.file_sizes import check_plain_file, check_size
from napari_unpack.io.volumes import READABLE, suffix_of

# 16 MB: progress moves and cancelling works, yet zlib has enough to work on.
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

    def record(self) -> dict[str, Any]:
        """Return them as plain data."""
        return {"shape": list(self.shape), "dtype": self.dtype, "sha256": self.sha256}

    def check(self, array: NDArray[Any], name: str) -> None:
        """Check that an array is this one.

        Parameters
        ----------
        array : (Z, Y, X) ndarray
            What is there now.
        name : str
            Of it, for messages.

        Raises
        ------
        ValueError
            If its shape, type or content is another.
        """
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
        # The size is not known beforehand, and volumes exceed 4 GB.
        archive.open("array.npy", "w", force_zip64=True) as member,
    ):
        header = {"descr": array.dtype.str, "fortran_order": False, "shape": array.shape}
        # The form of np.savez, so that numpy alone can read a session's arrays.
        npy.write_array_header_1_0(member, header)  # type: ignore[no-untyped-call]
        for slab in _slabs(array):
            told(done / max(array.nbytes, 1))
            digest.update(slab)
            member.write(slab)
            done += len(slab)
    return ArrayFacts(array.shape, array.dtype.str, digest.hexdigest())


def read_array(
    stream: IO[bytes], facts: ArrayFacts, name: str, told: Told, stored: int | None = None
) -> NDArray[Any]:
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
    stored : int, optional
        Bytes that hold it, see `check_size`; without it any amount of memory is taken.

    Raises
    ------
    ValueError
        If it is another array, or asks for too much. What zlib, zipfile and the system raise
        passes through.
    """
    with zipfile.ZipFile(stream) as archive, archive.open("array.npy") as member:
        version = npy.read_magic(member)  # type: ignore[no-untyped-call]
        if version != (1, 0):
            raise ValueError(f"{name} has an array of an unknown form {version}")
        shape, fortran, dtype = npy.read_array_header_1_0(member)  # type: ignore[no-untyped-call]
        # Before memory is taken: a forged header may ask for any amount.
        if tuple(shape) != facts.shape or dtype.str != facts.dtype or fortran:
            raise ValueError(
                f"{name} holds {tuple(shape)} of {dtype.str}, but the session says "
                f"{facts.shape} of {facts.dtype}"
            )
        # Object arrays hold pickles, which run code.
        if dtype.kind not in "biuf":
            raise ValueError(f"{name} must hold real numbers, got {dtype}")
        # A short member would leave part of the array unset.
        needed = math.prod(shape) * dtype.itemsize
        if archive.getinfo("array.npy").file_size != member.tell() + needed:
            raise ValueError(f"{name} is not whole")
        check_size(name, needed, stored or 0, large=stored is None)
        array = np.empty(shape, dtype)
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
    # Whole planes: a slice of a contiguous array costs no copy but its bytes.
    planes = max(1, SLAB // max(array[:1].nbytes, 1))
    for start in range(0, len(array), planes):
        yield np.ascontiguousarray(array[start : start + planes]).tobytes()


ZIP_SUFFIXES = (".unpack", ".zip")
MANIFEST = "session.json"
MEMBERS = (MANIFEST, "volume.npz", "labels.npz", "picture.png")
"""All that a session may hold."""


class _ZipSource:
    def __init__(self, archive: zipfile.ZipFile, path: Path) -> None:
        self._archive = archive
        names = archive.namelist()
        for name in names:
            # Anything else, such as a path out of the folder, means that it is none of ours.
            if name not in MEMBERS:
                raise ValueError(f"{path} is no session, or not whole: it holds {name!r}")
        if len(set(names)) != len(names):
            raise ValueError(f"{path} is damaged: it holds a file twice")
        self.names = frozenset(names)

    def open(self, name: str) -> IO[bytes]:
        return self._archive.open(name)


class _FolderSource:
    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.names = frozenset(name for name in MEMBERS if os.path.lexists(folder / name))

    def open(self, name: str) -> IO[bytes]:
        file = self._folder / name
        # A link would lead out of the folder.
        if not stat.S_ISREG(file.lstat().st_mode):
            raise ValueError(f"{file} must be a plain file in its folder, not a link")
        return file.open("rb")


# Gives the members of a session: their names, and each opened for reading.
Source = _ZipSource | _FolderSource


def is_zip(path: Path) -> bool:
    """Tell whether a path means one file; else it means a folder."""
    return path.suffix.lower() in ZIP_SUFFIXES and not os.path.isdir(path)


@contextmanager
def opened_for_writing(path: Path) -> Iterator[Callable[[str], IO[bytes]]]:
    """Give what opens the members of a session that replaces `path` once it is whole.

    Raises
    ------
    ValueError
        If something that is no session is there, or the name is that of another kind of file.
    """
    if is_zip(path):
        with (
            written_atomically(path) as temporary,
            # Stored: its members are compressed already.
            zipfile.ZipFile(temporary, "w", zipfile.ZIP_STORED) as archive,
        ):
            yield lambda name: archive.open(name, "w", force_zip64=True)
        return
    if path.exists() and not path.is_dir():
        raise ValueError(
            f"{path} is there and is no session: choose another name, or one that ends in "
            f"{' or '.join(ZIP_SUFFIXES)} for a single file"
        )
    if suffix_of(path) in READABLE and not path.exists():
        raise ValueError(
            f"{path} would be a folder with the name of a {suffix_of(path)} file: let it end in "
            f"{' or '.join(ZIP_SUFFIXES)} for a single file, or in no suffix for a folder"
        )
    with folder_written_atomically(path, _is_session) as temporary:
        yield lambda name: (temporary / name).open("wb")


def _is_session(folder: Path) -> bool:
    # What a person put beside it would go with the old one.
    return (folder / MANIFEST).exists() and holds_only(folder, MEMBERS.__contains__)


@contextmanager
def opened_for_reading(path: Path) -> Iterator[Source]:
    """Give the members of the session at `path`.

    Raises
    ------
    FileNotFoundError, ValueError
        If there is no session.
    """
    recover_folder(path)
    if not path.exists():
        raise FileNotFoundError(f"no such session: {path}")
    if path.is_dir():
        yield _FolderSource(path)
        return
    check_plain_file(path)
    if not zipfile.is_zipfile(path):
        raise ValueError(f"{path} is no session, or not whole: it is no zip file")
    with zipfile.ZipFile(path) as archive:
        yield _ZipSource(archive, path)


def holds_session(path: Path) -> bool:
    """Tell, from names alone, whether a file or folder is a session."""
    try:
        recover_folder(path)
        if path.is_dir():
            return (path / MANIFEST).is_file()
        # A broken one is a session too: opening it says what is wrong.
        if path.suffix.lower() == ".unpack":
            return True
        if not path.is_file():
            return False
        with zipfile.ZipFile(path) as archive:
            return MANIFEST in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return False
