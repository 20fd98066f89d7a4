"""Sprites: one small picture per unpacked object, cast once and kept."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from napari_unpack.geometry.transforms import Pose
from napari_unpack.layers.rendered_image import Sprite
from napari_unpack.rendering.compose import sprite_image
from napari_unpack.rendering.scene import Scene
from napari_unpack.viewer.jobs import Jobs

PIXELS_PER_VOXEL = 6.0
"""No sprite is finer than this: more pixels show nothing more."""


def resolution(pixels_per_mm: float, finest: float = np.inf) -> float:
    """Round a resolution up to the next half octave, so that small zooms cast nothing."""
    wanted = min(max(pixels_per_mm, 1e-6), finest)
    return float(2 ** (np.ceil(2 * np.log2(wanted)) / 2))


class SpriteRenderer:
    """Keeps a sprite for every unpacked object.

    Parameters
    ----------
    session : Session
        Whose objects.
    jobs : Jobs
        With the lane "quick".
    show : callable
        Given {id: Sprite} whenever that changes.
    backend : callable
        Returns the backend to cast with.

    Attributes
    ----------
    casts : int
        Sprites cast so far.
    """

    def __init__(
        self,
        session: Any,
        jobs: Jobs,
        show: Callable[[dict[int, Sprite]], None],
        backend: Callable[[], str],
    ) -> None:
        self.casts = 0
        self._session, self._jobs, self._show, self._backend = session, jobs, show, backend
        self._made: dict[int, tuple[Any, Sprite]] = {}
        self._asked: dict[int, Any] = {}
        self._wanted: dict[int, Pose] = {}
        self._shown: frozenset[int] = frozenset()
        self._state = 0

    @property
    def settled(self) -> bool:
        """Whether every sprite is there as it should be."""
        return not self._asked

    def has(self, object_id: int) -> bool:
        """Return whether there is any picture of an object, if an older one."""
        return object_id in self._made

    def look_changed(self) -> None:
        """Take note that densities look different now."""
        self._state += 1

    def want(self, poses: Mapping[int, Pose], shown: frozenset[int], pixels_per_mm: float) -> None:
        """Say which sprites there should be.

        Parameters
        ----------
        poses : {id: Pose}
            Objects to have sprites of; those still in the air too, so that theirs are ready.
        shown : frozenset of int
            Which of them to show now.
        pixels_per_mm : float
            Of the view, in pivot space.
        """
        self._wanted, self._shown = dict(poses), shown
        voxel = float(np.min(self._session.spacing))
        for object_id in list(self._made):
            if object_id not in poses:
                del self._made[object_id]
        for object_id, pose in poses.items():
            fine = resolution(pixels_per_mm, PIXELS_PER_VOXEL / (voxel * pose.scale))
            key = self._key(object_id, pose, fine)
            have = self._made.get(object_id)
            if have is not None and not np.array_equal(have[1].pose.center, pose.center):
                self._made[object_id] = have = (have[0], have[1].moved(pose))
            if (have is None or have[0] != key) and self._asked.get(object_id) != key:
                self._asked[object_id] = key
                self._ask(object_id, pose, fine, key)
        self._publish()

    def _key(self, object_id: int, pose: Pose, fine: float) -> tuple[Any, ...]:
        tint = self._session.tint_alone(object_id).tobytes()
        study = self._session.study(object_id)
        held = pose.rotation.tobytes(), pose.stretch.tobytes(), pose.scale
        return *held, tint, fine, study, self._state

    def _ask(self, object_id: int, pose: Pose, fine: float, key: Any) -> None:
        scene = self._session.scene()
        self._jobs.ask(
            "quick",
            f"sprite {object_id}",
            lambda: self._cast(scene, object_id, pose, fine),
            lambda sprite: self._done(object_id, key, sprite),
        )

    def _cast(self, scene: Scene, object_id: int, pose: Pose, fine: float) -> Sprite | None:
        self.casts += 1
        patch = sprite_image(scene, object_id, pose, fine, 1.0, self._backend())
        return Sprite.of(patch, pose, 1.0 / fine)

    def _done(self, object_id: int, key: Any, sprite: Sprite | None) -> None:
        if self._asked.get(object_id) == key:
            del self._asked[object_id]
        if object_id in self._wanted and sprite is not None:
            self._made[object_id] = key, sprite.moved(self._wanted[object_id])
            self._publish()

    def _publish(self) -> None:
        self._show(
            {i: self._made[i][1] for i in self._wanted if i in self._made and i in self._shown}
        )
