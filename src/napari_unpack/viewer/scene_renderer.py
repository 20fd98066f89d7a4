"""What the three layers show: their renderers, flights and inspection brought together."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import Matrix
from napari_unpack.layers.packed_layer import Backdrop, PackedLayer
from napari_unpack.layers.rendered_image import CanvasImage, RenderedImage
from napari_unpack.layers.sprite_layer import SpriteLayer
from napari_unpack.layers.transition_layer import TransitionLayer
from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.subvolumes import Subvolume
from napari_unpack.session.object_state import ObjectState
from napari_unpack.tasks import Task
from napari_unpack.viewer.animation import Animator, Glides
from napari_unpack.viewer.canvas_backend import CanvasBackend
from napari_unpack.viewer.layer_tables import set_table
from napari_unpack.viewer.packed_renderer import PackedRenderer
from napari_unpack.viewer.picking import pick_packed
from napari_unpack.viewer.scheduler import Scheduler, Worker
from napari_unpack.viewer.sprite_renderer import SpriteRenderer
from napari_unpack.viewer.transition_renderer import TransitionRenderer
from napari_unpack.viewer.volume_upload import VolumeUpload

if TYPE_CHECKING:
    from napari_unpack.session import Session

# Opacity of everything else during an inspection: still seen, but not in the way.
DIMMED = 0.16


@dataclass(frozen=True)
class Statistics:
    """What was cast and sent so far.

    Parameters
    ----------
    packed_passes : int
        Castings of the packed image: previews, full images and regions.
    transition_frames : int
        Images of moving objects shown.
    sprites_cast : int
    uploads : int
        Volume textures, and boxes of labels, sent to the graphics card.
    bytes_sent : int
        Of volume textures.
    rays_cast : int
        On the graphics card.
    """

    packed_passes: int
    transition_frames: int
    sprites_cast: int
    uploads: int
    bytes_sent: int
    rays_cast: int


class SceneRenderer:
    """Keeps the images of a session's three layers right.

    Parameters
    ----------
    session : Session
    packed, transition, sprites : layers
    scheduler : Scheduler
    drawn : callable
        Called after an image of moving objects was shown.
    landed : callable
        Given the ID of an object whose flight has ended.
    failed : callable
        Given a sentence when GL fails and the CPU takes over.

    Attributes
    ----------
    frame : Frame or None
        What the canvas showed last.
    packed_renderer, transition_renderer, sprite_renderer
        Of the three layers.
    canvas_backend : CanvasBackend
    animator : Animator
        What moves.
    flight_animation : Animation
        Ticks while anything moves.
    """

    def __init__(
        self,
        session: Session,
        packed: PackedLayer,
        transition: TransitionLayer,
        sprites: SpriteLayer,
        scheduler: Scheduler,
        drawn: Callable[[], None],
        landed: Callable[[int], None],
        failed: Callable[[str], None],
    ) -> None:
        self.session = session
        self.packed, self.transition, self.sprites = packed, transition, sprites
        self.frame: Frame | None = None
        self._drawn, self._landed = drawn, landed
        self._packed_ids: frozenset[int] = frozenset()
        self._scheduler, self._failed = scheduler, failed
        self.canvas_backend = canvas = CanvasBackend(session, self._gl_failed, failed)
        self.packed_renderer = bag = PackedRenderer(session, scheduler, packed, canvas)
        self._upload = VolumeUpload(canvas, scheduler, packed, self._backend_changed, bag.refine)
        self.transition_renderer = TransitionRenderer(session, scheduler, self._show_moving, canvas)
        self.sprite_renderer = SpriteRenderer(session, scheduler, sprites.show)
        self.glides = Glides(scheduler, self._show_sprites, lambda: bag.fade.allowed)
        self.animator = Animator(session, self.sprite_renderer.has, lambda _: bag.settled)
        # Asked anew each time: a film exchanges the session's clock for one it steps itself.
        self.flight_animation = scheduler.animate(self._tick, lambda: session.clock())

    @property
    def statistics(self) -> Statistics:
        """What was cast and sent so far."""
        canvas = self.canvas_backend
        return Statistics(
            packed_passes=self.packed_renderer.passes,
            transition_frames=self.transition_renderer.frames,
            sprites_cast=self.sprite_renderer.casts,
            uploads=canvas.uploads,
            bytes_sent=canvas.bytes_sent,
            rays_cast=canvas.rays_cast,
        )

    @property
    def settled(self) -> bool:
        """Whether every image at rest is full and right."""
        images = self.packed_renderer.settled and self.sprite_renderer.settled
        # What has landed stays in the transition layer for some ticks more.
        landing = self.flight_animation.running and not self.flying
        return images and self.glides.settled and not (self._upload.busy or landing)

    @property
    def flying(self) -> bool:
        """Whether anything is in the air."""
        return self.animator.flying

    @property
    def turning(self) -> bool:
        """Whether an image of the bag alone is waited for, and nothing else moves."""
        moves = self.animator.active(self.flight_animation.now()) or not self.glides.settled
        bag = self.packed_renderer
        return self.packed.visible and bag.turning and not (moves or bag.fade.running)

    @property
    def inspected(self) -> int:
        """The object being inspected, 0 for none."""
        one = self.animator.inspection
        return 0 if one is None or one.leaving else one.object_id

    def open(self) -> None:
        """Make ready in a worker what the first images need."""
        self._supply_with(self._supply)

    def cast_with(self, backend: str) -> None:
        """Choose what casts, "auto", "cpu" or "gl"."""
        before, self.canvas_backend.wanted = self.canvas_backend.active, backend
        self._backend_changed(before)
        self._upload.resume()

    def set_view(self, frame: Frame) -> None:
        """Follow the canvas, which is being drawn."""
        # The driver can be asked only while the canvas is drawn.
        before = self.canvas_backend.active
        self.canvas_backend.enter()
        self.frame = frame
        self._backend_changed(before)
        self.packed_renderer.set_view(frame)
        self._draw_moving()
        self._show_sprites()

    def context_replaced(self) -> None:
        """Show everything anew in a context that holds nothing of ours."""
        before = self.canvas_backend.active
        self.canvas_backend.context_replaced()
        self._backend_changed(before)
        self._upload.resume()
        for layer in (self.packed, self.transition, self.sprites):
            layer.repaint()

    def states_changed(self) -> None:
        """Follow the session's states."""
        self._follow_inspection()
        packed = frozenset(i for i, s in self.session.states.items() if s is ObjectState.PACKED)
        changed, self._packed_ids = packed ^ self._packed_ids, packed
        # What flies first: it answers the click.
        self._draw_moving()
        self.packed_renderer.recast_objects(changed)
        self._show_sprites()
        self._set_tables()
        if self.animator.active(self.flight_animation.now()):
            self.flight_animation.start()

    def labels_changed(self) -> None:
        """Follow the session's labels, which were repaired."""
        self._packed_ids = frozenset(
            i for i, s in self.session.states.items() if s is ObjectState.PACKED
        )
        self._supply_with(self._supply_new)
        self._set_tables()

    def hues_changed(self) -> None:
        """Follow the session's hues."""
        self.packed_renderer.refine()
        self._show_sprites()
        self._set_tables()

    def transfer_function_changed(self) -> None:
        """Follow the session's transfer function."""
        self.packed_renderer.recast()
        self.sprite_renderer.appearance_changed()
        self._show_sprites()

    def decorations_changed(self) -> None:
        """Follow the session's background and box."""
        around = self.session.decorations
        self.packed.backdrop = self.packed.backdrop or backdrop_of(self.session)
        self.packed.backdrop.show(around)
        self.sprites.on_light(around.background.is_light)
        self.packed.repaint()

    def catch_up(self) -> None:
        """Do what the next tick would do, and tick no more by itself."""
        self._tick(self.flight_animation.now())
        self.flight_animation.stop()

    def land(self, object_id: int) -> None:
        """End a flight."""
        flight = self.session.flights.get(object_id)
        if flight is not None:
            self.animator.landed(object_id, None if flight.back else flight.target)
            self.session.land(object_id)
            self._landed(object_id)

    def leave(self) -> None:
        """Let the inspected object go back to its place."""
        one = self.animator.inspection
        if one is not None and not one.leaving:
            self.animator.inspection = one.left(self.flight_animation.now())
            self.flight_animation.start()

    def end_inspection(self) -> None:
        """End an inspection at once; the object keeps the turn it was given."""
        one = self.animator.inspection
        if one is None:
            return
        pose = self.session.poses.get(one.object_id)
        self.session.leave()
        if pose is None:
            return
        if np.array_equal(one.rotation, pose.rotation):
            # An object that was only looked at has not been moved: nothing to undo.
            self.animator.landed(one.object_id, pose)
            self._show_sprites()
        else:
            self._hold(one.object_id, one.rotation)

    def turn(self, object_id: int, rotation: Matrix) -> None:
        """Turn an object under the hand.

        Parameters
        ----------
        object_id : int
        rotation : (3, 3) ndarray of float64
            Of pivot space.
        """
        self.animator.turn(object_id, rotation)
        self._show_sprites()
        self._draw_moving()

    def turned(self, object_id: int) -> None:
        """Let go of an object that was turned."""
        pose = self.animator.turning.pop(object_id, None)
        if pose is not None and object_id in self.session.poses:
            self._hold(object_id, pose.rotation)
        self.flight_animation.start()

    def rotation_of(self, object_id: int) -> Matrix:
        """Return how an object is held now, (3, 3) from world axes to pivot axes."""
        one = self.animator.inspection
        if one is not None and one.object_id == object_id:
            return one.rotation
        pose = self.session.poses.get(object_id)
        camera: Matrix = self.session.camera.rotation
        return camera if pose is None else pose.rotation

    def move(self, object_id: int, pixels: NDArray[np.float64]) -> None:
        """Carry a sprite by some pixels of the frame; its image stays.

        Parameters
        ----------
        object_id : int
        pixels : (2,) ndarray of float64
            Rows down and columns to the right.
        """
        pose = self.animator.carried.get(object_id) or self.session.poses.get(object_id)
        if self.frame is None or pose is None:
            return
        camera = self.frame.camera
        mm = camera.height / self.frame.size[0] * (1.0 - pose.center[0] / camera.distance)
        # Never out of the window: there is nothing to take hold of there.
        rows, cols = self.frame.size
        edge = mm * np.array([0.0, rows, cols]) / 2
        center = np.clip(pose.center + mm * np.array([0.0, *pixels]), -edge, edge)
        self.animator.carried[object_id] = replace(pose, center=center)
        self._show_sprites()

    def moved(self, object_id: int) -> None:
        """Let go of a sprite that was carried."""
        pose = self.animator.carried.pop(object_id, None)
        if pose is not None and object_id in self.session.poses:
            self.session.place(object_id, pose)

    def depth(self) -> NDArray[np.float32]:
        """Return the depths of the packed image, (H, W) t in mm; +inf where none is known."""
        shape = (1, 1) if self.frame is None else self.frame.size
        depth = np.full(shape, np.inf, np.float32)
        image = self.packed.image
        if isinstance(image, RenderedImage) and image.size == shape:
            patch = image.patch
            low = max(patch.row, 0), max(patch.col, 0)
            part = patch.depth[low[0] - patch.row :, low[1] - patch.col :]
            view = depth[low[0] :, low[1] :][: part.shape[0], : part.shape[1]]
            view[:] = part[: view.shape[0], : view.shape[1]]
        return depth

    def sprite_at(self, row: float, col: float) -> int:
        """Return the object whose sprite is at a pixel, 0 for none.

        Parameters
        ----------
        row, col : float
            Of the frame.
        """
        if self.frame is None or not self.sprites.visible:
            return 0
        return self.sprites.at_pixel(row, col, self.frame.size, self.frame.camera)

    def packed_at(self, row: float, col: float) -> list[int]:
        """Return the packed objects at a pixel, the most visible first.

        Parameters
        ----------
        row, col : float
            Of the frame.
        """
        frame = self.frame
        if frame is None or not self.packed.visible:
            return []
        if not (0 <= round(row) < frame.size[0] and 0 <= round(col) < frame.size[1]):
            return []
        found = pick_packed(
            self.session.scene(), self.packed_renderer.known_subvolume(), frame, row, col
        )
        return [i for i in found if i in self.session.states]

    def close(self) -> None:
        """Show nothing new."""
        self.flight_animation.stop()
        self.glides.close()
        self._upload.close()
        self.packed_renderer.close()
        self.canvas_backend.close()
        self.frame = None

    def _follow_inspection(self) -> None:
        """Begin or end showing an object alone, as the session says."""
        states = self.session.states.items()
        wanted = next((i for i, s in states if s is ObjectState.INSPECTED), 0)
        one = self.animator.inspection
        if self.frame is None or (0 if one is None else one.object_id) == wanted:
            return
        self.animator.inspection = None
        if wanted:
            self.animator.begin_inspection(wanted, self.frame, self.flight_animation.now())
        self._dim(DIMMED if wanted else 1.0)
        self.flight_animation.start()

    def _hold(self, object_id: int, rotation: Matrix) -> None:
        self.animator.landed(object_id, self.session.pose_turned(object_id, rotation))
        self.session.turn(object_id, rotation)
        self._show_sprites()

    def _tick(self, now: float) -> None:
        for object_id in self.animator.arrivals(now):
            self.land(object_id)
        one = self.animator.inspection
        if one is not None and one.leaving and one.still(now):
            self.end_inspection()
        active = self.animator.active(now)
        if not self.transition_renderer.busy:
            self._draw_moving()
        if not active:
            self.flight_animation.stop()
            self._draw_moving()

    def _draw_moving(self) -> None:
        if self.frame is not None:
            moving = self.animator.moving(self.flight_animation.now(), self.frame)
            # An image still being cast must not appear once nothing moves any more.
            if moving or self.transition.images or self.transition_renderer.busy:
                self.transition_renderer.cast(moving, self.frame)

    def _supply_with(self, done: Callable[[Subvolume], None]) -> None:
        """Make the volume ready in a worker: growing the labels takes up to a second."""
        scene = self.session.scene()
        task = Task("volume", lambda _: self.packed_renderer.subvolume(scene))
        self._scheduler.submit(task, Worker.REFINE, done)

    def _supply(self, subvolume: Subvolume) -> None:
        before = self.canvas_backend.active
        self.canvas_backend.supply(subvolume)
        self._backend_changed(before)
        self._upload.resume()

    def _supply_new(self, subvolume: Subvolume) -> None:
        self._supply(subvolume)
        self._upload.refine_when_sent()

    def _backend_changed(self, before: bool) -> None:
        if self.canvas_backend.active != before:
            self.packed_renderer.backend_changed()
            self._draw_moving()

    def _gl_failed(self, words: str) -> None:
        # The canvas is being drawn: what follows waits until it is done.
        self._scheduler.soon(self._without_gl)
        self._failed(words)

    def _without_gl(self) -> None:
        if self.frame is not None:
            self.packed_renderer.backend_changed()
            self._draw_moving()

    def _show_moving(self, images: Mapping[int, RenderedImage | CanvasImage]) -> None:
        self.transition.show(images)
        self._show_sprites()
        self._drawn()

    def _show_sprites(self) -> None:
        frame, session = self.frame, self.session
        if frame is None:
            return
        hidden = {i for i, s in session.states.items() if s is ObjectState.HIDDEN}
        poses = {i: pose for i, pose in session.poses.items() if i not in hidden}
        poses |= {i: pose for i, pose in self.animator.carried.items() if i in poses}
        # Slots planned anew are glided to; a sprite under the hand is where the hand is.
        poses = self.glides.follow(poses, session.slots)
        waiting = frozenset(poses)
        for object_id, flight in session.flights.items():
            poses.setdefault(object_id, flight.target)
        # The transition layer shows what moves, from the moment its image is there.
        moving = frozenset(session.flights) | frozenset(self.animator.turning)
        if self.animator.inspection is not None:
            moving |= {self.animator.inspection.object_id}
        shown = waiting - (moving & frozenset(self.transition.images))
        self.sprite_renderer.want(poses, shown, frame.size[0] / frame.camera.height)

    def _set_tables(self) -> None:
        session = self.session
        set_table(self.packed, session, self._packed_ids)
        set_table(self.transition, session, session.flights)
        set_table(self.sprites, session, session.poses)

    def _dim(self, factor: float) -> None:
        self.packed.dim(factor)
        self.sprites.dim(factor)
        self._show_sprites()


def backdrop_of(session: Session) -> Backdrop:
    """Return the backdrop of a session's bag."""
    boxes, spacing = session.boxes, np.asarray(session.spacing, dtype=np.float64)
    lower = (boxes.lower.min(axis=0) - 0.5) * spacing
    upper = (boxes.upper.max(axis=0) - 0.5) * spacing
    return Backdrop(lower, upper, session.decorations)
