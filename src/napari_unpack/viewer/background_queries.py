"""What is computed when the camera has come to rest: hues, and who can leave next.

What the next flight will need, made ready while nobody waits for it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from napari_unpack.geometry.transforms import Pose
from napari_unpack.layers.rendered_image import Sprite
from napari_unpack.rendering.compose import object_image, sprite_image
from napari_unpack.tasks import Task, no_progress
from napari_unpack.viewer.jobs import Jobs, single_shot, stop

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
        queries = self._session.queries
        leaving = queries.occlusion_task()
        if leaving is not None:
            run = partial(leaving.run, no_progress)
            self._jobs.ask("queue", "queue", run, partial(self._accept, leaving))
        if self._recolors():
            hues = queries.hues_task()
            if hues is not None:
                run = partial(hues.run, no_progress)
                self._jobs.ask("rest", "hues", run, partial(self._take, state, hues))

        if leaving is None:
            self._warm()

    def _accept(self, task: Task[Any], result: Any) -> None:
        if self._session.queries.store(task, result):
            self._warm()

    def _take(self, state: int, task: Task[Any], result: Any) -> None:
        if self._session.queries.store(task, result) and state == self._state:
            self._session.recolor(undoable=False)


AHEAD = 3
"""How many of those next to leave are made ready; a click may unpack several."""


class Prefetch:
    """Makes ready who is next in the session's queue.

    Parameters
    ----------
    session : Session
        Whose objects.
    jobs : Jobs
        With the lane "rest".

    Notes
    -----
    Cutting an object out of the volume, finding its tightest box, and loading the kernels take
    tenths of a second, which would be missing from the first moment of its flight.
    """

    def __init__(self, session: Any, jobs: Jobs) -> None:
        self._session, self._jobs = session, jobs
        self._warm: set[int] = set()

    def ask(self) -> None:
        """Make ready whoever is next and is not yet."""
        fresh = [i for i in self._session.queue.ids[:AHEAD] if i not in self._warm]
        self._warm.update(fresh)
        for object_id in fresh:
            work = partial(warm, self._session, object_id)
            self._jobs.ask("rest", f"warm {object_id}", work, _nothing)


def warm(session: Any, object_id: int) -> None:
    """Cast small pictures of an object and keep what that needs; for worker threads."""
    camera, scene = session.camera, session.scene()
    session.bag.oriented(object_id, camera.stretch)
    pose = Pose(np.zeros(3), camera.rotation, stretch=camera.stretch)
    object_image(scene, object_id, pose, camera, (48, 48), 1.25, "cpu")
    fine = 24.0 / camera.height
    Sprite.of(sprite_image(scene, object_id, pose, fine, 3.0, "cpu"), pose, 1.0 / fine)


def _nothing(_: None) -> None:
    """Take note of nothing."""
