"""Keep the bag and what lies beside it in the window while the window changes its size."""

from __future__ import annotations

from typing import Any

import numpy as np
from qtpy.QtCore import QObject

from napari_unpack.widgets.workbench import Workbench


class KeepFramed(QObject):
    """Frame the bag anew after a resize, unless the user has zoomed or panned since.

    Turning the bag does not count: frames hold it at every turn.

    Parameters
    ----------
    workbench : Workbench
    parent : QObject, optional
    """

    def __init__(self, workbench: Workbench, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._bench = workbench
        self._size: tuple[int, int] | None = None
        self._framed = np.zeros(0)
        workbench.staged.connect(self._begin)
        workbench.changed.connect(self._hear)

    def _begin(self) -> None:
        session = self._bench.session
        if session is not None:
            self._size, self._framed = session.canvas_size, self._camera()

    def _hear(self, news: frozenset[str]) -> None:
        session = self._bench.session
        if "view" not in news or session.canvas_size == self._size:
            return
        self._size = session.canvas_size
        if np.allclose(self._camera(), self._framed, rtol=1e-3):
            self._bench.frame()
            self._framed = self._camera()

    def _camera(self) -> Any:
        """Return zoom and centre."""
        camera = self._bench.viewer.scene.camera
        return np.array([camera.zoom, *camera.center], dtype=np.float64)
