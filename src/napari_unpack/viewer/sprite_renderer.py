"""Sprites: one small image per unpacked object, cast once and kept."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from typing import TYPE_CHECKING
from weakref import ReferenceType, ref

import numpy as np

from napari_unpack.geometry.transforms import Pose
from napari_unpack.layers.rendered_image import Sprite
from napari_unpack.rendering.compose import sprite_image
from napari_unpack.rendering.scene import Scene
from napari_unpack.rendering.subvolumes import Subvolume
from napari_unpack.tasks import Task
from napari_unpack.viewer.scheduler import Scheduler, Worker

if TYPE_CHECKING:
    from napari_unpack.session import Session

# All a sprite depends on: the labels' revision, and before it everything else.
Key = tuple[tuple[Hashable, ...], int]

# No sprite is finer than this: more pixels show nothing more of the volume.
PIXELS_PER_VOXEL = 6.0


def resolution(pixels_per_mm: float, finest: float = np.inf) -> float:
    """Round a resolution up to the next half octave, so that small zooms cast nothing.

    Parameters
    ----------
    pixels_per_mm : float
    finest : float, optional
        The most that is returned, before rounding.

    Returns
    -------
    float
        Pixels per mm.
    """
    wanted = min(max(pixels_per_mm, float(np.finfo(np.float64).tiny)), finest)
    return float(2 ** (np.ceil(2 * np.log2(wanted)) / 2))


class SpriteRenderer:
    """Keeps a sprite for every unpacked object.

    Parameters
    ----------
    session : Session
    scheduler : Scheduler
    show : callable
        Given {id: Sprite} whenever that changes.

    Attributes
    ----------
    casts : int
        Sprites cast so far.
    """

    def __init__(
        self,
        session: Session,
        scheduler: Scheduler,
        show: Callable[[dict[int, Sprite]], None],
    ) -> None:
        self.casts = 0
        self._session, self._scheduler, self.show = session, scheduler, show
        # None where an object's own opacity shows nothing of it.
        self._made: dict[int, tuple[Key, Sprite | None]] = {}
        # What each was cast from, by whichever worker cast it.
        self._sources: dict[int, tuple[Hashable, ReferenceType[Subvolume]]] = {}
        self._asked: dict[int, Key] = {}
        self._wanted: dict[int, Pose] = {}
        self._shown: frozenset[int] = frozenset()
        self._revision = 0

    @property
    def settled(self) -> bool:
        """Whether every sprite is there as it should be."""
        return not self._asked

    def has(self, object_id: int) -> bool:
        """Return whether there is any sprite of an object, if an older one or an empty one."""
        return object_id in self._made

    def appearance_changed(self) -> None:
        """Take note that densities look different now."""
        self._revision += 1

    def want(
        self,
        poses: Mapping[int, Pose],
        shown: frozenset[int],
        pixels_per_mm: float,
        gliding: Mapping[int, Pose],
    ) -> None:
        """Cast what is missing or has changed, and forget what is not wanted.

        Parameters
        ----------
        poses : {id: Pose}
            Objects to have sprites of; those still in the air too, so that theirs are ready.
        shown : frozenset of int
            Which of them to show now.
        pixels_per_mm : float
            Of the view, in pivot space.
        gliding : {id: Pose}
            Where some of them are by now, and how large.
        """
        self._wanted, self._shown = {**poses, **gliding}, shown
        # One scene for all: this runs at every frame while anything moves.
        scene, voxel = self._session.scene(), float(np.min(self._session.spacing))
        for object_id in list(self._made):
            if object_id not in poses:
                del self._made[object_id]
        for object_id, pose in poses.items():
            sharpness = resolution(pixels_per_mm, PIXELS_PER_VOXEL / (voxel * pose.scale))
            key = self._key(scene, object_id, pose, sharpness)
            have = self._made.get(object_id)
            # In pivot space an image stays right wherever it is put.
            here = self._wanted[object_id]
            if have is not None and have[1] is not None and not have[1].is_at(here):
                self._made[object_id] = have = (have[0], have[1].moved(here))
            if have is not None and have[0] == key:
                # Turned and at once turned back: what was asked for between comes too late.
                self._asked.pop(object_id, None)
            elif self._asked.get(object_id) != key:
                self._asked[object_id] = key
                self._ask(scene, object_id, pose, sharpness, key)
        self._publish()

    def _key(self, scene: Scene, object_id: int, pose: Pose, sharpness: float) -> Key:
        tint, style = scene.tint_alone(object_id).tobytes(), scene.style(object_id)
        held = pose.rotation.tobytes(), pose.stretch.tobytes(), pose.scale
        # The labels last: where an edit was elsewhere the sprite stays.
        labels = self._session.label_data.revision
        return (*held, tint, sharpness, style, self._revision), labels

    def _ask(
        self,
        scene: Scene,
        object_id: int,
        pose: Pose,
        sharpness: float,
        key: Key,
        last: bool = False,
    ) -> None:
        have, alike = self._made.get(object_id), key[0]

        def cast() -> Sprite | None:
            source = scene.subvolumes.of_object(object_id)
            before = self._sources.get(object_id)
            # An edit of labels elsewhere leaves what an object is cast from as it is.
            kept = before is not None and before[0] == alike and before[1]() is source
            if kept and have is not None and have[0][0] == alike:
                return have[1]
            self._sources[object_id] = alike, ref(source)
            return self._cast(scene, object_id, pose, sharpness)

        def again(_: Exception) -> None:
            if self._asked.get(object_id) == key:
                self._ask(scene, object_id, pose, sharpness, key, last=True)

        # Sprites are cast once, in worker threads, which have no GL context: on the CPU.
        self._scheduler.submit(
            Task(("sprite", object_id), lambda _: cast()),
            Worker.PREVIEW,
            lambda sprite: self._finish(object_id, key, sprite),
            # Memory that was short may be there now; what fails twice is told.
            failed=None if last else again,
        )

    def _cast(self, scene: Scene, object_id: int, pose: Pose, sharpness: float) -> Sprite | None:
        self.casts += 1
        patch = sprite_image(scene, object_id, pose, sharpness, 1.0, "cpu")
        return Sprite.of(patch, pose, 1.0 / sharpness)

    def _finish(self, object_id: int, key: Key, sprite: Sprite | None) -> None:
        if object_id not in self._asked:
            return
        if self._asked[object_id] == key:
            del self._asked[object_id]
        # It may have gone back into the bag meanwhile.
        if object_id in self._wanted:
            self._made[object_id] = key, sprite and sprite.moved(self._wanted[object_id])
            self._publish()

    def _publish(self) -> None:
        made = {i: self._made[i][1] for i in self._wanted if i in self._made and i in self._shown}
        self.show({i: sprite for i, sprite in made.items() if sprite is not None})
