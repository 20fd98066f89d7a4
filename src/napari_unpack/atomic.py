"""Write a file, or a folder, wholly or not at all."""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import secrets
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil

# Hidden, and of a name that no other program uses: what a killed process left can be found again.
_PREFIX = ".unpack-"

_OLD = ".before"
"""Ends the name under which a folder stands aside while another takes its place."""

LEFT_BY_SYSTEMS = frozenset({".DS_Store", ".directory", "Thumbs.db", "desktop.ini"})
"""Files that programs which show folders leave in them."""

# Longer than any save takes: what another machine left in a shared folder is not swept before.
_STALE_SECONDS = 7 * 86400.0

_SHOWN = 60
"""Characters of a name in a message."""


def given_path(path: str | Path) -> Path:
    """Return the path that a person gave, ``~`` being their own folder."""
    # Not Path's own, which takes no name that begins so and is nobody's folder.
    return Path(os.path.expanduser(path))


def checked_target(path: str | Path, *suffixes: str) -> Path:
    """Return where a file goes.

    Parameters
    ----------
    path : str or Path
        Where it goes; ``~`` is a person's own folder.
    *suffixes : str
        What its name may end in, lower case; anything where none is given.

    Raises
    ------
    ValueError
        If its name ends in none of the suffixes, upper or lower case.
    """
    target = given_path(path)
    if suffixes and target.suffix.lower() not in suffixes:
        raise ValueError(f"path must end in {' or '.join(suffixes)}, got {target.name!r}")
    return target


def check_writable(path: str | Path) -> None:
    """Refuse a place where nothing can be written, before the work that makes the file.

    Raises
    ------
    FileNotFoundError
        If the folder does not exist.
    PermissionError
        If the file is read-only, or its folder takes no files.
    OSError
        If its name is too long.
    ValueError
        If a pipe or a device is there.
    """
    target = _followed(path)
    _check_mode(target)
    # Tried, not asked: access rights say nothing of a read-only file system.
    try:
        _new_file(target).unlink()
    except OSError as error:
        raise PermissionError(
            f"{target.name} cannot be written into {target.parent}: {error.strerror}"
        ) from error


def check_space(path: str | Path, size: int) -> None:
    """Refuse a result that cannot fit beside what is there.

    Parameters
    ----------
    path : str or Path
        Where it goes.
    size : int
        Bytes it takes at least.

    Raises
    ------
    OSError
        If so many are not free.
    """
    folder = Path(os.path.realpath(path)).parent
    free = shutil.disk_usage(folder).free
    if size > free:
        # Both in one unit: what is free is less.
        unit, name = (1e6, "MB") if size >= 1e6 else (1e3, "kB")
        raise OSError(
            f"{Path(path).name} needs about {size / unit:,.0f} {name}, but {folder} has "
            f"{free / unit:,.0f} {name} free: free some, or choose another folder"
        )


@contextmanager
def written_atomically(
    path: str | Path, check: Callable[[Path], None] | None = None
) -> Iterator[Path]:
    """Give a temporary path that replaces `path` on success and vanishes on any error.

    It lies in the same folder and has the same suffixes. The new file has the mode and, where
    allowed, the owner of the one it replaces; a link is followed and stays. The data are on the
    disk before the name is taken.

    Parameters
    ----------
    path : str or Path
        What shall be written.
    check : callable, optional
        Given the temporary path once it is written; raising in it keeps the old file. For
        writers that report no errors of their own.

    Raises
    ------
    FileNotFoundError
        If the folder does not exist.
    PermissionError
        If the file that is there is read-only.
    ValueError
        If a pipe or a device is there.
    OSError
        If the disk is full or refuses, or the file is still empty.
    """
    target = _followed(path)
    _check_mode(target)
    _sweep(target.parent)
    with _failure_told(target):
        temporary = _new_file(target)
    try:
        with _failure_told(target):
            yield temporary
            if not temporary.stat().st_size:
                # Its writer may have made a file of another name.
                raise OSError("nothing was written")
            if check is not None:
                check(temporary)
            _keep_mode(temporary, target)
            _sync(temporary)
            temporary.replace(target)
            _sync_names(target.parent)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def drafted(path: str | Path) -> Iterator[Path]:
    """Give a path in the folder for temporary files, whose file then replaces `path`.

    For what takes long to make: where the finished file cannot be written to `path`, it stays in
    that folder.

    Parameters
    ----------
    path : str or Path
        What shall be written.

    Yields
    ------
    Path
        In a folder of its own, of the same name.

    Raises
    ------
    FileNotFoundError, PermissionError
        If nothing can be written there, before the work.
    OSError
        If the disk is full or refuses; the message says where the finished file is.
    """
    target = _followed(path)
    check_writable(target)
    home = Path(tempfile.gettempdir())
    _sweep(home)
    folder = home / _own_name()
    draft = folder / target.name
    try:
        # It is this folder that is full, and the target's may have room.
        with _failure_told(target, f" in {home}, the folder for temporary files"):
            folder.mkdir(0o700)
            yield draft
        try:
            with written_atomically(target) as temporary:
                shutil.copyfile(draft, temporary)
        except OSError as error:
            # A name that is not swept, and not hidden.
            kept = folder.replace(Path(tempfile.mkdtemp(prefix="napari-unpack-")))
            raise OSError(f"{error}; the finished file is {kept / target.name}") from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def empty_file_beside(target: Path) -> Iterator[Path]:
    """Make an empty file beside a target inside the `with`; one that is left is swept later."""
    _sweep(target.parent)
    file = _new_file(target)
    try:
        yield file
    finally:
        file.unlink(missing_ok=True)


