"""Write a file, or a folder, wholly or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path


def checked_target(path: str | Path, *suffixes: str) -> Path:
    """Return where a file goes.

    Parameters
    ----------
    path : str or Path
        Where it goes.
    *suffixes : str
        What its name may end in, lower case.

    Raises
    ------
    ValueError
        If its name ends in none of the suffixes, upper or lower case.
    """
    target = Path(path)
    if target.suffix.lower() not in suffixes:
        raise ValueError(f"path must end in {' or '.join(suffixes)}, got {target.name!r}")
    return target


@contextmanager
def written_atomically(path: str | Path) -> Iterator[Path]:
    """Give a temporary path that replaces `path` on success and vanishes on any error.

    It lies in the same folder and has the same suffixes.

    Raises
    ------
    FileNotFoundError
        If the folder does not exist.
    """
    target = Path(path)
    if not target.parent.is_dir():
        raise FileNotFoundError(f"no folder {target.parent} to write {target.name} into")
    # In the same folder, so that the replacement is one rename on one file system.
    handle, name = tempfile.mkstemp(
        # The last two suffixes: writers choose the format by `.nii.gz`, not by `.gz`.
        dir=target.parent,
        prefix=".",
        suffix="".join(target.suffixes[-2:]) or ".part",
    )
    # Writers open it by name, and Windows lets no two have it open.
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        # mkstemp makes files private; a result has the mode any new file has.
        temporary.chmod(0o666 & ~_mask())
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)


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
    """
    target = Path(path)
    if target.exists() and not (target.is_dir() and (is_ours(target) or not any(target.iterdir()))):
        raise ValueError(f"{target} is there and holds something else: choose another name")
    if not target.absolute().parent.is_dir():
        raise FileNotFoundError(f"no folder {target.parent} to write {target.name} into")
    # Hidden and beside it: one rename on one file system, and no half folder in sight.
    temporary = Path(tempfile.mkdtemp(dir=target.absolute().parent, prefix=f".{target.name}-"))
    try:
        yield temporary
        temporary.chmod(0o777 & ~_mask())
        _replace_folder(temporary, target)
    finally:
        # After the rename there is nothing left to remove, which is no error.
        shutil.rmtree(temporary, ignore_errors=True)


def _replace_folder(new: Path, path: Path) -> None:
    # A folder cannot be renamed over another: the old one steps aside, and back on an error.
    old = new.with_name(f"{new.name}-old")
    if path.exists():
        path.replace(old)
    try:
        new.replace(path)
    except OSError:
        if old.exists():
            old.replace(path)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _mask() -> int:
    # The mask can only be read by setting it; it is put back at once.
    mask = os.umask(0)
    os.umask(mask)
    return mask
