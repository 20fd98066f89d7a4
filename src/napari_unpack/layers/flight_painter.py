"""Pictures of what moves: objects in the air, an object under the hand, an object inspected."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

from napari_unpack.geometry.transforms import Pose
from napari_unpack.geometry.view import Camera
from napari_unpack.layers.jobs import Jobs
from napari_unpack.layers.shots import Shot
from napari_unpack.layers.view_camera import Frame
from napari_unpack.session.pictures import object_patch

FRAME_SECONDS = 0.04
COARSEST = 0.4


@dataclass(frozen=True, eq=False)
class Moving:
    """One object to be cast where it is now.

    Parameters
    ----------
    pose : Pose
        Where, in the pivot space of the camera.
    in_front : bool
        Draw it before everything else instead of where it is.
    sharp : bool
        It does not move: cast all its pixels.
    """

    pose: Pose
    in_front: bool = False
    sharp: bool = False


class FlightPainter:
    """Casts moving objects, one picture after another, as finely as the time allows.

    Parameters
    ----------
    session : Session
        Whose objects.
    jobs : Jobs
        With the lane "quick".
    show : callable
        Given {id: Shot}; the newest picture of everything that was asked for last.
    backend : callable
        Returns the backend to cast with.

    Attributes
    ----------
    frames : int
        Pictures shown so far.
    """

    def __init__(
        self,
        session: Any,
        jobs: Jobs,
        show: Callable[[dict[int, Shot]], None],
        backend: Callable[[], str],
    ) -> None:
        self.frames = 0
        self._session, self._jobs, self._show, self._backend = session, jobs, show, backend
        self._share = 1.0
        self._wanted: tuple[int, ...] = ()

    @property
    def busy(self) -> bool:
        """Whether a picture is being cast."""
        return self._jobs.has("moving")

    def cast(self, moving: Mapping[int, Moving], frame: Frame) -> None:
        """Ask for a picture of objects as they are now; a picture not yet begun is dropped."""
        self._wanted = tuple(moving)
        if not moving:
            self._jobs.drop("moving")
            self._show({})
            return
        asked, share = dict(moving), self._share
        self._jobs.ask("quick", "moving", lambda: self._work(asked, frame, share), self._done)

    def _work(
        self, moving: Mapping[int, Moving], frame: Frame, share: float
    ) -> tuple[dict[int, Shot], float, bool]:
        began = perf_counter()
        backend = self._backend()
        shots = {
            object_id: cast_moving(
                self._session, object_id, m, frame.camera, frame.size, share, backend
            )
            for object_id, m in moving.items()
        }
        sharp = any(m.sharp for m in moving.values())
        found = {object_id: shot for object_id, shot in shots.items() if shot is not None}
        return found, perf_counter() - began, sharp

    def _done(self, result: tuple[dict[int, Shot], float, bool]) -> None:
        shots, seconds, sharp = result
        if not sharp:
            change = (FRAME_SECONDS / max(seconds, 1e-3)) ** 0.5
            self._share = min(1.0, max(COARSEST, self._share * min(max(change, 0.75), 1.15)))
        self.frames += 1
        self._show({i: s for i, s in shots.items() if i in self._wanted})


def cast_moving(
    session: Any,
    object_id: int,
    moving: Moving,
    camera: Camera,
    size: tuple[int, int],
    share: float,
    backend: str,
) -> Shot | None:
    """Cast one object where it is now; for worker threads."""
    part = 1.0 if moving.sharp else share
    small = max(1, round(size[0] * part)), max(1, round(size[1] * part))
    step = 1.0 if moving.sharp else 1.25
    patch = object_patch(session, object_id, moving.pose, camera, small, step, backend)
    shot = Shot.of(patch.trimmed(), camera, small)
    return replace(shot, in_front=True) if shot is not None and moving.in_front else shot