def is_temporary(name: str) -> bool:
    """Tell whether a file or folder is one that is being written, or was left by a kill."""
    return name.startswith(_PREFIX)


@contextmanager
def folder_written_atomically(path: str | Path, is_ours: Callable[[Path], bool]) -> Iterator[Path]:
    """Give a temporary folder that replaces `path` on success and vanishes on any error.

    Parameters
    ----------
    path : str or Path
        What shall be written; the folder it stands in must exist.
    is_ours : callable
        Given what is there already, tells whether it may be replaced; an empty folder may.

    Yields
    ------
    Path
        An empty folder beside it.

    Raises
    ------
    FileNotFoundError
        If the folder it stands in does not exist.
    ValueError
        If something else is there.
    PermissionError
        If the folder that is there may not be written to.
    """
    target = _followed(path)
    recover_folder(target)
    if target.exists() and not (target.is_dir() and (is_ours(target) or not any(target.iterdir()))):
        raise ValueError(f"{target} is there and holds something else: choose another name")
    _check_mode(target)
    _sweep(target.parent)
    # Hidden and beside it: one rename on one file system, and no half folder in sight.
    temporary = target.parent / _own_name()
    with _failure_told(target):
        temporary.mkdir()
    try:
        with _failure_told(target):
            yield temporary
            for file in temporary.rglob("*"):
                _sync(file)
            _keep_mode(temporary, target)
            _sync(temporary)
            _replace_folder(temporary, target)
    finally:
        # After the rename there is nothing left to remove, which is no error.
        shutil.rmtree(temporary, ignore_errors=True)


def holds_only(folder: Path, belongs: Callable[[str], bool]) -> bool:
    """Tell whether all in a folder is of one kind, but for what file managers leave there.

    Parameters
    ----------
    folder : Path
    belongs : callable
        Told a name in it.
    """
    return all(belongs(file.name) or file.name in LEFT_BY_SYSTEMS for file in folder.iterdir())


def recover_folder(path: Path) -> None:
    """Put a folder back that a killed process had moved aside and not yet replaced.

    To be called before a folder is looked for.
    """
    # "." and the like are there, and have no name to stand aside under.
    if not path.exists() and path.name and _aside(path).exists():
        _aside(path).replace(path)


def _replace_folder(new: Path, path: Path) -> None:
    # A folder cannot be renamed over another, but two names can be exchanged on most systems.
    old = _aside(path)
    shutil.rmtree(old, ignore_errors=True)
    if _exchange(new, path):
        _sync_names(path.parent)
        shutil.rmtree(new, ignore_errors=True)
        return
    # Elsewhere the old one steps aside, and back on an error. Its name is known, so that
    # `recover_folder` finds it after a kill between the two renames.
    if path.exists():
        path.replace(old)
    try:
        new.replace(path)
    except OSError:
        recover_folder(path)
        raise
    _sync_names(path.parent)
    shutil.rmtree(old, ignore_errors=True)


def _exchange(one: Path, two: Path) -> bool:
    """Exchange two names at once; return whether the system and its disk can."""
    if sys.platform != "linux":
        return False
    rename = getattr(ctypes.CDLL(None), "renameat2", None)
    # AT_FDCWD of linux/fcntl.h, RENAME_EXCHANGE of linux/fs.h.
    here, exchange = -100, 2
    return bool(rename and rename(here, os.fsencode(one), here, os.fsencode(two), exchange) == 0)


def _aside(path: Path) -> Path:
    return path.with_name(f".{path.name}{_OLD}")


@contextmanager
def _failure_told(target: Path, where: str = "") -> Iterator[None]:
    """Have errors of the system say which file they meant, and what became of the old one."""
    try:
        yield
    except FileNotFoundError:
        # Of something that is read meanwhile, which its own message names.
        raise
    except OSError as error:
        # Libraries write pages. Of a file in a folder that vanishes, the reason is the folder's.
        known = error.reason if isinstance(error, _NotWrittenError) else None
        reason = known or " ".join(str(error.strerror or error).split())
        raise _NotWrittenError(target, reason + where, error.errno) from error


