"""Objects under the hand: turned in place, or carried beside the bag."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import Matrix

if TYPE_CHECKING:
    from napari_unpack.viewer.scene_renderer import SceneRenderer


class HeldObjects:
    """Turns and carries objects; the session learns of it when they are let go.

    Parameters
    ----------
    renderer : SceneRenderer
    """

    def __init__(self, renderer: SceneRenderer) -> None:
        self._renderer = renderer

    def turn(self, object_id: int, rotation: Matrix) -> None:
        """Turn an object under the hand.

        Parameters
        ----------
        object_id : int
        rotation : (3, 3) ndarray of float64
            Of pivot space.
        """
        self._renderer.animator.turn(object_id, rotation)
        self._renderer.show_sprites()
        self._renderer.draw_moving()

    def turned(self, object_id: int) -> None:
        """Let go of an object that was turned."""
        pose = self._renderer.animator.turning.pop(object_id, None)
        if pose is not None and object_id in self._renderer.session.poses:
            self._renderer.hold(object_id, pose.rotation)
        self._renderer.flight_animation.start()

    def move(self, object_id: int, pixels: NDArray[np.float64]) -> None:
        """Carry a sprite by some pixels of the frame; its image stays.

        Parameters
        ----------
        object_id : int
        pixels : (2,) ndarray of float64
            Rows down and columns to the right.
        """
        pose = self._renderer.animator.carried.get(object_id) or self._renderer.session.poses.get(
            object_id
        )
        if self._renderer.frame is None or pose is None:
            return
        rows, cols = self._renderer.frame.size
        # At the depth of the sprite: it stays under the hand.
        mm = pose.cast_camera(self._renderer.frame.camera, 1.0).height / rows
        # Never out of the window: there is nothing to take hold of there.
        edge = np.array([np.inf, mm * rows / 2, mm * cols / 2])
        center = np.clip(pose.center + mm * np.array([0.0, *pixels]), -edge, edge)
        self._renderer.animator.carried[object_id] = replace(pose, center=center)
        self._renderer.show_sprites()

    def moved(self, object_id: int) -> None:
        """Let go of a sprite that was carried."""
        pose = self._renderer.animator.carried.pop(object_id, None)
        if pose is not None and object_id in self._renderer.session.poses:
            self._renderer.session.place(object_id, pose)
