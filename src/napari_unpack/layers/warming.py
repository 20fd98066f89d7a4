"""What the next flight will need, made ready while nobody waits for it."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from napari_unpack.geometry.transforms import Pose
from napari_unpack.layers.jobs import Jobs
from napari_unpack.layers.shots import Sprite
from napari_unpack.session.pictures import object_patch, sprite_patch

AHEAD = 3
"""How many of those next to leave are made ready; a click may unpack several."""


class Warming:
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
    camera = session.camera
    session.bag.oriented(object_id, camera.stretch)
    pose = Pose(np.zeros(3), camera.rotation, stretch=camera.stretch)
    object_patch(session, object_id, pose, camera, (48, 48), 1.25, "cpu")
    fine = 24.0 / camera.height
    Sprite.of(sprite_patch(session, object_id, pose, fine, 3.0, "cpu"), pose, 1.0 / fine)


def _nothing(_: None) -> None:
    """Take note of nothing."""
