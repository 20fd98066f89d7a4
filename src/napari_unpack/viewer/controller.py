"""One session in one viewer: opened, wired, and everything put back at the end."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from time import monotonic, sleep
from typing import TYPE_CHECKING

import numpy as np
from napari.layers import Layer
from psygnal import Signal, SignalGroup
from qtpy.QtCore import QCoreApplication, QEventLoop

from napari_unpack.geometry.axes import Matrix, Vector
from napari_unpack.geometry.standard_views import Side, bag_axes, seen_along, seen_from, upright
from napari_unpack.geometry.view import Camera
from napari_unpack.layers import compat
from napari_unpack.layers.packed_layer import PackedLayer
from napari_unpack.layers.placement import placement_of
from napari_unpack.layers.sprite_layer import SpriteLayer
from napari_unpack.layers.transition_layer import TransitionLayer
from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.backends import checked_backend
from napari_unpack.rendering.gl.depth_quads import Quad
from napari_unpack.tasks import Task
from napari_unpack.viewer.animation import HueFade
from napari_unpack.viewer.background_queries import BackgroundQueries
from napari_unpack.viewer.camera_sync import follow_placement
from napari_unpack.viewer.connections import ControllerConnections
from napari_unpack.viewer.cut_handle import CutHandle
from napari_unpack.viewer.framing import Framing
from napari_unpack.viewer.interaction import Interaction
from napari_unpack.viewer.modal_queries import (
    choose_hues,
    find_unpackable,
    measure_next,
    run_to,
    travel,
)
from napari_unpack.viewer.overlays import Overlays
from napari_unpack.viewer.process_end import end_with_process
from napari_unpack.viewer.ruler_drawing import RulerDrawing
from napari_unpack.viewer.scene_renderer import SceneRenderer
from napari_unpack.viewer.scheduler import Scheduler, Worker
from napari_unpack.viewer.slice_sync import SliceHues, SliceSteps
from napari_unpack.viewer.sprite_names import SpriteNames
from napari_unpack.viewer.viewer_state import SavedViewerState, to_the_end

if TYPE_CHECKING:
    import napari

    from napari_unpack.session import Session
    from napari_unpack.session.state import Group

RIGHT_HANDED = ("towards", "down", "right")

# What `settle` sleeps between looks: workers need the interpreter meanwhile.
IDLE_SECONDS = 0.002


class ControllerEvents(SignalGroup):
    """What a controller tells.

    frame: an image of moving objects was shown. landed: a flight has ended, its object's ID.
    message: a sentence for the user. closed: the session is off the viewer. searching: whether a
    command waits until it is known what can leave. unpackable: a frozenset of the IDs that can
    leave now, or None as soon as that is out of date. direction_drawn: a direction was drawn, or
    that was called off. rescaled: the voxels of the user's layer have another size than the
    session's.
    """

    frame = Signal()
    landed = Signal(int)
    message = Signal(str)
    closed = Signal()
    direction_drawn = Signal()
    rescaled = Signal()
    searching = Signal(bool)
    unpackable = Signal(object)


class SessionController:
    """A session on a viewer.

    Parameters
    ----------
    viewer : napari.Viewer
        Or the proxy plugins are handed.
    session : Session
        Its `animated` is set while it is open.
    sources : sequence of napari layers
        The user's own layers that it is of: hidden in 3D while it is open, Labels shown in its
        hues, and restored exactly after.
    scheduler : Scheduler, optional
        Of the panel that opens it; by default one of its own.

    Attributes
    ----------
    recolor_at_rest : bool
        Choose hues anew when the camera comes to rest.
    events : ControllerEvents
    layer_removed : callable or None
        Called when the user removes one of the three layers; None closes the session.
    outer_session : Session or None
        Of an opened container: the session it is from, whose labels and hues slices show.
    viewer : napari.Viewer
        Never its proxy.
    session : Session
    packed, transition, sprites
        The three layers.
    renderer : SceneRenderer
    overlays : Overlays
    names : SpriteNames
    rulers : RulerDrawing
    cut_handle : CutHandle
    interaction : Interaction
    scheduler : Scheduler
        Its own, or a scope of the panel's.
    queries : BackgroundQueries
    framing : Framing
    slice_hues : SliceHues
    slice_steps : SliceSteps
        While it is open.
    """

    def __init__(
        self,
        viewer: napari.Viewer,
        session: Session,
        sources: Sequence[Layer] = (),
        scheduler: Scheduler | None = None,
    ) -> None:
        self.viewer: napari.Viewer = compat.unwrap(viewer)
        self.session = session
        self.sources: tuple[Layer, ...] = tuple(compat.unwrap(layer) for layer in sources)
        self.recolor_at_rest = True
        self.outer_session: Session | None = None
        self.layer_removed: Callable[[], None] | None = None
        self.events = ControllerEvents()
        self._saved: SavedViewerState | None = None
        self._before = False, "auto"
        box = np.stack([np.zeros(3), np.asarray(session.labels.shape, dtype=float) - 1])
        where = placement_of(self.sources, session.spacing)
        self.packed = PackedLayer("Packed", session.spacing, box, **where)
        self.transition = TransitionLayer("Transition", session.spacing, **where)
        self.sprites = SpriteLayer("Sprites", session.spacing, **where)
        failed = self.events.message.emit
        self.scheduler = Scheduler(failed) if scheduler is None else scheduler.scope(failed)
        self.renderer = SceneRenderer(
            session,
            self.packed,
            self.transition,
            self.sprites,
            self.scheduler,
            self.events.frame.emit,
            self.events.landed.emit,
            self.events.message.emit,
        )
        repaint, shows = self.transition.repaint, self.packed.shows
        self.overlays = Overlays(session, self.scheduler, repaint, shows)
        for layer in (self.packed, self.transition):
            layer.overlays = partial(_drawn_over, self, layer)
        scale = self.pixel_scale
        self.names = SpriteNames(session, self.sprites, scale, repaint)
        self.rulers = RulerDrawing(self, scale, repaint)
        self.transition.slice_overlays = self.rulers.slice_quads_at
        self.cut_handle = CutHandle(session, scale, repaint)
        self.overlays.drawings += [self.cut_handle, self.names, self.rulers]
        self.queries = BackgroundQueries(
            session,
            self.scheduler,
            lambda: self.recolor_at_rest,
            self.events.unpackable.emit,
        )
        handle = self.cut_handle.points
        self.framing = Framing(
            self.viewer, session, self.packed, self.renderer, self.scheduler, handle
        )
        self.interaction = Interaction(self)
        self.slice_hues = SliceHues(session, ())
        self.slice_steps: SliceSteps | None = None
        self._connections = ControllerConnections(self)

    @property
    def layers(self) -> tuple[PackedLayer, TransitionLayer, SpriteLayer]:
        """The three layers, as they stand in the list from below."""
        return self.packed, self.transition, self.sprites

    @property
    def is_open(self) -> bool:
        """Whether the session is on the viewer."""
        return self._saved is not None

    @property
    def frame(self) -> Frame | None:
        """What the canvas showed last."""
        return self.renderer.frame

    @property
    def flying(self) -> bool:
        """Whether anything is in the air."""
        return self.renderer.animator.flying

    @property
    def inspected(self) -> int:
        """The object being inspected, 0 for none."""
        return self.renderer.inspected

    @property
    def fade(self) -> HueFade:
        """The transition to new colours; `allowed` is False for reduced motion."""
        return self.renderer.packed_renderer.fade

    @property
    def backend(self) -> str:
        """What casts: "cpu", "gl" (shaders, on the canvas), or "auto" (GL on hardware)."""
        return self.renderer.canvas_backend.wanted

    @backend.setter
    def backend(self, backend: str) -> None:
        """Choose what casts.

        Raises
        ------
        ValueError
            If there is no such backend.
        """
        self.renderer.cast_with(checked_backend(backend))

    @property
    def casts_with(self) -> str:
        """What casts the bag and what moves now, "cpu" or "gl"."""
        return "gl" if self.renderer.canvas_backend.active else "cpu"

    @property
    def seconds(self) -> float:
        """Duration of one flight."""
        return float(self.session.seconds)

    @seconds.setter
    def seconds(self, seconds: float) -> None:
        self.session.seconds = float(seconds)

    # Lifetime.

    def open(self) -> None:
        """Put the session on the viewer.

        Raises
        ------
        RuntimeError
            If this napari cannot show our layers, or it was closed: that is for good.
        """
        if self.is_open:
            return
        if self.scheduler.closed:
            raise RuntimeError("A closed SessionController stays closed: make another")
        if compat.problem():
            raise RuntimeError(compat.problem())
        viewer, session = self.viewer, self.session
        compat.finish_in_own_context(compat.native_canvas(viewer))
        self._saved = SavedViewerState.from_viewer(viewer, self.sources, self.packed)
        self._before = session.animated, session.backend
        # The session's tasks run in threads, where GL has no context.
        session.animated, session.backend = True, "cpu"
        session.queries.asks_at_rest = True
        self.slice_hues = SliceHues(self.outer_session or session, self.sources)
        self.slice_hues.paint()
        viewer.dims.ndisplay = 3
        viewer.scene.camera.orientation = RIGHT_HANDED
        end_with_process(self.close)
        self._connections.decorate()
        with compat.clash_told(viewer):
            for layer in self.layers:
                viewer.add_layer(layer)
        # napari shows the controls and the status of the active layer.
        viewer.layers.selection.active = self.packed
        self._connections.open()
        self.renderer.open()
        # Only now: the units of napari's world are the finest of all layers'.
        follow_placement(viewer, session, self.packed)
        self.frame_bag()
        self._connections.follow_states()

    def close(self) -> None:
        """Take the session off the viewer and make everything as it was; once is enough."""
        if self._saved is None:
            return
        saved, self._saved = self._saved, None
        to_the_end(
            self._connections.close,
            self.slice_hues.close,
            # Its turn is kept: it is a step of the session.
            self.renderer.end_inspection,
            self.renderer.close,
            self.overlays.close,
            self.scheduler.close,
            partial(_let_go, self.session, self._before),
            partial(_leave, self.viewer, saved, self.layers),
            self.events.closed.emit,
        )

    # Commands.

    def unpack(self, n_or_ids: int | Iterable[int] = 1) -> Group:
        """Fly unpackable objects out, or these; see `Session.unpack`."""
        self.renderer.end_inspection()
        wanted = int(n_or_ids) if isinstance(n_or_ids, int | np.integer) else tuple(n_or_ids)
        searching = self.events.searching.emit
        # A window closed in the wait would freeze: the session would cast all rays at once.
        if not find_unpackable(self.session, self.scheduler, wanted, searching):
            return ()
        if not measure_next(self.session, self.scheduler, wanted):
            return ()
        return self.session.unpack(wanted)

    def restore(self, n_or_ids: int | Iterable[int] = 1) -> Group:
        """Fly objects back, or these; see `Session.restore`."""
        self.renderer.end_inspection()
        return self.session.restore(n_or_ids)

    def reveal(
        self, object_id: int, direction: str | Sequence[float] | Vector | None = None
    ) -> Group:
        """Fly out what frees a buried object, and it as well.

        Parameters
        ----------
        object_id, direction
            As for `Session.reveal`.
        """
        self.renderer.end_inspection()
        return self.session.reveal(object_id, direction)

    def go_to(self, step: int, flying: bool = False) -> int:
        """Run the unpacking to a step; see `Session.go_to`.

        Parameters
        ----------
        step : int
        flying : bool, optional
            Whether objects fly there; else they are there at once.
        """
        self.renderer.end_inspection()
        if not flying:
            # What is in the air belongs to the step before.
            self.finish()
        searching = self.events.searching.emit
        return run_to(self.session, self.scheduler, step, flying, searching)

    def undo(self) -> str | None:
        """Take back the last step, a turn given during an inspection included."""
        self.renderer.end_inspection()
        return travel(self.session, self.scheduler, "undo")

    def redo(self) -> str | None:
        """Do the step taken back again."""
        self.renderer.end_inspection()
        return travel(self.session, self.scheduler, "redo")

    def recolor(self) -> None:
        """Choose new hues for this view."""
        choose_hues(self.session, self.scheduler)

    def finish(self) -> None:
        """Land every flight now."""
        for object_id in list(self.session.flights):
            self.renderer.land(object_id)
        self.framing.catch_up(finish=True)

    def inspect(self, object_id: int) -> None:
        """Show one object alone, large, to be turned by hand; see `Session.inspect`."""
        # Else an object inspected already would leave and come again.
        if self.inspected != object_id:
            self.renderer.end_inspection()
            self.session.inspect(object_id)

    def leave(self) -> None:
        """Come back from inspection; the sprite becomes what was seen last."""
        self.renderer.leave()
        self.framing.leave_inspection()

    def rotation_of(self, object_id: int) -> Matrix:
        """Return how an object is held now, (3, 3) from world axes to pivot axes."""
        return self.renderer.rotation_of(object_id)

    # Camera and waiting.

    def frame_bag(self) -> None:
        """Bring the bag and what is out of it into the window, at once."""
        self.framing.fit(glides=False, camera=self.session.camera)

    def look_from(self, camera: Camera, window: tuple[int, int] | None = None) -> None:
        """Set the viewer's camera to one of the session's.

        Parameters
        ----------
        camera, window
            As for `Framing.look_from`.
        """
        self.framing.look_from(camera, window)

    def look_from_side(self, side: Side | None) -> None:
        """Glide to a view from one side of the bag; None looks against the direction of unpacking.

        Parameters
        ----------
        side : Side or None
        """
        session = self.session

        def turn(up: Vector) -> None:
            stretch = session.camera.stretch
            axes = bag_axes(upright(up, session.away_from_table), stretch)
            if side is not None:
                self.framing.turn_to(seen_from(side, axes))
            else:
                self.framing.turn_to(seen_along(stretch @ session.unpack_direction, axes))

        # In a worker: the first time it looks through the whole volume.
        task = Task("the bag's up", lambda _: session.queries.bag_up())
        self.scheduler.submit(task, Worker.QUERY, turn)

    def step(self, seconds: float = 10.0) -> bool:
        """Show this very moment of the session's clock; for films, whose clock stands still.

        Parameters
        ----------
        seconds : float
            Wait at most so long for the images.

        Returns
        -------
        bool
            Whether every image is right.
        """
        self.renderer.catch_up()
        # A clock that stands still ends no glide, and only flights are waited for.
        if not self.flying:
            self.renderer.glides.finish()
        self.framing.catch_up(finish=not self.flying)
        return self.settle(seconds)

    def settle(self, seconds: float = 10.0) -> bool:
        """Wait until every image is full and right, handling events meanwhile.

        Parameters
        ----------
        seconds : float
            At most so long.

        Returns
        -------
        bool
            Whether it was reached. Flights in the air are not waited for.
        """
        limit = monotonic() + seconds
        flags = QEventLoop.ProcessEventsFlag.AllEvents
        while monotonic() < limit:
            QCoreApplication.processEvents(flags, 20)
            if self._settled():
                # One draw more may still change the frame.
                QCoreApplication.processEvents(flags, 20)
                if self._settled():
                    return True
            sleep(IDLE_SECONDS)
        return False

    def pixel_scale(self) -> float:
        """Return the device pixels of a logical pixel of the canvas."""
        return compat.pixel_scale(self.viewer)

    def _settled(self) -> bool:
        # Queries wait until every flight has landed.
        pending = self.queries.pending and not self.flying
        # So does the camera, which a film may hold in the middle of a flight.
        still = self.framing.settled or self.flying
        drawn = still and self.renderer.settled and self.overlays.settled
        return drawn and not (self.scheduler.busy or pending)


def _drawn_over(
    one: SessionController, layer: PackedLayer | TransitionLayer, frame: Frame
) -> Sequence[Quad]:
    """Return what is drawn over the bag, once: with its own layer where that stands apart."""
    # In napari's grid every layer has a view of its own.
    apart = one.viewer.canvas.grid.enabled and one.packed.visible
    return one.overlays.quads_at(frame) if apart == (layer is one.packed) else ()


def _let_go(session: Session, before: tuple[bool, str]) -> None:
    session.animated, session.backend = before
    session.queries.asks_at_rest = False
    to_the_end(*(partial(session.land, object_id) for object_id in session.flights))


def _leave(viewer: napari.Viewer, saved: SavedViewerState, layers: Sequence[Layer]) -> None:
    if compat.native_canvas(viewer) is not None:
        to_the_end(partial(_remove, viewer, layers), partial(saved.give_back, viewer))


def _remove(viewer: napari.Viewer, layers: Sequence[Layer]) -> None:
    there = [layer for layer in layers if layer in viewer.layers]
    for layer in there:
        layer.locked = False
    # At once, since napari collects all garbage after every removal.
    with compat.clash_told(viewer), viewer.layers.batched_update():
        to_the_end(*(partial(viewer.layers.remove, layer) for layer in there))
