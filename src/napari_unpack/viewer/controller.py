"""One session on one viewer: three layers, flights, sprites, and everything put back at the end.

What a stage tells those who listen.

A stage steered: its camera set, its unpacking run to any step, its pictures waited for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from time import monotonic, sleep
from typing import Any, Literal

import numpy as np
from psygnal import Signal, SignalGroup
from qtpy.QtCore import QCoreApplication, QEventLoop

from napari_unpack.geometry.view import GRAVITY_UP, Camera
from napari_unpack.layers import compat
from napari_unpack.layers.gl_context import ContextWatch, drawn_anew, guard
from napari_unpack.layers.packed_layer import PackedLayer, dress
from napari_unpack.layers.placement import napari_from_world, placement_of, units_of
from napari_unpack.layers.sprite_layer import SpriteLayer
from napari_unpack.layers.transition_layer import TransitionLayer
from napari_unpack.layers.view_camera import ALIKE, Frame, napari_view, parts_of
from napari_unpack.rendering.cpu import INTERACTIVE_PRIORITY
from napari_unpack.tasks import no_progress
from napari_unpack.viewer.background_queries import AtRest, Prefetch
from napari_unpack.viewer.canvas_backend import BACKENDS
from napari_unpack.viewer.clipping_sync import ClippingSync
from napari_unpack.viewer.interaction import Hands, Pointer
from napari_unpack.viewer.jobs import Jobs
from napari_unpack.viewer.overlays import Overlays
from napari_unpack.viewer.redraw_throttle import RedrawThrottle
from napari_unpack.viewer.scene_renderer import SceneRenderer
from napari_unpack.viewer.slice_sync import SliceHues, SliceSteps
from napari_unpack.viewer.viewer_state import SavedViewerState


class ControllerEvents(SignalGroup):
    """What a stage tells.

    frame: a picture of moving objects was shown. landed: a flight has ended, its object's ID.
    message: a sentence for the user. closed: the stage is off. looking: whether a command
    waits until it is known who is free. drawn: a direction was drawn, or
    that was called off.
    """

    frame = Signal()
    landed = Signal(int)
    message = Signal(str)
    closed = Signal()
    drawn = Signal()
    looking = Signal(bool)


RIGHT_HANDED = ("towards", "down", "right")
LANES = ("moving", "quick", "fine", "rest", "queue")


class SessionController(Hands):
    """A session on a viewer.

    Parameters
    ----------
    viewer : napari.Viewer
        Or the proxy plugins are handed.
    session : Session
        Its `animated` is set while the stage is on.
    sources : sequence of napari layers
        The user's own layers: hidden in 3D while the stage is on, and restored exactly after.

    Attributes
    ----------
    recolor_at_rest : bool
        Choose hues anew when the camera comes to rest.
    fade : HueFade
        The transition to new colours; `allowed` is False for who asks for reduced motion.
    events : ControllerEvents
    around : Session or None
        Of an opened object: the session it is from, whose labels and hues slices show.
    """

    def __init__(self, viewer: Any, session: Any, sources: Sequence[Any] = ()) -> None:
        self.viewer = compat.unwrap(viewer)
        self.session = session
        self.sources = tuple(compat.unwrap(layer) for layer in sources)
        self.recolor_at_rest = True
        self.around: Any = None
        self.events = ControllerEvents()
        self._borrowed: SavedViewerState | None = None
        self._before = False, "auto"
        self._pointed = 0
        self._held: dict[str, Any] | None = None
        box = np.stack([np.zeros(3), np.asarray(session.labels.shape, dtype=float) - 1])
        where = placement_of(self.sources, np.asarray(session.spacing, dtype=np.float64))
        self.packed = PackedLayer("Packed", session.spacing, box, **where)
        self.transition = TransitionLayer("Transition", session.spacing, **where)
        self.sprites = SpriteLayer("Sprites", session.spacing, **where)
        self._jobs = Jobs(LANES, self.events.message.emit)
        self._renderer = SceneRenderer(
            session,
            self.packed,
            self.transition,
            self.sprites,
            self._jobs,
            self.events.frame.emit,
            self.events.landed.emit,
            self.events.message.emit,
        )
        self.fade = self._renderer.bag.fade
        self.overlays = Overlays(session, self._jobs, self.transition.repaint)
        self.transition.overlays = self.overlays.cards_at
        warming = Prefetch(session, self._jobs)
        self._at_rest = AtRest(session, self._jobs, lambda: self.recolor_at_rest, warming.ask)
        self._pointer: Pointer | None = None
        self._slices = SliceHues(session, ())

    @property
    def layers(self) -> tuple[PackedLayer, TransitionLayer, SpriteLayer]:
        """The three layers, as they stand in the list from below."""
        return self.packed, self.transition, self.sprites

    @property
    def is_open(self) -> bool:
        """Whether the stage is on."""
        return self._borrowed is not None

    @property
    def flying(self) -> bool:
        """Whether anything is in the air."""
        return self._renderer.flying

    @property
    def inspected(self) -> int:
        """The object being inspected, 0 for none."""
        return self._renderer.inspected

    @property
    def packed_passes(self) -> int:
        """Castings of the packed picture so far."""
        return self._renderer.bag.passes

    @property
    def backend(self) -> str:
        """Who casts: "cpu", "gl" (shaders, on the canvas), or "auto" (GL on hardware)."""
        return self._renderer.studio.wanted

    @backend.setter
    def backend(self, backend: str) -> None:
        if backend not in BACKENDS:
            raise ValueError(f'backend must be "auto", "cpu" or "gl", got {backend!r}')
        self._renderer.cast_with(backend)

    @property
    def casts_with(self) -> str:
        """Who casts the bag and what moves now, "cpu" or "gl"."""
        return "gl" if self._renderer.studio.active else "cpu"

    @property
    def seconds(self) -> float:
        """Duration of one flight."""
        return float(self.session.seconds)

    @seconds.setter
    def seconds(self, seconds: float) -> None:
        self.session.seconds = float(seconds)

    def open(self) -> None:
        """Put the session on the viewer.

        Raises
        ------
        RuntimeError
            If this napari cannot show our layers.
        """
        if self.is_open:
            return
        if not compat.supported():
            raise RuntimeError(compat.problem())
        viewer = self.viewer
        guard(compat.native_canvas(viewer))
        self._borrowed = SavedViewerState.from_viewer(viewer, self.sources)
        self._before = self.session.animated, self.session.backend
        # The session's questions are answered in threads, where GL has no context.
        self.session.animated, self.session.backend = True, "cpu"
        self._slices = SliceHues(self.around or self.session, self.sources)
        self._slices.paint()
        viewer.dims.ndisplay = 3
        viewer.scene.camera.orientation = RIGHT_HANDED
        self._on_surroundings()
        for layer in self.layers:
            viewer.add_layer(layer)
        viewer.layers.selection.active = self.packed
        self._connect()
        self._renderer.open()
        look_through(viewer, self.session, self.packed)
        self.frame_bag()
        self._on_states()

    def close(self) -> None:
        """Take the session off the viewer and make everything as it was; once is enough."""
        if self._borrowed is None:
            return
        borrowed, self._borrowed = self._borrowed, None
        self._disconnect()
        self._slices.close()
        self._renderer.end_inspection()
        self._renderer.close()
        self.overlays.close()
        self._at_rest.close()
        self._jobs.close()
        self.session.animated, self.session.backend = self._before
        for object_id in list(self.session.flights):
            self.session.land(object_id)
        if compat.native_canvas(self.viewer) is not None:
            # At once, since napari collects all garbage after every removal.
            with self.viewer.layers.batched_update():
                for layer in self.layers:
                    if layer in self.viewer.layers:
                        layer.locked = False
                        self.viewer.layers.remove(layer)
            borrowed.give_back(self.viewer)
        self.events.closed.emit()

    def unpack(self, n_or_ids: int | Iterable[int] = 1) -> Any:
        """Fly free objects out, or these; see `Session.unpack`."""
        self._renderer.end_inspection()
        wanted = int(n_or_ids) if isinstance(n_or_ids, int | np.integer) else tuple(n_or_ids)
        know_who_leaves(self.session, self._jobs, wanted, self.events.looking.emit)
        return self.session.unpack(wanted)

    def restore(self, n_or_ids: int | Iterable[int] = 1) -> Any:
        """Fly objects back, or these; see `Session.restore`."""
        self._renderer.end_inspection()
        return self.session.restore(n_or_ids)

    def go_to(self, step: int, flying: bool = False) -> int:
        """Run the unpacking to a step, at once or flying; see `Session.go_to`."""
        self._renderer.end_inspection()
        if not flying:
            self.finish()
        return run_to(self.session, self._jobs, step, flying, self.events.looking.emit)

    def undo(self) -> Any:
        """Take back the last step, a turn given during an inspection included."""
        self._renderer.end_inspection()
        return travel(self.session, self._jobs, "undo")

    def redo(self) -> Any:
        """Do the step taken back again."""
        self._renderer.end_inspection()
        return travel(self.session, self._jobs, "redo")

    def finish(self) -> None:
        """Land every flight now."""
        for object_id in list(self.session.flights):
            self._renderer.land(object_id)

    def reveal(self, object_id: int, direction: Any = None) -> Any:
        """Fly out what frees a buried object, and it as well; see `Session.reveal`."""
        self._renderer.end_inspection()
        return self.session.reveal(object_id, direction)

    def inspect(self, object_id: int) -> None:
        """Show one object alone, large, to be turned by hand; see `Session.inspect`."""
        if self.inspected != object_id:
            self._renderer.end_inspection()
            self.session.inspect(object_id)

    def leave(self) -> None:
        """Come back from inspection; the sprite becomes what was seen last."""
        self._renderer.leave()

    def frame_bag(self) -> None:
        """Set the viewer's camera so that the bag and all sprites fit beside each other."""
        height, width = self.viewer.canvas.size
        pixels = compat.pixel_scale(self.viewer)
        self.session.canvas_size = max(1, round(height * pixels)), max(1, round(width * pixels))
        point_camera(self.viewer, self.packed, self.session.overview())

    def look_from(self, camera: Camera) -> None:
        """Set the viewer's camera to one of the session's."""
        point_camera(self.viewer, self.packed, camera)

    def step(self, seconds: float = 10.0) -> bool:
        """Show this very moment of the session's clock; for films, whose clock stands still.

        Parameters
        ----------
        seconds : float
            Wait at most so long for the pictures.

        Returns
        -------
        bool
            Whether every picture is right.
        """
        self._renderer.catch_up()
        return self.settle(seconds)

    def settle(self, seconds: float = 10.0) -> bool:
        """Wait until every picture is full and right, handling events meanwhile.

        Parameters
        ----------
        seconds : float
            At most so long.

        Returns
        -------
        bool
            Whether it was reached. Flights in the air are not waited for.
        """
        return wait_until(self._settled, seconds)

    # Wiring.

    def _connect(self) -> None:
        for signal, slot in self._wires():
            signal.connect(slot)
        self.viewer.layers.events.removed.connect(self._on_removed)
        self._stays_open = compat.when_window_closes(self.viewer, self.close)
        followed = self.session if self.around is None else self.around
        self._steps = SliceSteps(self.viewer, followed, self.packed)
        self._pointer = Pointer(self.viewer, self)
        self._cutting = ClippingSync(self.packed, self.session, self.sources, self._at_rest.moved)
        canvas, renderer = compat.native_canvas(self.viewer), self._renderer
        self._context = ContextWatch(canvas, self._on_context_replaced)
        self._pacing = RedrawThrottle(
            canvas, self.packed, lambda: renderer.turning, renderer.bag.look
        )

    def _disconnect(self) -> None:
        self._pacing.close()
        self._context.close()
        self._cutting.close()
        self._steps.close()
        for signal, slot in self._wires():
            signal.disconnect(slot, missing_ok=True)
        self.viewer.layers.events.removed.disconnect(self._on_removed)
        self._stays_open()
        if self._pointer is not None:
            self._pointer.close()
            self._pointer = None

    def _wires(self) -> list[tuple[Any, Any]]:
        events = self.session.events
        return [
            (events.labels, self._renderer.labels_changed),
            (events.labels, self._at_rest.moved),
            (events.states, self._on_states),
            (events.hues, self._on_hues),
            (events.transfer_function, self._on_densities),
            (events.selected, self._mark),
            (events.surroundings, self._on_surroundings),
            (events.queue, self.overlays.changed),
            (self.packed.refused, self._on_refused),
            (self.packed.frame_changed, self._on_frame),
            (self.transition.frame_changed, self._on_other_frame),
            (self.sprites.frame_changed, self._on_other_frame),
        ]

    def _on_frame(self, frame: Frame) -> None:
        if not frame.same_as(self.frame):
            self.session.canvas_size = frame.size
            self.session.look(frame.camera)
            self._renderer.look(frame)
            self.overlays.look(frame)
            self._at_rest.moved()

    def _on_other_frame(self, frame: Frame) -> None:
        # In a grid of views every layer has its own; the bag's is the one that counts.
        if not self.packed.visible:
            self._on_frame(frame)

    def _on_states(self) -> None:
        self._hold_view()
        self._renderer.states_changed()
        self.overlays.changed()
        self._at_rest.moved()

    def _hold_view(self) -> None:
        """Keep the view while an object is studied, and give it back after."""
        studied = any(s.name == "INSPECTED" for s in self.session.states.values())
        camera = self.viewer.scene.camera
        if studied and self._held is None:
            self._held = {name: getattr(camera, name) for name in ("center", "zoom", "angles")}
        elif not studied and self._held is not None:
            camera.update(self._held)
            self._held = None

    def _on_hues(self) -> None:
        self._renderer.hues_changed()
        self._slices.paint()

    def _on_densities(self) -> None:
        self._renderer.densities_changed()
        self.overlays.painter.renew()

    def _on_context_replaced(self) -> None:
        self._renderer.context_replaced()
        self.events.message.emit(drawn_anew(self.viewer, self.layers))

    def _on_refused(self, log: str) -> None:
        self.events.message.emit(f"This graphics driver cannot show pictures in napari ({log}).")

    def _on_surroundings(self) -> None:
        dress(self.viewer, self.session.surroundings)
        self._renderer.surroundings_changed()

    def _on_removed(self, event: Any) -> None:
        if event.value in self.layers:
            self.close()

    def _settled(self) -> bool:
        # What is asked at rest waits until everybody has landed.
        resting = self._at_rest.waiting and not self.flying
        drawn = self._renderer.settled and self.overlays.settled
        return drawn and not (self._jobs.busy or resting)


