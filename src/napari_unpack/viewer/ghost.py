"""Where an unpacked object was: its ghost in the bag, and a line that leads there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np

from napari_unpack.geometry.transforms import packed_pose
from napari_unpack.layers.rendered_image import RenderedImage
from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.compose import object_image
from napari_unpack.rendering.gl.depth_quads import Quad
from napari_unpack.rendering.gl.lines import Stroke
from napari_unpack.rendering.outlines import Silhouette, decorated
from napari_unpack.rendering.scene import Scene
from napari_unpack.viewer.jobs import Clock, Jobs

SECONDS = 0.18
FILL = 0.4
THROUGH = 0.3
"""Opacity of a ghost where something stands before it."""

EDGE = Silhouette((1.0, 1.0, 1.0, 0.9), 1.2, (0.0, 0.0, 0.0, 0.0), (0.0, 0.0), 0.0)
LEADER = (1.0, 1.0, 1.0, 0.55)


@dataclass(frozen=True, eq=False)
class Seen:
    """A ghost as it was cast.

    Parameters
    ----------
    object_id : int
    shot : RenderedImage
        The flat silhouette at the packed place, with the object's depths.
    frame : Frame
        What the canvas showed.
    """

    object_id: int
    shot: RenderedImage
    frame: Frame


class Ghost:
    """Shows, while the mouse is on a sprite, where in the bag its object was.

    Parameters
    ----------
    session : Session
    jobs : Jobs
        With the lane "quick".
    show : callable
        Called when there is something new to draw.
    """

    def __init__(self, session: Any, jobs: Jobs, show: Callable[[], None]) -> None:
        self._session, self._jobs, self._show = session, jobs, show
        self._wanted = 0
        self._frame: Frame | None = None
        self._seen: Seen | None = None
        self._strength = 0.0
        self._last = 0.0
        self._leader = Stroke(LEADER, 1.0)
        self._clock = Clock(self._tick, perf_counter)

    @property
    def settled(self) -> bool:
        """Whether it neither comes nor goes."""
        return not self._clock.running

    def point_at(self, object_id: int) -> None:
        """Show the ghost of an object that is outside, or fade out for 0."""
        if object_id not in self._session.poses:
            object_id = 0
        if object_id == self._wanted:
            return
        self._wanted = object_id
        self._cast()
        self._start()

    def changed(self) -> None:
        """Fade out where the object has left its place beside the bag, the mouse unmoved."""
        states = self._session.states
        if self._wanted not in states or states[self._wanted].name != "UNPACKED":
            self.point_at(0)

    def look(self, frame: Frame) -> None:
        """Follow the canvas."""
        if not frame.same_as(self._frame):
            self._frame = frame
            self._cast()

    def close(self) -> None:
        """Draw nothing more."""
        self._clock.stop()
        self._frame, self._seen, self._wanted = None, None, 0

    def cards_at(self, frame: Frame) -> Sequence[Quad]:
        """Return the ghost twice, faint before everything and full where nothing is before it."""
        seen = self._seen
        if seen is None or self._strength <= 0.0 or not frame.same_as(seen.frame):
            return ()
        full = seen.shot.card(frame.camera, self._strength)
        faint = replace(seen.shot, in_front=True).card(frame.camera, self._strength * THROUGH)
        pose = self._session.poses.get(seen.object_id)
        if pose is None:
            return (full, faint)
        home = packed_pose(self._center(seen.object_id), frame.camera).center
        ends = np.stack([pose.center, home])
        leader = self._leader.quad(ends, frame.camera, frame.size, self._strength)
        return (full, faint) if leader is None else (full, faint, leader)

    def _center(self, object_id: int) -> Any:
        return self._session.boxes.center(object_id, np.asarray(self._session.spacing))

    def _cast(self) -> None:
        frame, object_id = self._frame, self._wanted
        if frame is None or not object_id:
            return
        scene = self._session.scene()
        self._jobs.ask(
            "quick",
            "ghost",
            lambda: cast_ghost(scene, object_id, self._center(object_id), frame),
            self._take,
        )

    def _take(self, seen: Seen | None) -> None:
        if seen is not None and seen.object_id == self._wanted and seen.frame is self._frame:
            self._seen = seen
            self._start()

    def _start(self) -> None:
        self._last = self._clock.now()
        self._clock.start()

    def _tick(self, now: float) -> None:
        shown = self._seen is not None and self._seen.object_id == self._wanted
        step = (now - self._last) / SECONDS
        self._last = now
        self._strength = float(np.clip(self._strength + (step if shown else -step), 0.0, 1.0))
        if self._strength in (0.0, 1.0):
            self._clock.stop()
        self._show()


def cast_ghost(scene: Scene, object_id: int, center: Any, frame: Frame) -> Seen | None:
    """Cast the flat silhouette of an object at its packed place; for worker threads."""
    pose = packed_pose(center, frame.camera)
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
    flat = flat + FILL * inner * tint * (1.0 - ring)
    depth = np.pad(np.where(np.isfinite(patch.depth), patch.depth, patch.plane), m, mode="edge")
    moved = replace(
        patch,
        rgba=flat.astype(np.float32),
        depth=depth.astype(np.float32),
        row=patch.row - m,
        col=patch.col - m,
    )
    shot = RenderedImage.of(moved, frame.camera, frame.size)
    return None if shot is None else Seen(object_id, shot, frame)
