"""Sprites on their way to new slots, after the window was given another shape."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from time import perf_counter

from napari_unpack.geometry.axes import Vector
from napari_unpack.geometry.transforms import Pose
from napari_unpack.layers.clock import Clock

SECONDS = 0.25


@dataclass(frozen=True, eq=False)
class Glide:
    """One sprite's way: a pure function of time.

    Parameters
    ----------
    origin, target : (3,) ndarray of float64
        Centres, pivot space, mm.
    start : float
        When it sets off, s.
    """

    origin: Vector
    target: Vector
    start: float

    def done(self, time: float) -> bool:
        """Tell whether it has arrived."""
        return time >= self.start + SECONDS

    def center(self, time: float) -> Vector:
        """Return where it is, at rest at both ends."""
        s = min(max((time - self.start) / SECONDS, 0.0), 1.0)
        gone = s * s * (3.0 - 2.0 * s)
        center: Vector = (1.0 - gone) * self.origin + gone * self.target
        return center


class Glides:
    """Lets sprites glide wherever their slots were planned anew.

    Parameters
    ----------
    moved : callable
        Called at every moment of a glide.
    allowed : callable
        Returns False for who asks for reduced motion: all jump.
    now : callable, optional
        Returns the time, s.

    Notes
    -----
    The cards of sprites lie in pivot space, so that nothing is cast and nothing uploaded.
    """

    def __init__(
        self,
        moved: Callable[[], None],
        allowed: Callable[[], bool],
        now: Callable[[], float] = perf_counter,
    ) -> None:
        self._moved, self._allowed = moved, allowed
        self._clock = Clock(self._tick, now)
        self._plan: object = None
        self._poses: dict[int, Pose] = {}
        self._glides: dict[int, Glide] = {}

    @property
    def settled(self) -> bool:
        """Whether all sprites are where they belong."""
        return not self._glides

    def follow(self, poses: Mapping[int, Pose], plan: object) -> dict[int, Pose]:
        """Return where sprites are now.

        Parameters
        ----------
        poses : {id: Pose}
            Where they belong.
        plan : object
            Of the slots; another one lets those glide whose slots have moved. Who moves under
            the same plan was moved by hand.
        """
        now = self._clock.now()
        planned_anew = self._plan is not None and plan is not self._plan and self._allowed()
        glides = {}
        for object_id, pose in poses.items():
            before = self._poses.get(object_id)
            glide = self._glides.get(object_id)
            if before is not None and (before.center != pose.center).any():
                origin = before.center if glide is None else glide.center(now)
                glide = Glide(origin, pose.center, now) if planned_anew else None
            if glide is not None and not glide.done(now):
                glides[object_id] = glide
        self._plan, self._poses, self._glides = plan, dict(poses), glides
        if glides:
            self._clock.start()
        return dict(poses) | {
            i: replace(poses[i], center=glide.center(now)) for i, glide in glides.items()
        }

    def close(self) -> None:
        """Move nothing more."""
        self._clock.stop()
        self._glides = {}

    def _tick(self, now: float) -> None:
        self._moved()
        if not self._glides:
            self._clock.stop()
