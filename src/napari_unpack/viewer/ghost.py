"""Where an unpacked object was: its ghost in the bag, and a line that leads there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from napari_unpack.geometry.axes import Vector
from napari_unpack.geometry.transforms import packed_pose
from napari_unpack.layers.rendered_image import RenderedImage
from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.compose import object_image
from napari_unpack.rendering.gl.depth_quads import Quad
from napari_unpack.rendering.gl.lines import Stroke
from napari_unpack.rendering.outlines import Silhouette, decorated
from napari_unpack.rendering.scene import Scene
from napari_unpack.session.object_state import ObjectState
from napari_unpack.tasks import Task
from napari_unpack.viewer.scheduler import Scheduler, Worker

if TYPE_CHECKING:
    from napari_unpack.session import Session

# Quick: the mouse runs along a row of sprites.
FADE_SECONDS = 0.18
FILL_OPACITY = 0.4
# Of a ghost where something stands before it.
HIDDEN_OPACITY = 0.3

EDGE = Silhouette((1.0, 1.0, 1.0, 0.9), 1.2, (0.0, 0.0, 0.0, 0.0), (0.0, 0.0), 0.0)
LEADER = (1.0, 1.0, 1.0, 0.55)


@dataclass(frozen=True, eq=False)
class GhostImage:
    """A ghost as it was cast.

    Parameters
    ----------
    object_id : int
    image : RenderedImage
        The flat silhouette at the packed place, with the object's depths.
    frame : Frame
        What the canvas showed.
    """

    object_id: int
    image: RenderedImage
    frame: Frame


class Ghost:
    """Shows, while the mouse is on a sprite, where in the bag its object was.

    Parameters
    ----------
    session : Session
    scheduler : Scheduler
    show : callable
        Called when there is something new to draw.
    """

    def __init__(self, session: Session, scheduler: Scheduler, show: Callable[[], None]) -> None:
        self._session, self._scheduler, self._show = session, scheduler, show
        self._wanted = 0
        self._frame: Frame | None = None
        self._ghost: GhostImage | None = None
        self._strength = 0.0
        self._last = 0.0
        self._leader = Stroke(LEADER, 1.0)
        self._animation = scheduler.animate(self._tick)

    @property
    def settled(self) -> bool:
        """Whether it neither comes nor goes."""
        return not self._animation.running

    @property
    def image(self) -> RenderedImage | None:
        """The silhouette that is shown, or fades."""
        return None if self._ghost is None else self._ghost.image

    def point_at(self, object_id: int) -> None:
        """Show the ghost of an object that is outside, or fade out for 0."""
        if object_id not in self._session.poses:
            object_id = 0
        if object_id == self._wanted:
            return
        self._wanted = object_id
        self._cast()
        self._start()

    def states_changed(self) -> None:
        """Fade out where the object has left its place beside the bag, the mouse unmoved."""
        states = self._session.states
        if states.get(self._wanted) is not ObjectState.UNPACKED:
            self.point_at(0)

    def set_view(self, frame: Frame) -> None:
        """Follow the canvas."""
        if not frame.same_as(self._frame):
            self._frame = frame
            self._cast()

    def close(self) -> None:
        """Draw nothing more."""
        self._animation.stop()
        self._frame, self._ghost, self._wanted = None, None, 0

    def quads_at(self, frame: Frame) -> Sequence[Quad]:
        """Return the ghost twice, faint before everything and full where nothing is before it."""
        ghost = self._ghost
        # Of another view it would stand beside the place.
        if ghost is None or self._strength <= 0.0 or not frame.same_as(ghost.frame):
            return ()
        full = ghost.image.quad(frame.camera, self._strength)
        faint = replace(ghost.image, in_front=True).quad(
            frame.camera, self._strength * HIDDEN_OPACITY
        )
        pose = self._session.poses.get(ghost.object_id)
        if pose is None:
            return (full, faint)
        home = packed_pose(_center(self._session.scene(), ghost.object_id), frame.camera).center
        ends = np.stack([pose.center, home])
        leader = self._leader.quad(ends, frame.camera, frame.size, self._strength)
        return (full, faint) if leader is None else (full, faint, leader)

    def _cast(self) -> None:
        frame, object_id, scene = self._frame, self._wanted, self._session.scene()
        if frame is None or not object_id:
            return
        self._scheduler.submit(
            Task("ghost", lambda _: cast_ghost(scene, object_id, frame)),
            Worker.PREVIEW,
            self._finish,
        )

    def _finish(self, ghost: GhostImage | None) -> None:
        if ghost is not None and ghost.object_id == self._wanted and ghost.frame is self._frame:
            self._ghost = ghost
            self._start()

    def _start(self) -> None:
        self._last = self._animation.now()
        self._animation.start()

    def _tick(self, now: float) -> None:
        shown = self._ghost is not None and self._ghost.object_id == self._wanted
        step = (now - self._last) / FADE_SECONDS
        self._last = now
        self._strength = float(np.clip(self._strength + (step if shown else -step), 0.0, 1.0))
        if self._strength in (0.0, 1.0):
            self._animation.stop()
        self._show()


def cast_ghost(scene: Scene, object_id: int, frame: Frame) -> GhostImage | None:
    """Cast the flat silhouette of an object at its packed place; for worker threads.

    Parameters
    ----------
    scene : Scene
    object_id : int
    frame : Frame
        What the canvas shows.

    Returns
    -------
    GhostImage or None
        None where nothing of it is in view.
    """
    pose = packed_pose(_center(scene, object_id), frame.camera)
    # A flat silhouette needs few samples.
    patch = object_image(scene, object_id, pose, frame.camera, frame.size, 1.5, "cpu").trimmed()
    if patch.is_empty:
        return None
    tint = np.array([*scene.tint_alone(object_id)[:3], 1.0], np.float32)
    alpha = np.clip(patch.rgba[..., 3:] * 2.0, 0.0, 1.0)
    m = EDGE.margin
    solid = np.concatenate([np.zeros_like(patch.rgba[..., :3]), alpha], axis=-1)
    rgba = decorated(solid, EDGE)
    ring = rgba[..., :3].max(axis=-1, keepdims=True)
    inner = np.pad(alpha, ((m, m), (m, m), (0, 0)))
    # Below one half everywhere, so that the ghost hides nothing and is hidden pixel by pixel.
    flat = np.float32(0.49) * np.concatenate([ring, ring, ring, ring], axis=-1)
    flat = flat + FILL_OPACITY * inner * tint * (1.0 - ring)
    depth = np.pad(np.where(np.isfinite(patch.depth), patch.depth, patch.plane), m, mode="edge")
    moved = replace(
        patch,
        rgba=flat.astype(np.float32),
        depth=depth.astype(np.float32),
        row=patch.row - m,
        col=patch.col - m,
    )
    image = RenderedImage.of(moved, frame.camera, frame.size)
    return None if image is None else GhostImage(object_id, image, frame)


def _center(scene: Scene, object_id: int) -> Vector:
    return scene.boxes.center(object_id, scene.spacing)
