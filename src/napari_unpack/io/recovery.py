"""Copies of unsaved sessions on disk, from which a crash is recovered.

Each copy is a folder that one process keeps for one session and locks as long as it lives. In it
lies a session as `save_session` writes it, one for each state of the labels, the latest alone
staying: its arrays are written once, what else it is after every change.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import tempfile
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from napari_unpack.atomic import written_atomically
from napari_unpack.io.session_archive import MANIFEST, Told, write_array

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from napari_unpack.session import Session

# Two of the largest bags that are measured, 512 x 512 x 1024, with their labels, uncompressed.
MOST_BYTES = 4 << 30
"""What all copies together may take; the oldest ones that nobody uses go first."""

# What other programs need to go on when a disk runs full.
SPARE_BYTES = 1 << 30
"""What must stay free on the disk."""

LOCK = "lock"


def recovery_folder() -> Path:
    """Return where copies are kept: in the user's data folder, as the system has it."""
    from platformdirs import user_data_path

    return user_data_path("napari-unpack", appauthor=False) / "unsaved"


class UnsavedCopy:
    """The copy that this process keeps of one session.

    Parameters
    ----------
    home : Path
        Where copies lie; made when there is something to write.
    most_bytes : int, optional
        What all of them may take.

    Notes
    -----
    Any thread: one call waits for another.
    """

    def __init__(self, home: Path, most_bytes: int = MOST_BYTES) -> None:
        self._home, self._most_bytes = home, most_bytes
        self._turn = threading.RLock()
        self._folder: Path | None = None
        self._lock: IO[bytes] | None = None
        self._count = 0
        self._labels: NDArray[Any] | None = None
        self._arrays: dict[str, Any] = {}

    def keep(
        self,
        session: Session,
        name: str,
        standing: ArrayLike | None,
        told: Told,
        opened: Sequence[int] = (),
    ) -> None:
        """Write a session as it is.

        Parameters
        ----------
        session : Session
            Of all calls the same bag; nothing of it may change meanwhile.
        name : str
            What people call it.
        standing : (4, 4) array_like, optional
            As for `save_session`.
        told : callable
            Given the fraction of the arrays written; raising in it cancels.
        opened : sequence of int
            The objects that are open, one within another, the outermost first.

        Raises
        ------
        OSError
            If it cannot be written, or would take more than it may.
        """
        # What is left over is looked for when the panel opens, which must not load all of this.
        from napari_unpack.io.sessions import manifest_of, written

        with self._turn:
            self._begin_anew_where_gone()
            if self._labels is not session.labels:
                self._write_arrays(session, told)
            manifest = manifest_of(session, standing) | self._arrays
            manifest |= {"name": name, "opened": list(opened)}
            with written_atomically(self._latest / MANIFEST) as temporary:
                temporary.write_bytes(written(manifest))
            # Only now: until this one was whole, the one before was what could be recovered.
            self._remove_earlier()

    def forget(self) -> None:
        """Keep nothing to recover, since it is saved; arrays stay, to be used again."""
        with self._turn:
            self._begin_anew_where_gone()
            if self._folder is not None:
                (self._latest / MANIFEST).unlink(missing_ok=True)
                self._remove_earlier()

    def close(self) -> None:
        """Leave what is not forgotten to be recovered, and nothing else."""
        with self._turn:
            folder, lock = self._folder, self._lock
            self._folder = self._lock = self._labels = None
            if lock is not None:
                lock.close()
            if folder is not None and not _sessions(folder):
                _removed(folder)

    def discard(self) -> None:
        """Keep nothing at all: neither what could be recovered nor arrays."""
        with self._turn:
            self.forget()
            self.close()

    @property
    def _latest(self) -> Path:
        assert self._folder is not None, "there is a folder"
        return self._folder / str(self._count)

    def _begin_anew_where_gone(self) -> None:
        if self._folder is not None and not self._latest.is_dir():
            self.close()

    def _remove_earlier(self) -> None:
        """Remove all states of the labels but the latest: several, where a manifest failed."""
        assert self._folder is not None, "there is a folder"
        for state in self._folder.iterdir():
            if state.is_dir() and state != self._latest:
                shutil.rmtree(state, ignore_errors=True)

    def _write_arrays(self, session: Session, told: Told) -> None:
        from napari_unpack.io.session_json import given_labels

        volume, labels = session.volume, session.labels
        self._home.mkdir(mode=0o700, parents=True, exist_ok=True)
        if self._folder is None:
            self._count, self._arrays = 0, {}
        # The volume is written once, and linked to from then on.
        self._make_room(labels.nbytes + (0 if self._arrays else volume.nbytes))
        if self._folder is None:
            self._folder = Path(tempfile.mkdtemp(prefix=f"{os.getpid()}-", dir=self._home))
            self._lock = locked(self._folder)
        new = self._folder / str(self._count + 1)
        try:
            new.mkdir()
            written_volume = self._volume(new, volume, labels.nbytes, told)
            written_labels = _written_array(new, "labels", given_labels(session), told)
        except BaseException:
            shutil.rmtree(new, ignore_errors=True)
            raise
        self._count += 1
        self._labels = labels
        self._arrays = {"volume": written_volume, "labels": written_labels}

    def _volume(self, new: Path, volume: NDArray[Any], more: int, told: Told) -> dict[str, Any]:
        before = self._latest / "volume.npz"
        if "volume" not in self._arrays:
            return _written_array(new, "volume", volume, told)
        try:
            os.link(before, new / before.name)
        except OSError:
            # Not every file system has hard links; the labels' bytes are to come.
            self._make_room(before.stat().st_size + more)
            shutil.copyfile(before, new / before.name)
        return dict(self._arrays["volume"])

    def _make_room(self, needed: int) -> None:
        """Remove the oldest copies that nobody uses until there is room."""
        if needed > self._most_bytes:
            raise OSError(
                f"the scan takes {needed / 1e9:.1f} GB, more than the {self._most_bytes / 1e9:.1f} "
                "GB that are kept aside"
            )
        old = leftovers(self._home)
        while old and _size(self._home) + needed > self._most_bytes:
            old.pop().discard()
        if shutil.disk_usage(self._home).free < needed + SPARE_BYTES:
            raise OSError("the disk is nearly full")


