"""The viewer of the panel, the bags open in it one within another, and what changes in them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Flag, auto
from typing import TYPE_CHECKING

from qtpy.QtCore import QObject, Signal

from napari_unpack.tasks import Task, attempt
from napari_unpack.viewer.scheduler import Scheduler, Worker
from napari_unpack.widgets import notifications

if TYPE_CHECKING:
    import napari
    from napari.layers import Layer
    from psygnal import SignalInstance

    from napari_unpack.geometry.view import Camera
    from napari_unpack.session import Session
    from napari_unpack.viewer.controller import SessionController
    from napari_unpack.viewer.viewer_state import SavedView

# Changes of one command come in bursts of up to a dozen; the panel is redrawn once for all.
GATHER_MS = 30


class Change(Flag):
    """What of a session has changed; several at once after a burst of changes."""

    LABELS = auto()
    STATES = auto()
    HUES = auto()
    TRANSFER_FUNCTION = auto()
    QUEUE = auto()
    VIEW = auto()
    SELECTED = auto()
    MEASUREMENTS = auto()
    SURROUNDINGS = auto()
    REVIEW = auto()


@dataclass(frozen=True)
class OuterBag:
    """A bag one of whose objects is open: all that it takes to go back to it.

    Parameters
    ----------
    session : Session
    sources : sequence of napari layers
    view : SavedView
        How the bag was looked at.
    opened : int
        The object.
    """

    session: Session
    sources: Sequence[Layer]
    view: SavedView
    opened: int


class Workspace(QObject):
    """A viewer and the session it shows.

    Signals: `switched` when another session or none is shown; `changed` (`Change`) after a burst
    of changes of the session shown; `unpackable` (frozenset of the IDs that can leave now, or None
    as soon as that is out of date). All arrive on the main thread.

    Parameters
    ----------
    viewer : napari.Viewer
        Or the public proxy of it that plugins get.
    parent : QObject, optional

    Attributes
    ----------
    scheduler : Scheduler
        Runs the tasks and timers of the panel.
    """

    switched = Signal()
    changed = Signal(object)
    unpackable = Signal(object)
    _heard = Signal(object)
    _message = Signal(str)

    def __init__(self, viewer: napari.Viewer, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.viewer = viewer
        self.controller: SessionController | None = None
        self._changes = Change(0)
        self.scheduler = Scheduler(notifications.inform)
        # Workers change sessions too. Through a Qt signal their changes reach the main thread.
        self._heard.connect(self._gather)
        self._message.connect(notifications.inform)
        self._connections: list[tuple[SignalInstance, Callable[..., None]]] = []
        self._outer: list[OuterBag] = []

    @property
    def session(self) -> Session | None:
        """The session shown, or None."""
        return None if self.controller is None else self.controller.session

    @property
    def document(self) -> Session | None:
        """The session of the whole bag, also while the contents of an object are shown."""
        return self._outer[0].session if self._outer else self.session

    def open(
        self,
        session: Session,
        sources: Sequence[Layer] = (),
        camera: Camera | None = None,
        *,
        seconds: float | None = None,
        backend: str | None = None,
        recolor_at_rest: bool = True,
        outer: Sequence[OuterBag] = (),
    ) -> None:
        """Show a session in the 3D view, in place of the one shown before.

        Parameters
        ----------
        session : napari_unpack.Session
        sources : sequence of napari layers
            The user's own that the session is of, hidden in 3D meanwhile. What is painted on
            the Labels among them is painted on its objects.
        camera : Camera, optional
            The first view; by default the whole bag is framed.
        seconds : float, optional
            Duration of a flight, s; by default the session's own.
        backend : {"auto", "gl", "cpu"}, optional
            What draws; by default what the session says.
        recolor_at_rest : bool
            Recolour whenever the camera comes to rest.
        outer : sequence of OuterBag
            The bags that it is in, one within another, the outermost first.

        Raises
        ------
        RuntimeError
            If this napari cannot show the plugin's layers.
        """
        from napari_unpack.viewer.controller import SessionController

        # In which the camera looked so, until opening measures this one.
        window = session.canvas_size
        try:
            # Two sessions would fight for the camera and the layers of one viewer.
            self._take_down()
            controller = SessionController(self.viewer, session, tuple(sources), self.scheduler)
            if seconds is not None:
                controller.seconds = seconds
            if backend is not None:
                controller.backend = backend
            controller.recolor_at_rest = recolor_at_rest
            controller.outer_session = outer[0].session if outer else None
            self.controller, self._outer = controller, list(outer)
            # Before it opens, which already changes the view.
            self._listen(controller)
            controller.open()
        except BaseException:
            # Half a session would take the place of one that can be shown.
            self._take_down()
            self.switched.emit()
            raise
        if camera is not None:
            controller.look_from(camera, window)
        self.switched.emit()

    @property
    def settled(self) -> bool:
        """Whether every change has been published."""
        return not self.scheduler.pending(self._publish)

    @property
    def is_inside(self) -> bool:
        """Whether the session shown is of the contents of an object."""
        return bool(self._outer)

    @property
    def opened(self) -> tuple[int, ...]:
        """The objects that are open, one within another, the outermost first."""
        return tuple(bag.opened for bag in self._outer)

    @property
    def opened_names(self) -> tuple[str, ...]:
        """What they are called."""
        return tuple(str(bag.session.objects["name"][bag.opened]) for bag in self._outer)

    def open_container(self, object_id: int) -> None:
        """Show what is inside an object as a bag of its own.

        Parameters
        ----------
        object_id : int
            Of the session shown.

        Raises
        ------
        ValueError
            If the object cannot be opened.
        """
        from napari_unpack.viewer.viewer_state import SavedView

        controller = self.controller
        if controller is None:
            return
        session = controller.session
        rotation = controller.rotation_of(object_id)
        # In a worker: to tell the parts of a large object apart takes a second.
        task = Task(
            ("open", object_id),
            lambda _: attempt(lambda: session.opened_bags.open(session, object_id, rotation)),
        )
        found = self.scheduler.run_modal(task, Worker.LONG)
        if found is None or self.controller is not controller:
            return
        inner = found.get()
        # An inspection holds the camera; the view to return to is the one before it.
        controller.renderer.end_inspection()
        view = SavedView.of(self.viewer.scene.camera)
        # What the user chose for the bag holds for its contents.
        inner.tint_mode, inner.length_unit = session.tint_mode, session.length_unit
        inner.decorations = session.decorations
        self._switch_to(
            inner, [*self._outer, OuterBag(session, controller.sources, view, object_id)]
        )

    def leave_container(self) -> None:
        """Go back to the bag that the opened object is from."""
        if self._outer:
            *others, outer = self._outer
            outer.session.opened_bags.leave(outer.session, outer.opened)
            self._switch_to(outer.session, others, outer.sources)
            outer.view.give_back(self.viewer.scene.camera)

    def _switch_to(
        self, session: Session, outer: list[OuterBag], sources: Sequence[Layer] | None = None
    ) -> None:
        """Show another bag of the stack, drawn as the one shown now."""
        before = self.controller
        if before is None:
            return
        self.open(
            session,
            before.sources if sources is None else sources,
            seconds=before.seconds,
            backend=before.backend,
            recolor_at_rest=before.recolor_at_rest,
            outer=outer,
        )

    def close(self) -> None:
        """Show no session; the user's layers become as they were."""
        if self.controller is not None:
            try:
                self._take_down()
            finally:
                self.switched.emit()

    def end(self) -> None:
        """Close the session for good; nothing runs or is delivered after."""
        try:
            self.close()
        finally:
            self.scheduler.close()

    def _take_down(self) -> None:
        """Close the session shown, untold: the panel is loaded once for the one that follows."""
        controller = self.controller
        if controller is not None:
            # Before it closes, whose last changes are of no interest any more.
            self._forget()
            controller.close()

    def _forget(self) -> None:
        for signal, slot in self._connections:
            signal.disconnect(slot, missing_ok=True)
        self._connections.clear()
        self.scheduler.forget(self._publish)
        self._changes = Change(0)
        self.controller = None
        self._outer = []
        self.unpackable.emit(None)

    def _listen(self, controller: SessionController) -> None:
        events = controller.session.events
        watched = {
            Change.LABELS: events.labels,
            Change.STATES: events.states,
            Change.HUES: events.hues,
            Change.TRANSFER_FUNCTION: events.transfer_function,
            Change.QUEUE: events.queue,
            Change.VIEW: events.view,
            Change.SELECTED: events.selected,
            Change.MEASUREMENTS: events.measurements,
            Change.SURROUNDINGS: events.surroundings,
            Change.REVIEW: events.review,
        }
        for change, signal in watched.items():
            self._connect(signal, lambda *_, change=change: self._heard.emit(change))
        self._connect(events.message, self._message.emit)
        self._connect(controller.events.message, self._message.emit)
        self._connect(controller.events.unpackable, self.unpackable.emit)
        self._connect(controller.events.closed, self._on_closed)

    def _on_closed(self) -> None:
        self._forget()
        self.switched.emit()

    def _connect(self, signal: SignalInstance, slot: Callable[..., None]) -> None:
        signal.connect(slot)
        self._connections.append((signal, slot))

    def _gather(self, change: Change) -> None:
        self._changes |= change
        self.scheduler.throttle(GATHER_MS, self._publish)

    def _publish(self) -> None:
        changes, self._changes = self._changes, Change(0)
        if changes and self.controller is not None:
            self.changed.emit(changes)
