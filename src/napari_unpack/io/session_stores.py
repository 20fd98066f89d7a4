"""Where a session lies: one zip file, or one folder, each with plain files and no other."""

from __future__ import annotations

import os
import stat
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Protocol

from napari_unpack.io.atomic import folder_written_whole, written_whole

ZIP_SUFFIXES = (".unpack", ".zip")
MANIFEST = "session.json"
MEMBERS = (MANIFEST, "volume.npz", "labels.npz", "picture.png")
"""All that a session may hold."""


class Sink(Protocol):
    """Takes the members of a session."""

    def open(self, name: str) -> IO[bytes]:
        """Open a member for writing."""


class _ZipSink:
    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive

    def open(self, name: str) -> IO[bytes]:
        return self._archive.open(name, "w", force_zip64=True)


class _FolderSink:
    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def open(self, name: str) -> IO[bytes]:
        return (self._folder / name).open("wb")


class Source(Protocol):
    """Gives the members of a session."""

    names: frozenset[str]

    def open(self, name: str) -> IO[bytes]:
        """Open a member for reading."""


class _ZipSource:
    def __init__(self, archive: zipfile.ZipFile, path: Path) -> None:
        self._archive = archive
        names = archive.namelist()
        for name in names:
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


def is_zip(path: Path) -> bool:
    """Tell whether a path means one file; else it means a folder."""
    return path.suffix.lower() in ZIP_SUFFIXES and not path.is_dir()


@contextmanager
def opened_for_writing(path: Path) -> Iterator[Sink]:
    """Give a place for a session that replaces `path` once it is whole, and only then."""
    if is_zip(path):
        with (
            written_whole(path) as temporary,
            zipfile.ZipFile(temporary, "w", zipfile.ZIP_STORED) as archive,
        ):
            yield _ZipSink(archive)
        return
    if path.exists() and not path.is_dir():
        raise ValueError(
            f"{path} is there and is no session: choose another name, or one that ends in "
            f"{' or '.join(ZIP_SUFFIXES)} for a single file"
        )
    with folder_written_whole(path, lambda folder: (folder / MANIFEST).exists()) as temporary:
        yield _FolderSink(temporary)


@contextmanager
def opened_for_reading(path: Path) -> Iterator[Source]:
    """Give the members of the session at `path`."""
    if not path.exists():
        raise FileNotFoundError(f"no such session: {path}")
    if path.is_dir():
        yield _FolderSource(path)
        return
    if not zipfile.is_zipfile(path):
        raise ValueError(f"{path} is no session, or not whole: it is no zip file")
    with zipfile.ZipFile(path) as archive:
        yield _ZipSource(archive, path)


def holds_session(path: Path) -> bool:
    """Tell, from names alone, whether a file or folder is a session."""
    try:
        if path.is_dir():
            return (path / MANIFEST).is_file()
        if path.suffix.lower() == ".unpack":
            return True
        with zipfile.ZipFile(path) as archive:
            return MANIFEST in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return False