GLIMPSE_SECONDS = 0.04
"""How long objects are moved one by one before the question goes to a worker."""

IDLE_SECONDS = 0.002

LONGER_SECONDS = 1.0
"""How long a worker goes on so before it asks about everybody."""


def point_camera(viewer: Any, layer: Any, camera: Camera) -> None:
    """Have a viewer look as a camera does.

    Parameters
    ----------
    viewer : napari.Viewer
    layer : napari layer
        One of ours, which knows how world mm lie in napari's world.
    camera : Camera
        Of the session.
    """
    height = viewer.canvas.size[0]
    world = napari_from_world(layer, units_of(viewer))
    center, zoom, direction, up = napari_view(camera, world, height)
    theirs = viewer.scene.camera
    theirs.perspective = camera.fov
    theirs.center = tuple(center)
    theirs.set_view_direction(tuple(direction), tuple(up))
    theirs.zoom = zoom


def look_through(viewer: Any, session: Any, layer: Any) -> None:
    """Have a session look at its bag as a layer places it, and know what is up there.

    Parameters
    ----------
    viewer : napari.Viewer
    session : Session
        It keeps its direction of looking.
    layer : napari layer
        One of ours.
    """
    world = napari_from_world(layer, units_of(viewer))
    # Level things have normals, which an affine maps the other way than points.
    session.away_from_table = world[:3, :3].T @ GRAVITY_UP
    stretch = parts_of(world)[2]
    seen = session.camera
    if not np.allclose(stretch, seen.stretch, rtol=0, atol=ALIKE):
        session.look(
            Camera.looking(seen.direction, seen.up, seen.center, seen.height, seen.fov, stretch)
        )


