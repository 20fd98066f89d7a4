"""What the three layers show: painters, flights and inspection brought together."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from qtpy.QtCore import QTimer

from napari_unpack.geometry.axes import Matrix
from napari_unpack.layers.packed_layer import Backdrop, PackedLayer
from napari_unpack.layers.rendered_image import CanvasImage, RenderedImage
from napari_unpack.layers.sprite_layer import SpriteLayer
from napari_unpack.layers.transition_layer import TransitionLayer
from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.subvolumes import Subvolume
from napari_unpack.viewer.animation import Animator, Glides
from napari_unpack.viewer.canvas_backend import CanvasBackend
from napari_unpack.viewer.jobs import Clock, Jobs
from napari_unpack.viewer.layer_tables import set_table
from napari_unpack.viewer.packed_renderer import PackedRenderer, VolumeUpload
from napari_unpack.viewer.picking import pick_packed
from napari_unpack.viewer.sprite_renderer import SpriteRenderer
from napari_unpack.viewer.transition_renderer import TransitionRenderer

DIMMED = 0.16
"""Opacity of everything else during an inspection."""


class SceneRenderer:
    """Keeps the pictures of a session's three layers right.

    Parameters
    ----------
    session : Session
    packed, transition, sprites : layers
    jobs : Jobs
        With the lanes "moving", "quick" and "fine".
    drawn : callable
        Called after a picture of moving objects was shown.
    landed : callable
        Given the ID of an object whose flight has ended.
    failed : callable
        Given a sentence when GL fails and the CPU takes over.
    """

    def __init__(
        self,
        session: Any,
        packed: PackedLayer,
        transition: TransitionLayer,
        sprites: SpriteLayer,
        jobs: Jobs,
        drawn: Callable[[], None],
        landed: Callable[[int], None],
        failed: Callable[[str], None],
    ) -> None:
        self.session = session
        self.packed, self.transition, self.sprites = packed, transition, sprites
        self.frame: Frame | None = None
        self._drawn, self._landed = drawn, landed
        self._packed_ids: frozenset[int] = frozenset()
        self._jobs, self._failed = jobs, failed
        self.studio = CanvasBackend(session, self._gl_failed, failed)
        self.bag = PackedRenderer(session, jobs, packed, self.studio)
        self._sending = VolumeUpload(self.studio, packed, self._caster_changed, self.bag.refine)
        self._flights = TransitionRenderer(session, jobs, self._show_moving, self.studio)
        self._small = SpriteRenderer(session, jobs, sprites.show, _caster)
        self._glides = Glides(self._show_sprites, lambda: self.bag.fade.allowed)
        self._animator = Animator(session, self._small.has, lambda _: self.bag.settled)
        # Asked anew each time: a film exchanges the session's clock for one it steps itself.
        self._clock = Clock(self._tick, lambda: session.clock())

    @property
    def settled(self) -> bool:
        """Whether every picture at rest is full and right."""
        pictures = self.bag.settled and self._small.settled and self._glides.settled
        # What has landed stays in the transition layer for some ticks more.
        landing = self._clock.running and not self.flying
        return pictures and not (self._sending.busy or landing)

    @property
    def flying(self) -> bool:
        """Whether anything is in the air."""
        return self._animator.flying

    @property
    def turning(self) -> bool:
        """Whether a picture of the bag alone is waited for, and nothing else moves."""
        moves = self._animator.active(self._clock.now()) or not self._glides.settled
        return self.packed.visible and self.bag.turning and not (moves or self.bag.fade.running)

    @property
    def inspected(self) -> int:
        """The object being inspected, 0 for none."""
        one = self._animator.inspection
        return 0 if one is None or one.leaving else one.object_id

    def open(self) -> None:
        """Make ready in a worker what the first pictures need."""
        self._jobs.ask("fine", "volume", self.bag.crop, self._supply)

    def cast_with(self, backend: str) -> None:
        """Choose who casts, "auto", "cpu" or "gl"."""
        before, self.studio.wanted = self.studio.active, backend
        self._caster_changed(before)
        self._sending.go_on()

    def look(self, frame: Frame) -> None:
        """Follow the canvas, which is being drawn."""
        before = self.studio.active
        self.studio.enter()
        self.frame = frame
        self._caster_changed(before)
        self.bag.look(frame)
        self._draw_moving()
        self._show_sprites()

    def context_replaced(self) -> None:
        """Show everything anew in a context that holds nothing of ours."""
        before = self.studio.active
        self.studio.context_replaced()
        self._caster_changed(before)
        self._sending.go_on()
        for layer in (self.packed, self.transition, self.sprites):
            layer.repaint()

    def states_changed(self) -> None:
        """Follow the session's states."""
        self._follow_inspection()
        packed = frozenset(i for i, s in self.session.states.items() if s.name == "PACKED")
        changed, self._packed_ids = packed ^ self._packed_ids, packed
        self._draw_moving()
        self.bag.recast_objects(changed)
        self._show_sprites()
        self._set_tables()
        if self._animator.active(self._clock.now()):
            self._clock.start()

    def labels_changed(self, ids: Iterable[int]) -> None:
        """Follow the session's labels, which were repaired where these objects are or were."""
        for object_id in ids:
            self._jobs.drop(f"warm {object_id}")
        self._packed_ids = frozenset(
            i for i, s in self.session.states.items() if s.name == "PACKED"
        )
        self._jobs.ask("fine", "volume", self.bag.crop, self._supply_new)
        self._set_tables()

    def hues_changed(self) -> None:
        """Follow the session's hues."""
        self.bag.refine()
        self._show_sprites()
        self._set_tables()

    def densities_changed(self) -> None:
        """Follow the session's transfer function."""
        self.bag.recast()
        self._small.look_changed()
        self._show_sprites()

    def surroundings_changed(self) -> None:
        """Follow the session's background and box."""
        around = self.session.surroundings
        self.packed.backdrop = self.packed.backdrop or Backdrop.of(self.session)
        self.packed.backdrop.show(around)
        self.sprites.on_light(around.background.is_light)
        self.packed.repaint()

    def catch_up(self) -> None:
        """Do what the next tick of the clock would do, and tick no more by itself."""
        self._tick(self._clock.now())
        self._clock.stop()

    def land(self, object_id: int) -> None:
        """End a flight."""
        flight = self.session.flights.get(object_id)
        if flight is not None:
            self._animator.landed(object_id, None if flight.back else flight.target)
            self.session.land(object_id)
            self._landed(object_id)

    def leave(self) -> None:
        """Let the inspected object go back to its place."""
        one = self._animator.inspection
        if one is not None and not one.leaving:
            self._animator.inspection = one.left(self._clock.now())
            self._clock.start()

    def end_inspection(self) -> None:
        """End an inspection at once; the object keeps the turn it was given."""
        one = self._animator.inspection
        if one is None:
            return
        pose = self.session.poses.get(one.object_id)
        self.session.leave()
        if pose is None:
            return
        if np.array_equal(one.rotation, pose.rotation):
            # An object that was only looked at has not been moved: nothing to undo.
            self._animator.landed(one.object_id, pose)
            self._show_sprites()
        else:
            self._hold(one.object_id, one.rotation)

    def turn(self, object_id: int, rotation: Matrix) -> None:
        """Turn an object under the hand."""
        self._animator.turn(object_id, rotation)
        self._show_sprites()
        self._draw_moving()

    def turned(self, object_id: int) -> None:
        """Let go of an object that was turned."""
        pose = self._animator.turning.pop(object_id, None)
        if pose is not None and object_id in self.session.poses:
            self._hold(object_id, pose.rotation)
        self._clock.start()

    def rotation_of(self, object_id: int) -> Matrix:
        """Return how an object is held now, (3, 3) from world axes to pivot axes."""
        one = self._animator.inspection
        if one is not None and one.object_id == object_id:
            return one.rotation
        pose = self.session.poses.get(object_id)
        camera: Matrix = self.session.camera.rotation
        return camera if pose is None else pose.rotation

    def move(self, object_id: int, pixels: NDArray[np.float64]) -> None:
        """Carry a sprite by some pixels of the frame; its picture stays."""
        pose = self._animator.carried.get(object_id) or self.session.poses.get(object_id)
        if self.frame is None or pose is None:
            return
        camera = self.frame.camera
        mm = camera.height / self.frame.size[0] * (1.0 - pose.center[0] / camera.distance)
        # Never out of the window, where nobody could take hold of it again.
        rows, cols = self.frame.size
        edge = mm * np.array([0.0, rows, cols]) / 2
        center = np.clip(pose.center + mm * np.array([0.0, *pixels]), -edge, edge)
        self._animator.carried[object_id] = replace(pose, center=center)
        self._show_sprites()

    def moved(self, object_id: int) -> None:
        """Let go of a sprite that was carried."""
        pose = self._animator.carried.pop(object_id, None)
        if pose is not None and object_id in self.session.poses:
            self.session.place(object_id, pose)

    def depth(self) -> NDArray[np.float32]:
        """Return the depths of the packed picture, (H, W) t in mm; +inf where none is known."""
        shape = (1, 1) if self.frame is None else self.frame.size
        depth = np.full(shape, np.inf, np.float32)
        shot = self.packed.shot
        if isinstance(shot, RenderedImage) and shot.size == shape:
            patch = shot.patch
            low = max(patch.row, 0), max(patch.col, 0)
            part = patch.depth[low[0] - patch.row :, low[1] - patch.col :]
            view = depth[low[0] :, low[1] :][: part.shape[0], : part.shape[1]]
            view[:] = part[: view.shape[0], : view.shape[1]]
        return depth

    def sprite_at(self, row: float, col: float) -> int:
        """Return the object whose sprite is at a pixel of the frame, 0 for none."""
        if self.frame is None or not self.sprites.visible:
            return 0
        return self.sprites.at_pixel(row, col, self.frame.size, self.frame.camera)

    def packed_at(self, row: float, col: float) -> list[int]:
        """Return the packed objects at a pixel of the frame, the most visible first."""
        frame = self.frame
        if frame is None or not self.packed.visible:
            return []
        if not (0 <= round(row) < frame.size[0] and 0 <= round(col) < frame.size[1]):
            return []
        found = pick_packed(self.session.scene(), self.bag.known_crop(), frame, row, col)
        return [i for i in found if i in self.session.states]

    def close(self) -> None:
        """Show nothing new."""
        self._clock.stop()
        self._glides.close()
        self._sending.close()
        self.bag.close()
        self.studio.close()
        self.frame = None

    def _follow_inspection(self) -> None:
        """Begin or end showing an object alone, as the session says."""
        ids = [i for i, s in self.session.states.items() if s.name == "INSPECTED"]
        wanted = ids[0] if ids else 0
        one = self._animator.inspection
        if self.frame is None or (0 if one is None else one.object_id) == wanted:
            return
        self._animator.inspection = None
        if wanted:
            self._animator.begin_inspection(wanted, self.frame, self._clock.now())
        self._dim(DIMMED if wanted else 1.0)
        self._clock.start()

    def _hold(self, object_id: int, rotation: Matrix) -> None:
        self._animator.landed(object_id, self.session.pose_turned(object_id, rotation))
        self.session.turn(object_id, rotation)
        self._show_sprites()

    def _tick(self, now: float) -> None:
        for object_id in self._animator.arrivals(now):
            self.land(object_id)
        one = self._animator.inspection
        if one is not None and one.leaving and one.still(now):
            self.end_inspection()
        active = self._animator.active(now)
        if not self._flights.busy:
            self._draw_moving()
        if not active:
            self._clock.stop()
            self._draw_moving()

    def _draw_moving(self) -> None:
        if self.frame is not None:
            moving = self._animator.moving(self._clock.now(), self.frame)
            # A picture still being cast must not appear once nothing moves any more.
            if moving or self.transition.shots or self._flights.busy:
                self._flights.cast(moving, self.frame)

    def _supply(self, crop: Subvolume) -> None:
        before = self.studio.active
        self.studio.supply(crop)
        self._caster_changed(before)
        self._sending.go_on()

    def _supply_new(self, crop: Subvolume) -> None:
        self._supply(crop)
        self._sending.refine_when_sent()

    def _caster_changed(self, before: bool) -> None:
        if self.studio.active != before:
            self.bag.change_caster()
            self._draw_moving()

    def _gl_failed(self, words: str) -> None:
        # The canvas is being drawn: what follows waits until it is done.
        QTimer.singleShot(0, self._without_gl)
        self._failed(words)

    def _without_gl(self) -> None:
        if self.frame is not None:
            self.bag.change_caster()
            self._draw_moving()

    def _show_moving(self, shots: Mapping[int, RenderedImage | CanvasImage]) -> None:
        self.transition.show(shots)
        self._show_sprites()
        self._drawn()

    def _show_sprites(self) -> None:
        frame, session = self.frame, self.session
        if frame is None:
            return
        hidden = {i for i, s in session.states.items() if s.name == "HIDDEN"}
        poses = {i: pose for i, pose in session.poses.items() if i not in hidden}
        poses |= {i: pose for i, pose in self._animator.carried.items() if i in poses}
        poses = self._glides.follow(poses, session.slots)
        waiting = frozenset(poses)
        for object_id, flight in session.flights.items():
            poses.setdefault(object_id, flight.target)
        # Who moves is shown by the transition layer, from the moment its picture is there.
        moving = frozenset(session.flights) | frozenset(self._animator.turning)
        if self._animator.inspection is not None:
            moving |= {self._animator.inspection.object_id}
        shown = waiting - (moving & frozenset(self.transition.shots))
        self._small.want(poses, shown, frame.size[0] / frame.camera.height)

    def _set_tables(self) -> None:
        session = self.session
        set_table(self.packed, session, self._packed_ids)
        set_table(self.transition, session, session.flights)
        set_table(self.sprites, session, session.poses)

    def _dim(self, factor: float) -> None:
        self.packed.dim(factor)
        self.sprites.dim(factor)
        self._show_sprites()


def mark(sprites: SpriteLayer, selected: Iterable[int], pointed: int) -> None:
    """Outline the sprites of selected objects and of the one under the mouse."""
    sprites.choose(frozenset(selected) | ({pointed} - {0}))


def _caster() -> str:
    # Sprites are cast once, in worker threads, which have no GL context.
    return "cpu"
