"""What the panel's sections share: one viewer, at most one stage, and every verb a button has.

Verbs never raise for bad input: the reason becomes a notification and everything stays as it
was. Changes of the session, from whatever thread, arrive here, are gathered for a moment and
handed to the sections as one `changed` on the main thread.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from qtpy.QtCore import QObject, Signal

from napari_unpack.session.containers import OpenedBefore
from napari_unpack.viewer.scheduler import Scheduler
from napari_unpack.widgets import notifications

_GATHER_MS = 30
WATCHED = ("labels", "states", "hues", "transfer_function", "queue", "view", "selected")
"""Signals of the session that the sections hear of, by name."""


class Workspace(QObject):
    """The viewer, its stage, and the verbs.

    Signals: `staged` when a stage opened or closed; `changed` (frozenset of names from
    `WATCHED`) after a burst of changes; `busy` (bool) when an object starts or ends flying.

    Parameters
    ----------
    viewer : napari.Viewer
        Or the public proxy of it that plugins get.
    parent : QObject, optional

    Attributes
    ----------
    scheduler : Scheduler
        Runs everything of the panel and its stage.
    """

    staged = Signal()
    changed = Signal(object)
    _heard = Signal(str)
    _told = Signal(str)

    def __init__(self, viewer: Any, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.viewer = viewer
        self.controller: Any = None
        self._camera: Any = None
        self._news: set[str] = set()
        self.scheduler = Scheduler(notifications.inform)
        self._heard.connect(self._gather)
        self._told.connect(notifications.inform)
        self._links: list[tuple[Any, Any]] = []
        self._outer: list[tuple[Any, Sequence[Any], dict[str, Any]]] = []
        self._opened = OpenedBefore()

    @property
    def session(self) -> Any:
        """The session on the stage, or None."""
        return None if self.controller is None else self.controller.session

    @property
    def settled(self) -> bool:
        """Whether every change has been handed to the sections."""
        return not self.scheduler.pending(self._publish)

    def open(
        self, session: Any, sources: Sequence[Any] = (), camera: Any = None, **settings: Any
    ) -> None:
        """Put a session on the stage, in place of what was there.

        Parameters
        ----------
        session : napari_unpack.Session
        sources : sequence of napari layers
            The user's own layers, hidden while the stage is on.
        camera : Camera, optional
            How to look at it first; by default the whole bag is framed.
        **settings
            Attributes of the stage to set before it opens.
        """
        from napari_unpack.viewer.plain_stage import controller_class

        self.close()
        controller = controller_class()(self.viewer, session, sources=tuple(sources))
        for name, value in settings.items():
            setattr(controller, name, value)
        self.controller = controller
        for name in WATCHED:
            self._link(getattr(session.events, name), lambda *_, name=name: self._heard.emit(name))
        self._link(session.events.message, self._told.emit)
        self._link(controller.events.message, self._told.emit)
        self._link(controller.events.closed, lambda *_: self._forget())
        controller.open()
        self._camera = camera
        self.frame()
        self.staged.emit()

    def frame(self) -> None:
        """Look at the bag as it was first looked at."""
        if self._camera is None:
            self.controller.frame_bag()
        else:
            self.controller.look_from(self._camera)

    @property
    def is_inside(self) -> bool:
        """Whether the contents of an opened object are on the stage."""
        return bool(self._outer)

    def open_object(self, object_id: int) -> None:
        """Put what is inside an object on the stage, as a bag of its own."""
        if self.controller is None:
            self._ask_for_a_session()
            return
        with notifications.spoken():
            rotation = self.controller.rotation_of(object_id)
            inner = self._opened.open(self.session, object_id, rotation)
            self.controller.put_back()
            camera = self.viewer.scene.camera
            view = {name: getattr(camera, name) for name in _VIEW}
            outer = self.session, self.controller.sources, view
            settings = {"seconds": self.controller.seconds, "backend": self.controller.backend}
            inner.tint_mode = self.session.tint_mode
            around = [*self._outer, outer]
            self.open(inner, outer[1], around=around[0][0], **settings)
            self._outer = around
            self.staged.emit()

    def leave_object(self) -> None:
        """Go back to the bag that the opened object is from."""
        if self._outer:
            *around, (session, sources, view) = self._outer
            settings = {"seconds": self.controller.seconds, "backend": self.controller.backend}
            self.open(session, sources, around=around[0][0] if around else None, **settings)
            self.viewer.scene.camera.update(view)
            self._outer = around
            self.staged.emit()

    def close(self) -> None:
        """Take the stage down; the user's layers come back as they were."""
        if self.controller is not None:
            controller = self.controller
            self._forget()
            controller.close()

    def end(self) -> None:
        """Take the stage down for good; nothing runs or is delivered after."""
        self.close()
        self.scheduler.close()

    def _forget(self) -> None:
        if self.controller is None:
            return
        for signal, slot in self._links:
            signal.disconnect(slot, missing_ok=True)
        self._links.clear()
        self.scheduler.forget(self._publish)
        self._news.clear()
        self.controller = None
        self._outer = []
        self.staged.emit()

    def _link(self, signal: Any, slot: Any) -> None:
        signal.connect(slot)
        self._links.append((signal, slot))

    def _gather(self, name: str) -> None:
        self._news.add(name)
        self.scheduler.throttle(self._publish, _GATHER_MS, self._publish)

    def _publish(self) -> None:
        news, self._news = frozenset(self._news), set()
        if news and self.controller is not None:
            self.changed.emit(news)

    def unpack(self, what: int | Iterable[int] = 1) -> None:
        """Fly the next free objects out, or these."""
        self._perform("unpack", what, on="stage")

    def unpack_least(self) -> None:
        """Fly the next object out, the least blocked where none is free."""
        session = self.session
        if session is None:
            self._ask_for_a_session()
            return
        policy = session.take_least_occluded
        session.take_least_occluded = True
        try:
            self.unpack(1)
        finally:
            session.take_least_occluded = policy

    def unpack_selected(self) -> None:
        """Fly the selected objects out."""
        session = self.session
        if session is None:
            self._ask_for_a_session()
            return
        chosen = [i for i in sorted(session.selected) if session.states[i].name == "PACKED"]
        if chosen:
            self.unpack(chosen)
        else:
            notifications.inform(
                "Select objects in the bag first: click them in the picture or table."
            )

    def unpack_free(self) -> None:
        """Fly everything out that is free now."""
        session = self.session
        if session is None:
            self._ask_for_a_session()
            return
        with notifications.spoken():
            ids = session.unpackable()
            if ids:
                self.unpack(ids)

    def reveal(self, object_id: int, direction: Any = None) -> None:
        """Fly out what frees a buried object, and it as well."""
        self._perform("reveal", object_id, direction, on="stage")

    def restore(self, what: int | Iterable[int] = 1) -> None:
        """Fly the last unpacked objects back, or these."""
        self._perform("restore", what, on="stage")

    def restore_all(self) -> None:
        """Fly everything back."""
        if self.session is not None:
            out = [i for i, state in self.session.states.items() if state.name in _OUTSIDE]
            self._perform("restore", max(len(out), 1), on="stage")
        else:
            self._ask_for_a_session()

    def inspect(self, object_id: int) -> None:
        """Study one object alone."""
        self._perform("inspect", object_id, on="stage")

    def leave(self) -> None:
        """Come back from studying an object."""
        self._perform("leave", on="stage")

    def recolor(self) -> None:
        """Choose hues anew for this view."""
        self._perform("recolor")

    def hide(self, ids: Iterable[int]) -> None:
        """Hide objects from the picture; nothing is edited."""
        self._perform("hide", list(ids))

    def show(self, ids: Iterable[int]) -> None:
        """Show hidden objects again."""
        self._perform("show", list(ids))

    def isolate(self, ids: Iterable[int]) -> None:
        """Show these objects alone."""
        self._perform("isolate", list(ids))

    @property
    def kept_hues(self) -> frozenset[int]:
        """Objects whose colour stays whatever the view."""
        session = self.session
        return frozenset() if session is None else frozenset(session.locked_hues)

    def keep_hues(self, ids: Iterable[int], kept: bool = True) -> None:
        """Have the colours of objects stay in every view, or let them change again."""
        if self.session is not None:
            before = self.kept_hues
            self.session.locked_hues = before | set(ids) if kept else before - set(ids)

    def mark_examples(self, ids: Iterable[int], good: bool = True) -> None:
        """Mark objects as examples of whole ones, or take the mark away."""
        self._perform("mark_examples", list(ids), good)

    def select(self, ids: Iterable[int]) -> None:
        """Select these objects everywhere."""
        self._perform("select", list(ids))

    def undo(self) -> None:
        """Take the last command back."""
        self._perform("undo", on="stage")

    def redo(self) -> None:
        """Do the command taken back once more."""
        self._perform("redo", on="stage")

    def go_to(self, step: int, flying: bool = False) -> None:
        """Run the unpacking to a step."""
        self._perform("go_to", step, flying, on="stage")

    def _perform(self, verb: str, *arguments: Any, on: str = "session") -> None:
        if self.controller is None:
            self._ask_for_a_session()
            return
        with notifications.spoken():
            getattr(self.controller if on == "stage" else self.session, verb)(*arguments)

    def _ask_for_a_session(self) -> None:
        notifications.inform(
            "Segment a volume first, or choose its labels: step 1 of Virtual Unpacking."
        )


_VIEW = ("center", "zoom", "angles", "perspective")
_OUTSIDE = frozenset({"UNPACKED", "FLYING_OUT", "INSPECTED"})