def wait_until(settled: Callable[[], bool], seconds: float) -> bool:
    """Handle events until something holds, at most so long; return whether it does."""
    limit = monotonic() + seconds
    flags = QEventLoop.ProcessEventsFlag.AllEvents
    while monotonic() < limit:
        QCoreApplication.processEvents(flags, 20)
        if settled():
            # One draw more may still change the frame.
            QCoreApplication.processEvents(flags, 20)
            if settled():
                return True
        # Workers need the interpreter, which an idle loop would hardly let go of.
        sleep(IDLE_SECONDS)
    return False


def know_who_leaves(
    session: Any,
    jobs: Jobs,
    n_or_ids: int | Iterable[int] | None,
    looking: Callable[[bool], None],
) -> None:
    """Find out what it takes to unpack so many or these.

    Parameters
    ----------
    session : Session
    jobs : Jobs
        With the lane "queue".
    n_or_ids : int or iterable of int or None
        See `Session.unpack`; None asks for the whole answer.
    looking : callable
        Told True when it takes longer than a moment, and False after.

    Notes
    -----
    At once where moving a few objects tells; the whole answer is then asked for when everything
    is at rest. Else that answer is waited for, drawing meanwhile.
    """
    queries = session.queries
    quick = None if n_or_ids is None else queries.next_unpackable_task(n_or_ids, GLIMPSE_SECONDS)
    if quick is not None:
        with INTERACTIVE_PRIORITY.taken():
            found = quick.run(no_progress)
        if queries.store(quick, found):
            return
    if queries.occlusion_task() is None:
        return
    looking(True)
    try:
        if quick is not None:
            longer = queries.next_unpackable_task(n_or_ids, LONGER_SECONDS)
            run = partial(longer.run, no_progress)
            if queries.store(longer, jobs.do("queue", "glimpse", run)):
                return
        # What was asked at rest may be the same.
        jobs.wait("queue")
        whole = queries.occlusion_task()
        if whole is not None:
            queries.store(whole, jobs.do("queue", "queue", partial(whole.run, no_progress)))
    finally:
        looking(False)


