"""What is computed when the camera has come to rest: hues that keep neighbours apart."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from qtpy.QtCore import QTimer

from napari_unpack.layers.jobs import Jobs
from napari_unpack.layers.view_camera import Frame

REST_MS = 250


class AtRest:
    """Chooses hues a quarter of a second after the last movement, in a thread of its own.

    Parameters
    ----------
    session : Session
        Whose hues.
    jobs : Jobs
        With the lane "rest".
    done : callable
        Given the new hues on the main thread, unless the camera has moved meanwhile.
    """

    def __init__(self, session: Any, jobs: Jobs, done: Callable[[dict[int, float]], None]) -> None:
        self._session, self._jobs, self._done = session, jobs, done
        self._state = 0
        self._frame: Frame | None = None
        self._timer = QTimer()
        self._timer.setSingleShot(True)
        self._timer.setInterval(REST_MS)
        self._timer.timeout.connect(self._ask)

    @property
    def waiting(self) -> bool:
        """Whether hues are about to be chosen."""
        return bool(self._timer.isActive())

    def moved(self, frame: Frame) -> None:
        """Take note that the camera has moved."""
        self._frame = frame
        self.states_changed()

    def states_changed(self) -> None:
        """Take note that objects have left or come back."""
        self._state += 1
        self._timer.start()

    def close(self) -> None:
        """Compute nothing more."""
        self._timer.stop()

    def _ask(self) -> None:
        frame, state = self._frame, self._state
        if frame is not None:
            self._jobs.ask(
                "rest",
                "hues",
                lambda: self._session.hues_for(frame.camera, frame.size),
                lambda hues: self._take(hues, state),
            )

    def _take(self, hues: dict[int, float], state: int) -> None:
        if state == self._state:
            self._done(hues)
