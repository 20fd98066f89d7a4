"""Images of what moves: flying objects, an object under the hand, an inspected object."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import replace
from time import perf_counter
from typing import TYPE_CHECKING

from napari_unpack.geometry.view import Camera
from napari_unpack.layers.rendered_image import CanvasImage, RenderedImage
from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.compose import object_image
from napari_unpack.rendering.cpu import INTERACTIVE_PRIORITY
from napari_unpack.rendering.scene import Scene
from napari_unpack.rendering.upsampling import has_stairs
from napari_unpack.tasks import Task
from napari_unpack.viewer.animation import Moving
from napari_unpack.viewer.canvas_backend import CanvasBackend
from napari_unpack.viewer.scheduler import Scheduler, Worker

if TYPE_CHECKING:
    from napari_unpack.session import Session

# Aimed at on the processor: forty images a second, with room for the redraw between them.
FRAME_SECONDS = 0.025

# Aimed at on the graphics card, which draws the rest of the canvas in the same 16 ms.
GL_FRAME_SECONDS = 0.008

# Least share of the screen's rays a side, however slow the machine is.
COARSEST = 0.4


class TransitionRenderer:
    """Casts moving objects, one image after another, as finely as the time allows.

    Parameters
    ----------
    session : Session
    scheduler : Scheduler
    show : callable
        Given {id: image}, the newest of everything that was asked for last.
    canvas_backend : CanvasBackend
        Casts on the canvas where it is active; else a worker thread does, on the CPU, and also
        where a small object is inspected, of whose finer grid the graphics card has nothing.
    """

    def __init__(
        self,
        session: Session,
        scheduler: Scheduler,
        show: Callable[[Mapping[int, RenderedImage | CanvasImage]], None],
        canvas_backend: CanvasBackend,
    ) -> None:
        self._session, self._scheduler = session, scheduler
        self._show, self._canvas_backend = show, canvas_backend
        self._share = 1.0
        self._wanted: tuple[int, ...] = ()
        self._first = True

    @property
    def busy(self) -> bool:
        """Whether an image is being cast."""
        return self._scheduler.has("moving")

    def cast(self, moving: Mapping[int, Moving], frame: Frame) -> None:
        """Ask for an image of objects as they are now; one not yet begun is dropped.

        Parameters
        ----------
        moving : {id: Moving}
        frame : Frame
            What the canvas shows.
        """
        self._wanted = tuple(moving)
        if not moving:
            self._scheduler.cancel("moving")
            self._first = True
            self._show({})
            self._canvas_backend.landed()
            return
        if self._canvas_backend.active and not self._is_enlarged(moving):
            self._cast_on_canvas(moving, frame)
            return
        asked, share, scene = dict(moving), self._share, self._session.scene()
        # A click is answered by the first image; those after it share the cores with the bag.
        way = INTERACTIVE_PRIORITY.taken if self._first else nullcontext

        def work() -> tuple[dict[int, RenderedImage], float, bool]:
            with way():
                return self._work(scene, asked, frame, share)

        self._scheduler.submit(Task("moving", lambda _: work()), Worker.MOTION, self._finish)

    def _is_enlarged(self, moving: Mapping[int, Moving]) -> bool:
        """Whether a small object is inspected, which has a finer grid of its own."""
        boxes, spacing = self._session.boxes, self._session.spacing
        rows = [boxes.index(i) for i, one in moving.items() if one.in_front]
        return any(has_stairs(boxes.upper[row] - boxes.lower[row], spacing) for row in rows)

    def _work(
        self, scene: Scene, moving: Mapping[int, Moving], frame: Frame, share: float
    ) -> tuple[dict[int, RenderedImage], float, bool]:
        began = perf_counter()
        images = {
            object_id: cast_moving(scene, object_id, m, frame.camera, frame.size, share)
            for object_id, m in moving.items()
        }
        sharp = any(m.sharp for m in moving.values())
        found = {object_id: image for object_id, image in images.items() if image is not None}
        return found, perf_counter() - began, sharp

    def _finish(self, result: tuple[dict[int, RenderedImage], float, bool]) -> None:
        images, seconds, sharp = result
        self._first = False
        # A still object has all its pixels, however long that takes.
        if not sharp:
            self._adapt(seconds, FRAME_SECONDS)
        self._show({i: s for i, s in images.items() if i in self._wanted})

    def _cast_on_canvas(self, moving: Mapping[int, Moving], frame: Frame) -> None:
        budget = GL_FRAME_SECONDS / len(moving)
        sharp = any(m.sharp for m in moving.values())
        images = self._canvas_backend.moving(
            moving,
            frame.camera,
            lambda m: detail(m, frame.size, self._share),
            lambda seconds: None if sharp else self._adapt(seconds, budget),
        )
        self._show(images)

    def _adapt(self, seconds: float, wanted: float) -> None:
        self._share = adapted(self._share, seconds, wanted)


def adapted(share: float, seconds: float, wanted: float) -> float:
    """Return the share of the screen's rays a side to cast next.

    Parameters
    ----------
    share : float
        The share cast last.
    seconds, wanted : float
        How long that took, and how long it should take.
    """
    # Down faster than up: a stutter is seen at once, a finer image is not missed.
    change = (wanted / max(seconds, 1e-4)) ** 0.5
    return min(1.0, max(COARSEST, share * min(max(change, 0.75), 1.15)))


def detail(moving: Moving, size: tuple[int, int], share: float) -> tuple[tuple[int, int], float]:
    """Return what to cast an object with.

    Parameters
    ----------
    moving : Moving
    size : (int, int)
        Height and width of the view, pixels.
    share : float
        Of the view's rays a side, unless it is to be sharp.

    Returns
    -------
    size : (int, int)
        Of the whole image, pixels.
    step : float
        Distance of samples, smallest voxel edges.
    """
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
    """Cast one object where it is now; for worker threads.

    Parameters
    ----------
    scene : Scene
    object_id : int
    moving : Moving
    camera : Camera
    size : (int, int)
        Height and width of the view, pixels.
    share : float
        Of the view's rays a side.

    Returns
    -------
    RenderedImage or None
        None where it is out of view.
    """
    small, step = detail(moving, size, share)
    pose, flat = moving.pose, moving.pose.cast_camera(camera, moving.flatness)
    patch = object_image(scene, object_id, pose, flat, small, step, "cpu", smooth=moving.in_front)
    # Only its own rectangle is sent to the graphics card.
    image = RenderedImage.of(patch.trimmed(), camera, small)
    return replace(image, in_front=True) if image is not None and moving.in_front else image
