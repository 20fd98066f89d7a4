"""One session on one viewer: three layers, flights, sprites, and everything put back at the end."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from time import monotonic
from typing import Any

import numpy as np
from numpy.typing import NDArray
from psygnal import Signal, SignalGroup
from qtpy.QtCore import QCoreApplication, QEventLoop

from napari_unpack.geometry.axes import Matrix
from napari_unpack.layers import compat
from napari_unpack.layers.at_rest import AtRest
from napari_unpack.layers.clock import Clock
from napari_unpack.layers.director import Director
from napari_unpack.layers.flight_painter import FlightPainter
from napari_unpack.layers.guest import Borrowed
from napari_unpack.layers.jobs import Jobs
from napari_unpack.layers.packed import PackedLayer
from napari_unpack.layers.packed_painter import PackedPainter
from napari_unpack.layers.picking import pick_packed
from napari_unpack.layers.placement import napari_from_world, placement_of
from napari_unpack.layers.pointer import Pointer
from napari_unpack.layers.shots import Shot
from napari_unpack.layers.sprite_painter import SpritePainter
from napari_unpack.layers.sprites import SpriteLayer
from napari_unpack.layers.tables import set_table
from napari_unpack.layers.transition import TransitionLayer
from napari_unpack.layers.view_camera import Frame, napari_view
from napari_unpack.session.pictures import BACKGROUND

DIMMED = 0.16
RIGHT_HANDED = ("towards", "down", "right")
LANES = ("quick", "fine", "rest")


class StageEvents(SignalGroup):
    """What a stage tells.

    frame: a picture of moving objects was shown. landed: a flight has ended, its object's ID.
    message: a sentence for the user. closed: the stage is off.
    """

    frame = Signal()
    landed = Signal(int)
    message = Signal(str)
    closed = Signal()


class Stage:
    """A session on a viewer.

    Parameters
    ----------
    viewer : napari.Viewer
        Or the proxy plugins are handed.
    session : Session
        Its `animated` is set while the stage is on.
    sources : sequence of napari layers
        The user's own layers: hidden while the stage is on, and restored exactly after.

    Attributes
    ----------
    backend : {"auto", "cpu", "gl"}
        Who casts. "auto" is GL on graphics hardware, else the CPU.
    seconds : float
        Duration of one flight.
    recolor_at_rest : bool
        Choose hues anew when the camera comes to rest.
    events : StageEvents
    """

    def __init__(self, viewer: Any, session: Any, sources: Sequence[Any] = ()) -> None:
        self.viewer = compat.unwrap(viewer)
        self.session = session
        self.sources = tuple(compat.unwrap(layer) for layer in sources)
        self.backend, self.recolor_at_rest = "auto", True
        self.events = StageEvents()
        self._borrowed: Borrowed | None = None
        self._frame: Frame | None = None
        self._packed_ids: frozenset[int] = frozenset()
        self._pointed = 0
        box = np.stack([np.zeros(3), np.asarray(session.labels.shape, dtype=float) - 1])
        where = placement_of(self.sources, np.asarray(session.spacing, dtype=np.float64))
        self.packed = PackedLayer("Packed", session.spacing, box, **where)
        self.transition = TransitionLayer("Transition", session.spacing, **where)
        self.sprites = SpriteLayer("Sprites", session.spacing, **where)
        self._jobs = Jobs(LANES, self.events.message.emit)
        self._packed_painter = PackedPainter(session, self._jobs, self._show_packed, self._caster)
        self._flight_painter = FlightPainter(session, self._jobs, self._show_moving, self._caster)
        self._sprite_painter = SpritePainter(session, self._jobs, self.sprites.show, self._caster)
        self._director = Director(
            session, self._sprite_painter.has, lambda _: self._packed_painter.settled
        )
        self._clock = Clock(self._tick)
        self._at_rest = AtRest(session, self._jobs, self._after_rest)
        self._pointer: Pointer | None = None

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
        return self._director.flying

    @property
    def inspected(self) -> int:
        """The object being inspected, 0 for none."""
        one = self._director.inspection
        return 0 if one is None or one.leaving else one.object_id

    @property
    def frame(self) -> Frame | None:
        """What the canvas showed last."""
        return self._frame

    @property
    def packed_passes(self) -> int:
        """Castings of the packed picture so far."""
        return self._packed_painter.passes

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
        self._borrowed = Borrowed.from_viewer(viewer, self.sources)
        self.session.animated = True
        for layer in self.sources:
            layer.visible = False
        viewer.dims.ndisplay = 3
        viewer.scene.camera.orientation = RIGHT_HANDED
        viewer.canvas.background_color_override = (*BACKGROUND, 1.0)
        for layer in self.layers:
            viewer.add_layer(layer)
            layer.frame_changed.connect(self._on_frame)
        viewer.layers.selection.active = self.packed
        self._connect()
        self.frame_bag()
        self._on_states(frozenset(self.session.states))

    def close(self) -> None:
        """Take the session off the viewer and make everything as it was; once is enough."""
        if self._borrowed is None:
            return
        borrowed, self._borrowed = self._borrowed, None
        self._disconnect()
        self._clock.stop()
        self._at_rest.close()
        self._packed_painter.close()
        self._jobs.close()
        self.session.animated = False
        self.session.land_all()
        if compat.native_canvas(self.viewer) is not None:
            for layer in self.layers:
                if layer in self.viewer.layers:
                    layer.locked = False
                    self.viewer.layers.remove(layer)
            borrowed.give_back(self.viewer)
        self.events.closed.emit()

    def unpack(self, n_or_ids: int | Iterable[int] = 1) -> list[int]:
        """Fly free objects out, or these; see `Session.unpack`."""
        self._finish_inspection()
        ids: list[int] = self.session.unpack(n_or_ids)
        return ids

    def restore(self, n_or_ids: int | Iterable[int] = 1) -> list[int]:
        """Fly objects back, or these; see `Session.restore`."""
        self._finish_inspection()
        ids: list[int] = self.session.restore(n_or_ids)
        return ids

    def finish(self) -> None:
        """Land every flight now."""
        for object_id in list(self.session.flights):
            self._land(object_id)

    def inspect(self, object_id: int) -> None:
        """Show one object alone, large, to be turned by hand; see `Session.inspect`."""
        if self._frame is None or self.inspected == object_id:
            return
        self._finish_inspection()
        self.session.inspect(object_id)
        self._director.begin_inspection(object_id, self._frame, self._clock.now())
        self._dim(DIMMED)
        self._clock.start()

    def leave(self) -> None:
        """Come back from inspection; the sprite becomes what was seen last."""
        one = self._director.inspection
        if one is not None and not one.leaving:
            self._director.inspection = one.left(self._clock.now())
            self._clock.start()

    def frame_bag(self) -> None:
        """Set the viewer's camera so that the bag and all sprites fit beside each other."""
        height, width = self.viewer.canvas.size
        camera = self.session.framed_camera((int(height), int(width)))
        center, zoom, direction, up = napari_view(camera, napari_from_world(self.packed), height)
        napari_camera = self.viewer.scene.camera
        napari_camera.perspective = camera.fov
        napari_camera.center = tuple(center)
        napari_camera.set_view_direction(tuple(direction), tuple(up))
        napari_camera.zoom = zoom

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
        limit = monotonic() + seconds
        flags = QEventLoop.ProcessEventsFlag.AllEvents
        while monotonic() < limit:
            QCoreApplication.processEvents(flags, 20)
            if self._settled():
                QCoreApplication.processEvents(flags, 20)
                return self._settled()
        return False

    # What the pointer asks for.

    def sprite_at(self, pixel: NDArray[np.float64]) -> int:
        """Return the object whose sprite is at a pixel of the canvas (row, column), or 0."""
        if self._frame is None or not self.sprites.visible:
            return 0
        row, col = self._device(pixel)
        return self.sprites.at_pixel(row, col, self._frame.size, self._frame.camera)

    def packed_at(self, pixel: NDArray[np.float64]) -> list[int]:
        """Return the packed objects at a pixel of the canvas, the most visible first."""
        if self._frame is None or not self.packed.visible:
            return []
        row, col = self._device(pixel)
        if not (0 <= row < self._frame.size[0] and 0 <= col < self._frame.size[1]):
            return []
        crop = self._packed_painter.crop()
        return pick_packed(self.session, crop, self._frame, row, col)

    def point_at(self, object_id: int) -> None:
        """Show which object the mouse is on."""
        if object_id != self._pointed:
            self._pointed = object_id
            words = self.session.describe(object_id) if object_id else ""
            for layer in self.layers:
                layer.words = words
            self.viewer.status = words or "Ready"
            self._mark()

    def select(self, object_id: int) -> None:
        """Select an object, 0 for none."""
        self.session.select([object_id] if object_id else [])

    def turn(self, object_id: int, rotation: Matrix) -> None:
        """Turn an object under the hand."""
        self._director.turn(object_id, rotation)
        self._show_sprites()
        self._draw_moving()

    def turned(self, object_id: int) -> None:
        """Let go of an object that was turned."""
        pose = self._director.turning.pop(object_id, None)
        if pose is not None:
            self._director.landed(object_id, pose)
            self.session.place(object_id, pose)
            self._show_sprites()
        self._clock.start()

    # Wiring.

    def _connect(self) -> None:
        events = self.session.events
        events.states.connect(self._on_states)
        events.hues.connect(self._on_hues)
        events.transfer_function.connect(self._on_look)
        events.selected.connect(self._on_selected)
        self.viewer.layers.events.removed.connect(self._on_removed)
        compat.when_window_closes(self.viewer, self.close)
        self._pointer = Pointer(self.viewer, self)

    def _disconnect(self) -> None:
        events = self.session.events
        for signal, slot in (
            (events.states, self._on_states),
            (events.hues, self._on_hues),
            (events.transfer_function, self._on_look),
            (events.selected, self._on_selected),
        ):
            signal.disconnect(slot, missing_ok=True)
        self.viewer.layers.events.removed.disconnect(self._on_removed)
        for layer in self.layers:
            layer.frame_changed.disconnect(self._on_frame, missing_ok=True)
        if self._pointer is not None:
            self._pointer.close()
            self._pointer = None

    def _caster(self) -> str:
        # In the viewer "gl" needs the canvas's own context, which worker threads do not have.
        return "cpu"

    def _on_frame(self, frame: Frame) -> None:
        if frame.same_as(self._frame):
            return
        self._frame = frame
        self.session.canvas_size = frame.size
        self.session.look(frame.camera)
        self._packed_painter.look(frame)
        self._at_rest.moved(frame)
        if self._director.moving(self._clock.now(), frame):
            self._draw_moving()
        self._show_sprites()

    def _on_states(self, ids: Iterable[int]) -> None:
        packed = frozenset(i for i, s in self.session.states.items() if s.name == "PACKED")
        changed, self._packed_ids = packed ^ self._packed_ids, packed
        self._draw_moving()
        self._packed_painter.recast_objects(changed)
        self._show_sprites()
        self._at_rest.states_changed()
        self._set_tables()
        if self._director.active(self._clock.now()):
            self._clock.start()

    def _on_hues(self, *_: Any) -> None:
        self._packed_painter.refine()
        self._show_sprites()
        self._set_tables()

    def _on_look(self, *_: Any) -> None:
        self._packed_painter.recast()
        self._sprite_painter.look_changed()
        self._show_sprites()

    def _on_selected(self, *_: Any) -> None:
        self._mark()

    def _on_removed(self, event: Any) -> None:
        if event.value in self.layers:
            self.close()

    def _after_rest(self, hues: dict[int, float]) -> None:
        if self.recolor_at_rest and not self.flying:
            self.session.set_hues(hues)

    def _tick(self, now: float) -> None:
        for object_id in self._director.arrivals(now):
            self._land(object_id)
        one = self._director.inspection
        if one is not None and one.leaving and one.still(now):
            self._finish_inspection()
        active = self._director.active(now)
        if not self._flight_painter.busy:
            self._draw_moving()
        if not active:
            self._clock.stop()
            self._draw_moving()

    def _land(self, object_id: int) -> None:
        flight = self.session.flights.get(object_id)
        if flight is not None:
            self._director.landed(object_id, None if flight.back else flight.target)
            self.session.land(object_id)
            self.events.landed.emit(object_id)

    def _finish_inspection(self) -> None:
        one = self._director.inspection
        if one is None:
            return
        self._director.inspection = None
        pose = self.session.poses.get(one.object_id)
        self.session.leave()
        if pose is not None:
            turned = replace(pose, rotation=one.rotation)
            self._director.landed(one.object_id, turned)
            self.session.place(one.object_id, turned)
        self._dim(1.0)
        self._show_sprites()
        self._clock.start()

    def _draw_moving(self) -> None:
        if self._frame is not None:
            moving = self._director.moving(self._clock.now(), self._frame)
            if moving or self.transition.shots:
                self._flight_painter.cast(moving, self._frame)

    def _show_packed(self, shot: Shot | None) -> None:
        self.packed.show(shot)

    def _show_moving(self, shots: dict[int, Shot]) -> None:
        self.transition.show(shots)
        self._show_sprites()
        self.events.frame.emit()

    def _show_sprites(self) -> None:
        frame, session = self._frame, self.session
        if frame is None:
            return
        poses = dict(session.poses)
        for object_id, flight in session.flights.items():
            poses.setdefault(object_id, flight.target)
        on_their_way = set(session.flights) | {self._director_inspected()}
        moving = set(self.transition.shots)
        shown = frozenset(
            i
            for i in poses
            if (i not in on_their_way and i not in self._director.turning)
            or (i in on_their_way and i not in moving and i in session.poses)
        )
        self._sprite_painter.want(poses, shown, frame.size[0] / frame.camera.height)

    def _set_tables(self) -> None:
        session = self.session
        set_table(self.packed, session, self._packed_ids)
        set_table(self.transition, session, session.flights)
        set_table(self.sprites, session, session.poses)

    def _director_inspected(self) -> int:
        one = self._director.inspection
        return 0 if one is None else one.object_id

    def _dim(self, factor: float) -> None:
        self.packed.dim(factor)
        self.sprites.dim(factor)

    def _mark(self) -> None:
        self.sprites.choose(frozenset(self.session.selected) | {self._pointed} - {0})

    def _device(self, pixel: NDArray[np.float64]) -> tuple[float, float]:
        frame = self._frame
        assert frame is not None
        height, width = self.viewer.canvas.size
        return (
            float((pixel[0] + 0.5) * frame.size[0] / height - 0.5),
            float((pixel[1] + 0.5) * frame.size[1] / width - 0.5),
        )

    def _settled(self) -> bool:
        waiting = self._jobs.busy or not self._packed_painter.settled
        return not (waiting or not self._sprite_painter.settled or self._at_rest.waiting)
