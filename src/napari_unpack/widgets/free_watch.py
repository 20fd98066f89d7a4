"""Keep an eye on what is free, once the bag has come to rest."""

from __future__ import annotations

from qtpy.QtCore import QObject, QTimer, Signal

from napari_unpack.widgets.notices import EXPECTED
from napari_unpack.widgets.workbench import Workbench

_REST_MS = 350


class FreeWatch(QObject):
    """Ask the session what is unpackable after states, queue or view changed and then rested.

    `known` carries a frozenset of IDs, or None as soon as the last answer is out of date.

    Parameters
    ----------
    workbench : Workbench
    parent : QObject, optional
    """

    known = Signal(object)

    def __init__(self, workbench: Workbench, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._bench = workbench
        self._rest = QTimer(self)
        self._rest.setSingleShot(True)
        self._rest.setInterval(_REST_MS)
        self._rest.timeout.connect(self._ask)
        workbench.staged.connect(self._wait)
        workbench.changed.connect(self._hear)

    def end(self) -> None:
        """Stop watching."""
        self._rest.stop()

    def _hear(self, news: frozenset[str]) -> None:
        if news & {"states", "view", "queue"}:
            self._wait()

    def _wait(self) -> None:
        self.known.emit(None)
        if self._bench.stage is None:
            self._rest.stop()
        else:
            self._rest.start()

    def _ask(self) -> None:
        stage = self._bench.stage
        if stage is None:
            return
        if stage.flying:
            self._rest.start()
            return
        try:
            free = frozenset(int(i) for i in stage.session.unpackable())
        except EXPECTED:
            return
        self.known.emit(free)
