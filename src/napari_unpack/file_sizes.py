"""How much files ask for, compared with what they hold and with the memory, before it is taken."""

from __future__ import annotations

import math
import os
import stat
import zipfile
from collections.abc import Callable, Collection, Iterable
from contextvars import ContextVar
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from napari_unpack.memory import free_memory

UNASKED = 1 << 30
"""Bytes that any file may ask for: a gigabyte harms no computer that can show a volume."""

LARGEST_RATIO = 600
"""Bytes that a byte of a larger file may become. Packed CT becomes 2 to 20, labels 60 to 100 where
an ID takes two bytes, and what was made to fill a memory 1000, which is the most that zlib can."""

COPIES = 2
"""Readers hold what they read twice for a moment: to convert it, or to turn it."""


class TooLargeError(ValueError):
    """A file asks for more than is read without a person's word.

    Parameters
    ----------
    reason : str
        A sentence that names the file.
    """

    def __init__(self, reason: str) -> None:
        super().__init__(f"{reason}; to open it all the same, give --large (large=True in Python)")
        self.reason = reason


class _Asked(BaseException):
    """Ends a reader where it has told what it is about to take; none may catch it as an error."""

    def __init__(self, needed: int) -> None:
        self.needed = needed


_asking: ContextVar[bool] = ContextVar("asking", default=False)


def asked_size(read: Callable[[], object]) -> int | None:
    """Return the bytes of the first array that a reader would take, from the header alone.

    Parameters
    ----------
    read : callable
        Reads a file; it goes as far as its call of `check_size`.

    Returns
    -------
    int or None
        None where it took nothing.
    """
    token = _asking.set(True)
    try:
        read()
    except _Asked as asked:
        return asked.needed
    finally:
        _asking.reset(token)
    return None


def check_size(
    source: object, needed: int, stored: int, packed: bool = True, large: bool = False
) -> None:
    """Refuse what a file cannot hold, or what would fill the memory, before it is read.

    Parameters
    ----------
    source : object
        The file's name, for messages.
    needed : int
        Bytes in memory by its header.
    stored : int
        Bytes on the disk.
    packed : bool
        Whether it is compressed.
    large : bool
        Whether a person said that it may be large.

    Raises
    ------
    ValueError
        If it is not compressed, and shorter than its header says.
    TooLargeError
        If it asks for more than there is memory free, or holds far less than it asks for.
    """
    if _asking.get():
        raise _Asked(needed)
    if needed > stored and not packed:
        raise ValueError(
            f"{source} is not whole: its header asks for {needed:,} bytes, but it holds {stored:,}"
        )
    if large:
        return
    free = free_memory()
    if COPIES * needed > free:
        raise TooLargeError(
            f"{source} holds {_gigabytes(needed)}, and reading it takes "
            f"{_gigabytes(COPIES * needed)} of memory, of which {_gigabytes(free)} are free"
        )
    if needed > max(UNASKED, LARGEST_RATIO * stored):
        raise TooLargeError(
            f"{source} has {stored:,} bytes and would become {_gigabytes(needed)}, as of a damaged "
            "or made-up file"
        )


def check_plain_file(path: Path) -> None:
    """Refuse what is no file with something in it.

    Raises
    ------
    FileNotFoundError
        If there is nothing.
    ValueError
        If it is empty, a folder, a pipe or a device: reading those would wait or never end.
    """
    try:
        found = path.stat()
    except FileNotFoundError:
        raise FileNotFoundError(f"no such file: {path}") from None
    if stat.S_ISDIR(found.st_mode):
        raise ValueError(f"{path} is a folder, and a file is wanted")
    if not stat.S_ISREG(found.st_mode):
        raise ValueError(f"{path} is a pipe or a device, and a file is wanted")
    if not found.st_size:
        raise ValueError(f"{path} is empty")


class NotPlainError(ValueError):
    """An array holds Python objects, to read which may run anything, or structures."""


def check_array(stream: IO[bytes], source: object, size: int) -> int:
    """Check an array in numpy's form against its own header; return the bytes it takes.

    Parameters
    ----------
    stream : file
        Open for reading.
    source : object
        Its name, for messages.
    size : int
        Bytes of the stream.

    Raises
    ------
    NotPlainError
        If it holds Python objects or structures.
    ValueError
        If it is no such array, or shorter than its header says.
    """
    version = npy.read_magic(stream)  # type: ignore[no-untyped-call]
    readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    # 3.0 is of structures with names in Unicode alone.
    if version not in readers:
        raise NotPlainError(f"{source} must hold plain numbers, got an array of form {version}")
    shape, _, dtype = readers[version](stream)
    if dtype.hasobject:
        raise NotPlainError(
            f"{source} holds Python objects, which are not read: save it as numbers"
        )
    needed = math.prod(shape) * dtype.itemsize
    check_size(source, needed, size - stream.tell(), packed=False, large=True)
    return needed


def load_arrays(
    path: str | Path,
    names: Iterable[str] | None = None,
    large: bool = False,
    texts: Collection[str] = (),
) -> tuple[dict[str, NDArray[Any]], list[str]]:
    """Read arrays of an .npz archive, never pickles.

    Parameters
    ----------
    path : str or Path
    names : iterable of str, optional
        Which; all without it. Those that are not there are left out.
    large : bool
        As for `check_size`.
    texts : collection of str
        Which are left out where they are not plain, as text made by pandas is objects.

    Returns
    -------
    arrays : dict of str to ndarray
    found : list of str
        All names that are there.

    Raises
    ------
    ValueError, OSError
        If it is damaged, or asks for too much. What zipfile and zlib raise passes through.
    """
    file = Path(path)
    check_plain_file(file)
    needed, stored = 0, file.stat().st_size
    with zipfile.ZipFile(file) as archive:
        members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
        chosen = [name for name in (members if names is None else names) if name in members]
        for name in chosen.copy():
            try:
                with archive.open(members[name]) as stream:
                    needed += check_array(stream, f"{name!r} of {path}", members[name].file_size)
            except NotPlainError:
                if name not in texts:
                    raise
                chosen.remove(name)
    check_size(path, needed, stored, large=large)
    # Opening a file from others must run nothing.
    with np.load(file, allow_pickle=False) as arrays:
        return {name: arrays[name] for name in chosen}, list(members)


def stored_size(path: Path) -> int:
    """Return the bytes of a file, or of all files in a folder."""
    if not path.is_dir():
        return path.stat().st_size
    return sum(
        os.lstat(os.path.join(place, name)).st_size
        for place, _, names in os.walk(path)
        for name in names
    )


def _gigabytes(count: int) -> str:
    return f"{count / 1e9:,.3g} GB"
