"""Commands that say something of objects: a colour of their own, a note, a flag."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

from napari_unpack.widgets.notifications import errors_shown
from napari_unpack.widgets.workspace import Workspace

if TYPE_CHECKING:
    from napari_unpack.session.annotations import Annotations
    from napari_unpack.session.state import Flag


class AnnotationCommands:
    """The commands, on the session that the workspace shows; without one they do nothing."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace

    def _run(self, command: Callable[[Annotations], None]) -> None:
        if (session := self._workspace.session) is not None:
            with errors_shown():
                command(session.annotations)

    def color(self, ids: Iterable[int], color: Sequence[float] | None, merge: bool = False) -> None:
        """Give objects a colour of their own; None takes the automatic one again.

        Parameters
        ----------
        ids : iterable of int
        color : (4,) sequence of float, optional
        merge : bool
            As for `Annotations.set_color`.
        """
        self._run(lambda annotations: annotations.set_color(list(ids), color, merge))

    def note(self, object_id: int, text: str) -> None:
        """Write a note on an object.

        Parameters
        ----------
        object_id : int
        text : str
        """
        self._run(lambda annotations: annotations.set_note(object_id, text))

    def flag(self, ids: Iterable[int], flag: Flag | None) -> None:
        """Flag objects, or take their flag away with None.

        Parameters
        ----------
        ids : iterable of int
        flag : {"suspicious", "cleared"}, optional
        """
        self._run(lambda annotations: annotations.set_flag(list(ids), flag))
