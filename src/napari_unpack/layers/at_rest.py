"""What is computed when the camera has come to rest: hues, and who can leave next."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from napari_unpack.layers.clock import single_shot, stop
from napari_unpack.layers.jobs import Jobs

REST_MS = 250


class AtRest:
    """Asks the session's questions a quarter of a second after the last movement.

    Parameters
    ----------
    session : Session
        Whose hues and queue.
    jobs : Jobs
        With the lanes "rest" and "queue".
    recolors : callable
        Returns whether to choose hues now.
    warm : callable
        Called once it is known who can leave next.

    Notes
    -----
    Questions are put on the main thread, answered in the lane, and the answers accepted on the
    main thread; hues that come after another movement are thrown away, and the session itself
    refuses a queue that is out of date.
    """

    def __init__(
        self, session: Any, jobs: Jobs, recolors: Callable[[], bool], warm: Callable[[], None]
    ) -> None:
        self._session, self._jobs = session, jobs
        self._recolors, self._warm = recolors, warm
        self._state = 0
        self._timer = single_shot(self._ask, REST_MS)

    @property
    def waiting(self) -> bool:
        """Whether questions are about to be put."""
        return bool(self._timer.isActive())

    def moved(self) -> None:
        """Take note that the camera has moved, or objects have left or come back."""
        self._state += 1
        self._timer.start()

    def close(self) -> None:
        """Ask nothing more."""
        stop(self._timer)

    def _ask(self) -> None:
        state = self._state
        if self._session.flights or self._jobs.turning:
            self._timer.start()
            return
        leaving = self._session.occlusion_question()
        if leaving is not None:
            self._jobs.ask("queue", "queue", leaving.answer, self._accept)
        if self._recolors():
            hues = self._session.hue_question()
            self._jobs.ask("rest", "hues", hues.answer, lambda found: self._take(found, state))

        if leaving is None:
            self._warm()

    def _accept(self, answer: Any) -> None:
        if self._session.accept_answer(answer):
            self._warm()

    def _take(self, hues: dict[int, float], state: int) -> None:
        if state == self._state:
            self._session.accept_hues(hues, undoable=False)