@dataclass(frozen=True)
class Leftover:
    """An unsaved session of a process that has ended.

    Parameters
    ----------
    folder : Path
        Of the copy.
    session : Path
        In it, what `open_session` opens.
    name : str
        What people call it.
    kept : datetime
        When it was last written, local time.
    opened : tuple of int
        The objects that were open, one within another, the outermost first.
    """

    folder: Path
    session: Path
    name: str
    kept: datetime
    opened: tuple[int, ...] = ()

    def discard(self) -> bool:
        """Take it off the disk; return False where another process has it in hand."""
        return _removed(self.folder)


def leftovers(home: Path) -> list[Leftover]:
    """List what processes that have ended left behind, the latest first.

    Parameters
    ----------
    home : Path
        Where copies lie. Empty ones of ended processes are removed from it.
    """
    found = []
    for folder in sorted(home.iterdir()) if home.is_dir() else []:
        lock = locked(folder)
        if lock is None:
            continue
        lock.close()
        kept = _sessions(folder)
        if not kept:
            _removed(folder)
            continue
        name, opened = _told(kept[-1])
        when = datetime.fromtimestamp(kept[-1].stat().st_mtime)
        found.append(Leftover(folder, kept[-1].parent, name, when, opened))
    return sorted(found, key=lambda one: one.kept, reverse=True)


def locked(folder: Path) -> IO[bytes] | None:
    """Lock a copy until the file returned is closed; None where a process that lives has it.

    Parameters
    ----------
    folder : Path
        The system frees the lock of a process that was killed.
    """
    stream = None
    try:
        stream = (folder / LOCK).open("a+b")
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(stream.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    # Also where a file system knows no locks: what cannot be told counts as in use.
    except OSError:
        if stream is not None:
            stream.close()
        return None
    return stream


def _sessions(folder: Path) -> list[Path]:
    """List the manifests in a copy, the latest last."""
    # By number: the tenth comes after the ninth.
    return sorted(folder.glob(f"*/{MANIFEST}"), key=lambda file: int(file.parent.name))


def _removed(folder: Path) -> bool:
    lock = locked(folder)
    if lock is None:
        return False
    # Windows removes no file that is open.
    lock.close()
    shutil.rmtree(folder, ignore_errors=True)
    return True


def _told(manifest: Path) -> tuple[str, tuple[int, ...]]:
    try:
        told = json.loads(manifest.read_bytes())
        return str(told["name"]), tuple(int(i) for i in told.get("opened", ()))
    except (OSError, ValueError, KeyError, TypeError):
        # Opening it says what is wrong.
        return "a scan", ()


def _written_array(folder: Path, name: str, array: NDArray[Any], told: Told) -> dict[str, Any]:
    file = f"{name}.npz"
    with (folder / file).open("wb") as stream:
        return {"file": file} | write_array(stream, array, told).record()


def _size(folder: Path) -> int:
    found = ((file, file.lstat()) for file in folder.rglob("*") if file.is_file())
    # Once each: states of one bag share its volume by links. Some file systems number no files.
    return sum({one.st_ino or file: one.st_size for file, one in found}.values())
