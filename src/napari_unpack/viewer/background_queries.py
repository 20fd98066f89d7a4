"""What is asked once nothing moves: what can leave next, and which hues suit the view.

What the next flight needs is then made ready, before anything waits for it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from napari_unpack.geometry.transforms import Pose
from napari_unpack.layers.rendered_image import Sprite
from napari_unpack.rendering.compose import object_image, sprite_image
from napari_unpack.tasks import Task
from napari_unpack.viewer.scheduler import IdlePhase, Scheduler, Worker

if TYPE_CHECKING:
    from napari_unpack.geometry.view import Camera
    from napari_unpack.rendering.scene import Scene
    from napari_unpack.session import Session
    from napari_unpack.session.placement import Bag
    from napari_unpack.session.state import Group

# Slot of the question what can leave; commands that need the answer wait for it.
OCCLUSION = "occlusion"

# How many of those next to leave are made ready; a click may unpack several.
PREFETCHED = 3

# Pixels of the images that are only cast to load kernels; enough for every code path.
PREFETCH_SIZE = 48, 48


class BackgroundQueries:
    """Asks a session's questions a quarter of a second after the last movement.

    Parameters
    ----------
    session : Session
    scheduler : Scheduler
    recolors : callable
        Returns whether to choose hues now.
    unpackable : callable
        Given the frozenset of the IDs that can leave now, empty where everything is blocked;
        None as soon as that is out of date.

    Notes
    -----
    Tasks are made and their results stored on the main thread. Hues that come after another
    movement are not used, and the session refuses results that are out of date.
    """

    def __init__(
        self,
        session: Session,
        scheduler: Scheduler,
        recolors: Callable[[], bool],
        unpackable: Callable[[frozenset[int] | None], None],
    ) -> None:
        self._session, self._scheduler = session, scheduler
        self._recolors, self._unpackable = recolors, unpackable
        self._revision = 0
        self._direction = session.direction
        self._storing = False
        self._prefetched: set[int] = set()
        scheduler.on_idle(IdlePhase.QUERIES, self._ask)
        # Whatever lands changes what is asked.
        scheduler.hold_idle("flights", lambda: bool(session.flights), IdlePhase.QUERIES)

    @property
    def pending(self) -> bool:
        """Whether questions are about to be asked."""
        return self._scheduler.idle_pending(IdlePhase.QUERIES)

    def moved(self) -> None:
        """Take note that the camera has moved, or objects have left or come back."""
        self._revision += 1
        self._begin_anew()

    def queue_changed(self) -> None:
        """Take note that the direction or the rules may be others."""
        # Our own result changes the queue too, and is no reason to ask again.
        if not self._storing:
            self._begin_anew()

    def labels_changed(self, ids: Iterable[int]) -> None:
        """Take note that objects are not what was made ready."""
        # What was cut out of the volume for them is of the old labels.
        for object_id in ids:
            self._prefetched.discard(object_id)
            self._scheduler.cancel(("prefetch", object_id))
        self.moved()

    def _begin_anew(self) -> None:
        if self._session.direction != self._direction:
            self._direction = self._session.direction
            self._unpackable(None)
        self._scheduler.touch(IdlePhase.QUERIES)

    def _ask(self) -> None:
        queries, revision = self._session.queries, self._revision
        if queries.occlusion_task() is None:
            self._known()
        elif groups := queries.unpackable_groups():
            # As far as rays say; those that they may be wrong about are moved now.
            self._tell(groups)
        occlusion = queries.occlusion_task(finer=True)
        if occlusion is not None:
            done = partial(self._store_occlusion, occlusion)
            self._scheduler.submit(occlusion, Worker.QUERY, done, slot=OCCLUSION)
        if not self._recolors():
            return
        hues = queries.hues_task()
        if hues is None:
            # Known since the camera was here before, perhaps gone on before they were shown.
            self._session.recolor(undoable=False)
            return
        done = partial(self._store_hues, revision, hues)
        self._scheduler.submit(hues, Worker.BACKGROUND, done, slot="hues")

    def _store_occlusion(self, task: Task[Any], result: Any) -> None:
        self._storing = True
        try:
            stored = self._session.queries.store(task, result)
        finally:
            self._storing = False
        if stored:
            self._known()
        else:
            # The bag has changed while it was computed.
            self._scheduler.touch(IdlePhase.QUERIES)

    def _store_hues(self, revision: int, task: Task[Any], result: Any) -> None:
        if self._session.queries.store(task, result) and revision == self._revision:
            self._session.recolor(undoable=False)

    def _known(self) -> None:
        session = self._session
        self._storing = True
        try:
            # The queue comes up to date; where nothing is unpackable it names the least occluded.
            session.unpackable()
        finally:
            self._storing = False
        self._tell(session.queries.unpackable_groups())
        self._prefetch()

    def _tell(self, groups: Iterable[Group]) -> None:
        self._unpackable(frozenset(int(i) for group in groups for i in group))

    def _prefetch(self) -> None:
        """Make ready what is next and is not ready yet.

        Cutting an object out of the volume, finding its tightest box, and loading the kernels
        take tenths of a second, which would be missing from the first moment of its flight.
        """
        fresh = [i for i in self._session.queue.ids[:PREFETCHED] if i not in self._prefetched]
        self._prefetched.update(fresh)
        session = self._session
        bag, scene, camera = session.bag, session.scene(), session.camera
        for object_id in fresh:
            run = partial(prefetch, bag, scene, camera, object_id)
            task = Task(("prefetch", object_id), lambda _, run=run: run())  # type: ignore[misc]
            self._scheduler.submit(task, Worker.BACKGROUND, lambda _: None)


def prefetch(bag: Bag, scene: Scene, camera: Camera, object_id: int) -> None:
    """Cast small images of an object and keep what that needs; for worker threads.

    Parameters
    ----------
    bag : Bag
        Keeps the object's tightest box.
    scene : Scene
        Keeps what was cut out of the volume.
    camera : Camera
    object_id : int
    """
    bag.oriented(object_id, camera.stretch)
    pose = Pose(np.zeros(3), camera.rotation, stretch=camera.stretch)
    object_image(scene, object_id, pose, camera, PREFETCH_SIZE, 1.25, "cpu")
    pixels_per_mm = 24.0 / camera.height
    Sprite.of(
        sprite_image(scene, object_id, pose, pixels_per_mm, 3.0, "cpu"), pose, 1.0 / pixels_per_mm
    )