def travel(session: Any, jobs: Jobs, way: Literal["undo", "redo"]) -> Any:
    """Go a step back or forth; labels that take a while are worked out in a worker, drawing on.

    Parameters
    ----------
    session : Session
    jobs : Jobs
        With the lane "queue".
    way : {"undo", "redo"}

    Returns
    -------
    str or None
        See `Session.undo`.
    """
    task = session.queries.labels_task(way)
    if task is not None:
        run = partial(task.run, no_progress)
        session.queries.store(task, jobs.do("queue", "labels", run))
    return getattr(session, way)()


def run_to(
    session: Any, jobs: Jobs, step: int, flying: bool, looking: Callable[[bool], None]
) -> int:
    """Run the unpacking to a step; see `Session.go_to`.

    Parameters
    ----------
    session : Session
    jobs : Jobs
        With the lane "queue".
    step : int
    flying : bool
        Whether objects fly there; else they are there at once.
    looking : callable
        See `know_who_leaves`.

    Returns
    -------
    int
        The step reached.
    """
    if step > len(session.steps):
        one_more = step == session.step + 1
        know_who_leaves(session, jobs, 1 if one_more else None, looking)
    animated = session.animated
    session.animated = animated and flying
    try:
        return int(session.go_to(step))
    finally:
        session.animated = animated
