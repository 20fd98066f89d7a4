"""Pictures of what moves: objects in the air, an object under the hand, an object inspected."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np

from napari_unpack.geometry.view import Camera
from napari_unpack.layers.rendered_image import CanvasImage, RenderedImage
from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.compose import object_image
from napari_unpack.rendering.cpu import INTERACTIVE_PRIORITY
from napari_unpack.rendering.scene import Scene
from napari_unpack.rendering.upsampling import has_stairs
from napari_unpack.viewer.animation import Moving
from napari_unpack.viewer.canvas_backend import CanvasBackend
from napari_unpack.viewer.jobs import Jobs

FRAME_SECONDS = 0.025
GL_FRAME_SECONDS = 0.008
COARSEST = 0.4


class TransitionRenderer:
    """Casts moving objects, one picture after another, as finely as the time allows.

    Parameters
    ----------
    session : Session
        Whose objects.
    jobs : Jobs
        With the lane "moving".
    show : callable
        Given {id: Shot}; the newest picture of everything that was asked for last.
    studio : CanvasBackend
        Casts on the canvas where it is active; else a worker thread does, on the CPU, and also
        where a small object is inspected, of whose finer grid the graphics card has nothing.

    Attributes
    ----------
    frames : int
        Pictures shown so far.
    """

    def __init__(
        self,
        session: Any,
        jobs: Jobs,
        show: Callable[[Mapping[int, RenderedImage | CanvasImage]], None],
        studio: CanvasBackend,
    ) -> None:
        self.frames = 0
        self._session, self._jobs, self._show, self._studio = session, jobs, show, studio
        self._share = 1.0
        self._wanted: tuple[int, ...] = ()
        self._first = True

    @property
    def busy(self) -> bool:
        """Whether a picture is being cast."""
        return self._jobs.has("moving")

    def cast(self, moving: Mapping[int, Moving], frame: Frame) -> None:
        """Ask for a picture of objects as they are now; a picture not yet begun is dropped."""
        self._wanted = tuple(moving)
        if not moving:
            self._jobs.drop("moving")
            self._first = True
            self._show({})
            self._studio.landed()
            return
        if self._studio.active and not self._is_enlarged(moving):
            self._expose(moving, frame)
            return
        asked, share, scene = dict(moving), self._share, self._session.scene()
        # A click is answered by the first picture; those after it share the cores with the bag.
        way = INTERACTIVE_PRIORITY.taken if self._first else nullcontext

        def work() -> tuple[dict[int, RenderedImage], float, bool]:
            with way():
                return self._work(scene, asked, frame, share)

        self._jobs.ask("moving", "moving", work, self._done)

    def _is_enlarged(self, moving: Mapping[int, Moving]) -> bool:
        """Whether a small object is inspected, which has a finer grid of its own."""
        boxes, spacing = self._session.boxes, np.asarray(self._session.spacing, dtype=np.float64)
        rows = [boxes.index(i) for i, one in moving.items() if one.in_front]
        return any(has_stairs(boxes.upper[row] - boxes.lower[row], spacing) for row in rows)

    def _work(
        self, scene: Scene, moving: Mapping[int, Moving], frame: Frame, share: float
    ) -> tuple[dict[int, RenderedImage], float, bool]:
        began = perf_counter()
        shots = {
            object_id: cast_moving(scene, object_id, m, frame.camera, frame.size, share)
            for object_id, m in moving.items()
        }
        sharp = any(m.sharp for m in moving.values())
        found = {object_id: shot for object_id, shot in shots.items() if shot is not None}
        return found, perf_counter() - began, sharp

    def _done(self, result: tuple[dict[int, RenderedImage], float, bool]) -> None:
        shots, seconds, sharp = result
        self._first = False
        if not sharp:
            self._adapt(seconds, FRAME_SECONDS)
        self.frames += 1
        self._show({i: s for i, s in shots.items() if i in self._wanted})

    def _expose(self, moving: Mapping[int, Moving], frame: Frame) -> None:
        budget = GL_FRAME_SECONDS / len(moving)
        sharp = any(m.sharp for m in moving.values())
        shots = self._studio.moving(
            moving,
            frame.camera,
            lambda m: detail(m, frame.size, self._share),
            lambda seconds: None if sharp else self._adapt(seconds, budget),
        )
        self.frames += 1
        self._show(shots)

    def _adapt(self, seconds: float, wanted: float) -> None:
        self._share = adapted(self._share, seconds, wanted)


def adapted(share: float, seconds: float, wanted: float) -> float:
    """Return the share of the screen's rays a side to cast next, after a frame took so long."""
    change = (wanted / max(seconds, 1e-4)) ** 0.5
    return min(1.0, max(COARSEST, share * min(max(change, 0.75), 1.15)))


def detail(moving: Moving, size: tuple[int, int], share: float) -> tuple[tuple[int, int], float]:
    """Return the size of the whole picture, and the step in voxel edges, to cast an object with."""
    part = 1.0 if moving.sharp else share
    small = max(1, round(size[0] * part)), max(1, round(size[1] * part))
    return small, 1.0 if moving.sharp else 1.25


def cast_moving(
    scene: Scene,
    object_id: int,
    moving: Moving,
    camera: Camera,
    size: tuple[int, int],
    share: float,
) -> RenderedImage | None:
    """Cast one object where it is now; for worker threads."""
    small, step = detail(moving, size, share)
    patch = object_image(
        scene, object_id, moving.pose, camera, small, step, "cpu", smooth=moving.in_front
    )
    shot = RenderedImage.of(patch.trimmed(), camera, small)
    return replace(shot, in_front=True) if shot is not None and moving.in_front else shot
