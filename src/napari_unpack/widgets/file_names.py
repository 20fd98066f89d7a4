"""The names and folders that file dialogs propose, and the file that a person chose to write."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

from napari.utils.history import (
    get_open_history,
    get_save_history,
    update_open_history,
    update_save_history,
)
from qtpy.QtWidgets import QFileDialog, QMessageBox

from napari_unpack.io.session_archive import ZIP_SUFFIXES
from napari_unpack.io.volumes import stem_of
from napari_unpack.viewer.plain_text import literal

if TYPE_CHECKING:
    from napari.layers import Layer
    from qtpy.QtWidgets import QWidget

    from napari_unpack.session import Session

# What Windows allows in no file name, and what ends a folder's anywhere.
FORBIDDEN = re.compile(r'[\\/:*?"<>|\x00-\x1f]+')


class FileNames:
    """Proposes where to save and open; napari itself remembers the folders between starts."""

    def __init__(self) -> None:
        self._files: WeakKeyDictionary[Session, Path] = WeakKeyDictionary()

    def to_open(self) -> str:
        """Return the folder in which something was opened last."""
        return str(get_open_history()[0])

    def opened(self, session: Session, path: Path) -> None:
        """Take note of the file a session came from.

        Parameters
        ----------
        session : Session
        path : Path
        """
        self._files[session] = path.absolute()
        update_open_history(str(path.absolute()))

    def to_save(self, session: Session, sources: Sequence[Layer]) -> str:
        """Return where a session was saved last, or else a name for it.

        Parameters
        ----------
        session : Session
        sources : sequence of napari layers
            What it is of.
        """
        known = self._files.get(session)
        if known is None:
            return self.to_write(sources, "", ZIP_SUFFIXES[0])
        # One in a folder goes on as a file beside it.
        return str(with_suffix(str(known), *ZIP_SUFFIXES))

    def saved(self, session: Session, path: Path) -> None:
        """Take note of the file a session was saved to.

        Parameters
        ----------
        session : Session
        path : Path
        """
        # Where it was saved it will be looked for.
        self.opened(session, path)
        self.wrote(path)

    def to_write(self, sources: Sequence[Layer], what: str, suffix: str) -> str:
        """Return a name after the bag's file and what is written of it, where one wrote last.

        Parameters
        ----------
        sources : sequence of napari layers
        what, suffix : str
        """
        words = [bag_name(sources), *FORBIDDEN.sub(" ", what).split()]
        return str(Path(get_save_history()[0]) / (" ".join(words) + suffix))

    def wrote(self, path: Path) -> None:
        """Take note of the folder that was written into."""
        update_save_history(str(path.absolute()))


def bag_name(sources: Sequence[Layer]) -> str:
    """Return what a bag is called: its file's name, or else its layer's.

    Parameters
    ----------
    sources : sequence of napari layers
        What its session is of.
    """
    if not sources:
        return "bag"
    first, last = sources[0], sources[-1]
    path = first.source.path
    name = stem_of(Path(path)) if path else str(first.name)
    # Of a time point or a channel, whose objects are named after it.
    if last is not first and str(last.name).startswith(f"{first.name} ("):
        name = str(last.name).removesuffix(" objects")
    return " ".join(FORBIDDEN.sub(" ", name).split()).strip(".") or "bag"


def ask_where_to_write(
    parent: QWidget, title: str, proposed: str, kinds: str, suffixes: Sequence[str]
) -> tuple[Path, str] | None:
    """Ask for a file to write.

    Parameters
    ----------
    parent : QWidget
    title : str
    proposed : str
        The name, with its folder, that is there at first.
    kinds : str
        The filters of the dialog, ";;" between them.
    suffixes : sequence of str
        Of which its name has one, the first if a person writes none.

    Returns
    -------
    (Path, str) or None
        The file, and the filter that was chosen; None where the answer is Cancel.
    """
    while True:
        chosen, kind = QFileDialog.getSaveFileName(parent, title, proposed, kinds)
        if not chosen:
            return None
        path = with_suffix(chosen, *suffixes)
        # The dialog has asked about the name as it was written, not as it is completed.
        if path == Path(chosen) or not path.exists() or _may_replace(parent, title, path):
            return path, kind
        proposed = str(path)


def _may_replace(parent: QWidget, title: str, path: Path) -> bool:
    answer = QMessageBox.question(
        parent, title, literal(f"{path.name} is there already.\nDo you want to replace it?")
    )
    return answer == QMessageBox.StandardButton.Yes


def with_suffix(path: str, *suffixes: str) -> Path:
    """Return a path, with the first of the suffixes where it has none of them.

    Parameters
    ----------
    path : str
    *suffixes : str
    """
    found = Path(path)
    return found if found.suffix.lower() in suffixes else found.with_name(found.name + suffixes[0])
