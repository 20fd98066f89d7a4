"""What the three layers show: their renderers, flights and inspection brought together."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from napari_unpack.geometry.axes import Matrix
from napari_unpack.layers.packed_layer import Backdrop, PackedLayer
from napari_unpack.layers.rendered_image import CanvasImage, RenderedImage
from napari_unpack.layers.sprite_layer import SpriteLayer
from napari_unpack.layers.transition_layer import TransitionLayer
from napari_unpack.layers.view_camera import Frame
from napari_unpack.session.object_state import ObjectState, ids_in
from napari_unpack.viewer.animation import Animator, Glides
from napari_unpack.viewer.canvas_backend import CanvasBackend
from napari_unpack.viewer.driver_probe import probe_driver
from napari_unpack.viewer.held_objects import HeldObjects
from napari_unpack.viewer.layer_tables import ObjectTable
from napari_unpack.viewer.packed_renderer import PackedRenderer
from napari_unpack.viewer.picking import ScenePicker
from napari_unpack.viewer.scheduler import Scheduler
from napari_unpack.viewer.sprite_renderer import SpriteRenderer
from napari_unpack.viewer.transition_renderer import TransitionRenderer
from napari_unpack.viewer.volume_upload import VolumeUpload

if TYPE_CHECKING:
    from napari_unpack.session import Session

# Opacity of everything else during an inspection: still seen, but not in the way.
DIMMED = 0.16


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
    held : HeldObjects
        Objects under the hand.
    picker : ScenePicker
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
        packed.table = ObjectTable(session, lambda: session.scene().packed)
        transition.table = ObjectTable(session, lambda: session.flights)
        sprites.table = ObjectTable(session, lambda: session.poses)
        self.frame: Frame | None = None
        self._drawn, self._landed = drawn, landed
        self._ticked = -1.0
        self._scheduler, self._failed = scheduler, failed
        self.canvas_backend = canvas = CanvasBackend(session, self._gl_failed, failed, self._probe)
        self.packed_renderer = bag = PackedRenderer(session, scheduler, packed, canvas)
        self._upload = VolumeUpload(canvas, scheduler, packed, self._backend_changed, bag)
        self.transition_renderer = TransitionRenderer(session, scheduler, self._show_moving, canvas)
        self.sprite_renderer = SpriteRenderer(session, scheduler, sprites.show)
        self.held = HeldObjects(self)
        self.picker = ScenePicker(self)
        self.animator = Animator(session, self.sprite_renderer.has, lambda _: bag.settled)

        def clock() -> float:
            # Asked anew each time: a film exchanges the session's clock for one it steps itself.
            return session.clock()

        self.glides = Glides(scheduler, self.show_sprites, lambda: bag.fade.allowed, clock)
        self.flight_animation = scheduler.animate(self._tick, clock)

    @property
    def settled(self) -> bool:
        """Whether every image at rest is full and right."""
        images = self.packed_renderer.settled and self.sprite_renderer.settled
        # What has landed stays in the transition layer for some ticks more.
        landing = self.flight_animation.running and not self.animator.flying
        # What glides is waited for as what flies is: a film may hold both on their way.
        still = self.glides.settled or self.animator.flying
        return images and still and not (self._upload.busy or landing)

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
        self._upload.make_ready(self.session.scene())

    def cast_with(self, backend: str) -> None:
        """Choose what casts, "auto", "cpu" or "gl"."""
        before, self.canvas_backend.wanted = self.canvas_backend.active, backend
        self.canvas_backend.prove()
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
        now = self.flight_animation.now()
        self.animator.view_changed(now)
        if self.animator.active(now):
            self.flight_animation.start()
        self.draw_moving()
        self.show_sprites()

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
        # What flies first: it answers the click.
        self.draw_moving()
        self.packed_renderer.set_scene(self.session.scene())
        self.show_sprites()
        if self.animator.active(self.flight_animation.now()):
            self.flight_animation.start()

    def labels_changed(self) -> None:
        """Follow the session's labels, which were repaired."""
        self._follow_inspection()
        scene = self.session.scene()
        self.packed_renderer.set_scene(scene)
        self._upload.make_ready(scene, relabelled=True)
        self.show_sprites()

    def hues_changed(self) -> None:
        """Follow the session's hues."""
        self.packed_renderer.set_scene(self.session.scene())
        self.show_sprites()

    def transfer_function_changed(self) -> None:
        """Follow the session's transfer function."""
        self.packed_renderer.set_scene(self.session.scene())
        self.sprite_renderer.appearance_changed()
        self.show_sprites()

    def decorations_changed(self) -> None:
        """Follow the session's background and box."""
        around = self.session.decorations
        if self.packed.backdrop is None:
            self.packed.backdrop = Backdrop(self.session.bag.lower, self.session.bag.upper)
        self.packed.backdrop.show(around)
        self.sprites.on_light(around.background.is_light)
        self.packed.repaint()

    def catch_up(self) -> None:
        """Do what the next tick would do, and tick no more by itself."""
        one, now = self.animator.inspection, self.flight_animation.now()
        if one is not None and one.leaving and now <= one.since:
            # Of a clock that stands still: no tick comes that would end it later.
            self.end_inspection()
        self._tick(now)
        self.flight_animation.stop()

    def land(self, object_id: int) -> None:
        """End a flight."""
        flight = self.session.flights.get(object_id)
        if flight is not None:
            # Where nothing is drawn, nothing is waited for.
            if self.frame is not None:
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
        if one.home is None:
            # Until the image of the bag shows it again.
            self.animator.landed(one.object_id, None)
        self.session.leave()
        if pose is None:
            return
        if np.array_equal(one.rotation, pose.rotation):
            # An object that was only looked at has not been moved: nothing to undo.
            self.animator.landed(one.object_id, pose)
            self.show_sprites()
        else:
            self.hold(one.object_id, one.rotation)

    def rotation_of(self, object_id: int) -> Matrix:
        """Return how an object is held now, (3, 3) from world axes to pivot axes."""
        one = self.animator.inspection
        if one is not None and one.object_id == object_id and one.home is not None:
            return one.rotation
        pose = self.session.poses.get(object_id)
        camera: Matrix = self.session.camera.rotation
        return camera if pose is None else pose.rotation

    def close(self) -> None:
        """Show nothing new."""
        self.flight_animation.stop()
        self.glides.close()
        self._upload.close()
        self.packed_renderer.close()
        self.canvas_backend.close()
        # Who still holds a layer would hold the session, and its image on the graphics card too.
        for layer in (self.packed, self.transition, self.sprites):
            layer.table = None
        self.packed.show(None, with_thumbnail=False)
        self.frame = None

    def _follow_inspection(self) -> None:
        """Begin or end showing an object alone, as the session says."""
        wanted = next(iter(ids_in(self.session.states, ObjectState.INSPECTED)), 0)
        one = self.animator.inspection
        if self.frame is None or (0 if one is None else one.object_id) == wanted:
            return
        self.animator.inspection = None
        if wanted:
            self.animator.begin_inspection(wanted, self.frame, self.flight_animation.now())
        dimming = DIMMED if wanted else 1.0
        self.packed.dim(dimming)
        self.sprites.dim(dimming)
        self.show_sprites()
        self.flight_animation.start()

    def hold(self, object_id: int, rotation: Matrix) -> None:
        """Give an object the turn it has in the transition layer.

        Parameters
        ----------
        object_id : int
        rotation : (3, 3) ndarray of float64
            From world axes to pivot axes.
        """
        self.animator.landed(object_id, self.session.pose_turned(object_id, rotation))
        self.session.turn(object_id, rotation)
        self.show_sprites()

    def _tick(self, now: float) -> None:
        for object_id in self.animator.arrivals(now):
            self.land(object_id)
        one = self.animator.inspection
        if one is not None and one.leaving and one.still(now):
            self.end_inspection()
        active = self.animator.active(now)
        # One at a time, or the worker would fall behind the flight. A film's clock stands still.
        stands = now == self._ticked and self.animator.flying and not self.animator.landing
        if not (stands or self.transition_renderer.busy):
            self._ticked = now
            self.draw_moving()
        if not active:
            self.flight_animation.stop()
            self.draw_moving()

    def draw_moving(self) -> None:
        """Ask for an image of what moves as it is now."""
        if self.frame is not None:
            moving = self.animator.moving(self.flight_animation.now(), self.frame)
            # An image still being cast must not appear once nothing moves any more.
            if moving or self.transition.images or self.transition_renderer.busy:
                self.transition_renderer.cast(moving, self.frame)

    def _backend_changed(self, before: bool) -> None:
        if self.canvas_backend.active != before:
            self.packed_renderer.backend_changed()
            self.draw_moving()

    def _probe(self, driver: str, answered: Callable[[str], None]) -> None:
        def tried(reason: str) -> None:
            before = self.canvas_backend.active
            answered(reason)
            self._backend_changed(before)
            self._upload.resume()

        probe_driver(driver, self._scheduler, tried)

    def _gl_failed(self, words: str) -> None:
        # The canvas is being drawn: what follows waits until it is done.
        self._scheduler.soon(lambda: self._backend_changed(True))
        self._failed(words)

    def _show_moving(self, images: Mapping[int, RenderedImage | CanvasImage]) -> None:
        self.transition.show(images)
        self.show_sprites()
        self._drawn()

    def show_sprites(self) -> None:
        """Show the sprites where they are now, and ask for those that are missing."""
        frame, session = self.frame, self.session
        if frame is None:
            return
        hidden = session.state.hidden
        poses = {i: pose for i, pose in session.poses.items() if i not in hidden}
        poses |= {i: pose for i, pose in self.animator.carried.items() if i in poses}
        # Slots planned anew are glided to; a sprite under the hand is where the hand is.
        gliding = self.glides.follow(poses, session.slots)
        waiting = frozenset(poses)
        for object_id, flight in session.flights.items():
            poses.setdefault(object_id, flight.target)
        # The transition layer shows what moves, from the moment its image is there.
        moving = frozenset(session.flights) | frozenset(self.animator.turning)
        if self.animator.inspection is not None:
            moving |= {self.animator.inspection.object_id}
        shown = waiting - (moving & frozenset(self.transition.images))
        self.sprite_renderer.want(poses, shown, frame.size[0] / frame.camera.height, gliding)