class _NotWrittenError(OSError):
    def __init__(self, target: Path, reason: str, number: int | None) -> None:
        super().__init__(
            f"{target} could not be written: {reason}; what was there before is unchanged"
        )
        # Set apart: given to the constructor above, the number would stand before the sentence.
        self.errno, self.reason = number, reason

    def __reduce__(self) -> tuple[type[OSError], tuple[str]]:
        """Go to another process as what it says."""
        return OSError, (str(self),)


def _followed(path: str | Path) -> Path:
    """Return where a path leads, links followed, in a folder that exists."""
    target = Path(os.path.realpath(path))
    # Not Path's own, which raises what the system says of a name that is too long.
    if not os.path.isdir(target.parent):
        raise FileNotFoundError(f"no folder {target.parent} to write {target.name} into")
    return target


def _check_mode(target: Path) -> None:
    # A rename asks the folder alone: without this a file that is write-protected, or another
    # person's, would be replaced.
    try:
        mode = target.stat().st_mode
    except FileNotFoundError:
        return
    except OSError as error:
        # Mostly a name that is too long, of which a part tells enough; the reason comes first.
        name = target.name if len(target.name) < _SHOWN else f"{target.name[:_SHOWN]}…"
        sentence = f"{error.strerror}: {name} cannot be written into {target.parent}"
        raise type(error)(sentence) from error
    # A rename would put a file in its place, for every program on the machine.
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise ValueError(f"{target} is a pipe or a device: choose the name of a file")
    if not os.access(target, os.W_OK) or (target.is_file() and not mode & 0o222):
        raise PermissionError(
            f"{target} is read-only{_of_another(target)}: choose another name, or make it writable"
        )
    # In a folder for all, such as /tmp, each may rename what is his own.
    folder = target.parent.stat()
    if folder.st_mode & stat.S_ISVTX and _of_another(target) and _of_another(target.parent):
        raise PermissionError(
            f"{target} is another user's, in a folder where only he may replace it: choose another "
            "name"
        )


def _of_another(path: Path) -> str:
    # Windows has no numbers of users.
    mine = os.geteuid() if hasattr(os, "geteuid") else 0
    return " and another user's" if mine and path.stat().st_uid != mine else ""


def _machine() -> str:
    name = platform.node()
    # Containers may share the name of a machine, and not the numbers of processes.
    with suppress(OSError):
        name += os.readlink("/proc/self/ns/pid")
    # Only told apart from others: a name of letters and digits fits every file system.
    return hashlib.sha256(name.encode()).hexdigest()[:8]


def _own_name() -> str:
    return f"{_PREFIX}{_machine()}-{os.getpid()}-{secrets.token_hex(4)}"


def _new_file(target: Path) -> Path:
    """Make an empty file beside a target, with the mode that any new file has."""
    # The last two suffixes: writers choose the format by `.nii.gz`, not by `.gz`. In lower case,
    # as some of them know no other.
    suffix = "".join(target.suffixes[-2:])[-16:].lower() or ".part"
    temporary = target.with_name(_own_name() + suffix)
    # Closed at once: writers open it by name, and Windows lets no two have it open.
    os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    return temporary


def _keep_mode(temporary: Path, target: Path) -> None:
    if not target.exists():
        return
    found = target.stat()
    # Not everybody may give a file away, and not every file system knows owners and modes.
    for owner in (found.st_uid, -1) if hasattr(os, "chown") else ():
        with suppress(OSError):
            os.chown(temporary, owner, found.st_gid)
            break
    with suppress(OSError):
        temporary.chmod(found.st_mode & 0o7777)


def _sync(path: Path) -> None:
    """Have the disk store a file's data, or a folder's names, now."""
    # Windows opens no folders; its renames are stored by the file system's own journal.
    if path.is_dir() and os.name == "nt":
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _sync_names(folder: Path) -> None:
    # What took its name is there, also where the folder may not be looked into or its file system
    # stores no folders on demand.
    with suppress(OSError):
        _sync(folder)


def _sweep(folder: Path) -> None:
    """Remove what killed processes left half written in a folder."""
    with suppress(OSError):
        for entry in os.scandir(folder):
            if entry.name.startswith(_PREFIX) and _is_stale(entry):
                with suppress(OSError):
                    if entry.is_dir(follow_symlinks=False):
                        shutil.rmtree(entry.path, ignore_errors=True)
                    else:
                        os.unlink(entry.path)


def _is_stale(entry: os.DirEntry[str]) -> bool:
    parts = entry.name.removeprefix(_PREFIX).split("-")
    if len(parts) < 3 or not parts[1].isdigit():
        return False
    # A process number means something on its own machine alone.
    if parts[0] == _machine() and not psutil.pid_exists(int(parts[1])):
        return True
    return time.time() - entry.stat(follow_symlinks=False).st_mtime > _STALE_SECONDS
