"""What is drawn over the bag and belongs to no object: marks, the ghost, the arrow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from napari_unpack.layers.arrow import Arrow
from napari_unpack.layers.ghost import Ghost
from napari_unpack.layers.jobs import Jobs
from napari_unpack.layers.marks import MarkPainter, Marks
from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.visuals.cards import Card


class Overlays:
    """Keeps them right.

    Parameters
    ----------
    session : Session
    jobs : Jobs
        With the lanes "quick" and "rest".
    show : callable
        Called when there is something new to draw.
    """

    def __init__(self, session: Any, jobs: Jobs, show: Callable[[], None]) -> None:
        self._session, self._show = session, show
        self._mark_free = True
        self._marks = Marks()
        self.painter = MarkPainter(session, jobs, show)
        self.ghost = Ghost(session, jobs, show)
        self.arrow = Arrow(session)

    @property
    def mark_free(self) -> bool:
        """Whether those who can leave now are outlined."""
        return self._mark_free

    @mark_free.setter
    def mark_free(self, marked: bool) -> None:
        self._mark_free = bool(marked)
        self.renew()

    @property
    def settled(self) -> bool:
        """Whether all marks are drawn, and no ghost comes or goes."""
        return self.ghost.settled and not self.painter.waiting

    def look(self, frame: Frame) -> None:
        """Follow the canvas."""
        self.painter.look(frame)
        self.ghost.look(frame)

    def changed(self) -> None:
        """Follow who is in the bag, and who can leave it."""
        self.painter.renew()
        self.ghost.changed()
        self.renew()

    def unearth(self, buried: int, leaving: frozenset[int]) -> None:
        """Show who must leave for a buried object; 0 shows that no more."""
        self._marks = replace(self._marks, buried=buried, leaving=leaving)
        self.renew()

    def renew(self) -> None:
        """Mark who is to be marked now."""
        session = self._session
        inspecting = any(s.name == "INSPECTED" for s in session.states.values())
        chosen = frozenset(session.selected)
        marks = replace(self._marks, free=self._mark_free, chosen=chosen)
        self.painter.mark(Marks() if inspecting else marks)

    def close(self) -> None:
        """Draw nothing more."""
        self.painter.close()
        self.ghost.close()

    def cards_at(self, frame: Frame) -> Sequence[Card]:
        """Return everything to draw."""
        parts = (self.painter, self.ghost, self.arrow)
        return [card for part in parts for card in part.cards_at(frame)]
