"""What is drawn over the bag and belongs to no object: marks, the ghost, the arrow.

Outlines over the packed bag: who is free, who is selected, who must leave for another.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.layers.rendered_image import RenderedImage
from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.gl.depth_quads import Quad
from napari_unpack.rendering.image_patch import ImagePatch
from napari_unpack.rendering.outlines import Ink, outlined
from napari_unpack.viewer.direction_arrow import DirectionArrow
from napari_unpack.viewer.ghost import Ghost
from napari_unpack.viewer.jobs import Jobs, single_shot, stop

REST_MS = 160

FREE = Ink((1.0, 1.0, 1.0, 0.5))
TOGETHER = Ink((1.0, 0.82, 0.4, 0.9), width=2)
CHOSEN = Ink((1.0, 1.0, 1.0, 0.95), width=2)
LEAVING = Ink((0.45, 0.9, 1.0, 0.95), width=2, fill=0.08)
LEAST = Ink((1.0, 0.55, 0.3, 0.9), width=2)
BURIED = Ink((1.0, 0.75, 0.2, 1.0), width=2, fill=0.3)


@dataclass(frozen=True)
class Marks:
    """Who is to be outlined in the bag.

    Parameters
    ----------
    free : bool
        Whether those who can leave now are; those that leave together have an ink of their own,
        and so has the least blocked where nobody can.
    chosen : frozenset of int
        Who is selected.
    leaving : frozenset of int
        Who must leave for the buried one.
    buried : int
        Drawn through everything before it; 0 for none.
    """

    free: bool = False
    chosen: frozenset[int] = frozenset()
    leaving: frozenset[int] = frozenset()
    buried: int = 0

    def inks(
        self, packed: frozenset[int], groups: Iterable[Sequence[int]] = (), least: int = 0
    ) -> dict[int, Ink]:
        """Return how those who are in the bag are marked, except the buried one.

        Parameters
        ----------
        packed : frozenset of int
            Who is in the bag.
        groups : iterable of sequence of int
            Who can leave now.
        least : int
            Who is blocked least, 0 while that is unknown.
        """
        free = tuple(groups) if self.free else ()
        inks = {i: FREE if len(group) == 1 else TOGETHER for group in free for i in group}
        if self.free and not free:
            inks[least] = LEAST
        if self.buried:
            inks = dict.fromkeys(self.leaving, LEAVING)
        inks |= dict.fromkeys(self.chosen, CHOSEN)
        inks.pop(self.buried, None)
        return {i: ink for i, ink in inks.items() if i in packed}


class MarkPainter:
    """Draws marks once the camera rests; while it moves there are none.

    Parameters
    ----------
    session : Session
        Whose objects.
    jobs : Jobs
        With the lane "rest".
    show : callable
        Called when there is something new to draw.
    """

    def __init__(self, session: Any, jobs: Jobs, show: Callable[[], None]) -> None:
        self._session, self._jobs, self._show = session, jobs, show
        self._marks = Marks()
        self._frame: Frame | None = None
        self._state = 0
        self._shot: RenderedImage | None = None
        self._rest = single_shot(self._ask, REST_MS)

    @property
    def waiting(self) -> bool:
        """Whether marks are about to be drawn."""
        return bool(self._rest.isActive())

    def mark(self, marks: Marks) -> None:
        """Mark these and nobody else."""
        if marks != self._marks:
            self._marks = marks
            self.renew()

    def look(self, frame: Frame) -> None:
        """Follow the canvas."""
        if not frame.same_as(self._frame):
            self._frame = frame
            self.renew()

    def renew(self) -> None:
        """Draw anew, after the camera moved or somebody left or came back."""
        self._state += 1
        if self._shot is not None:
            self._shot = None
            self._show()
        self._rest.start()

    def close(self) -> None:
        """Draw nothing more."""
        stop(self._rest)
        self._frame = None

    def cards_at(self, frame: Frame) -> Sequence[Quad]:
        """Return the one card of all marks."""
        card = None if self._shot is None else self._shot.card(frame.camera)
        return () if card is None else (card,)

    def _ask(self) -> None:
        frame, marks, state = self._frame, self._marks, self._state
        if frame is not None and self._jobs.turning:
            self._rest.start()
            return
        if frame is None or self._session.flights:
            return
        packed = frozenset(i for i, s in self._session.states.items() if s.name == "PACKED")
        groups = self._session.unpackable_groups() if marks.free else ()
        least = self._session.least_occluded_object() if marks.free and not groups else None
        inks = marks.inks(packed, groups, 0 if least is None else least[0])
        buried = marks.buried if marks.buried in packed else 0
        if not inks and not buried:
            return
        self._jobs.ask(
            "rest",
            "marks",
            lambda: draw(self._session, packed, inks, buried, frame),
            lambda shot: self._take(shot, state),
        )

    def _take(self, shot: RenderedImage | None, state: int) -> None:
        if state == self._state:
            self._shot = shot
            self._show()


def draw(
    session: Any, packed: frozenset[int], inks: Mapping[int, Ink], buried: int, frame: Frame
) -> RenderedImage | None:
    """Draw marks for what a canvas shows; for worker threads.

    Parameters
    ----------
    session : Session
        Whose objects.
    packed : frozenset of int
        Who is in the bag.
    inks : mapping of int to Ink
        By ID.
    buried : int
        Seen through all others; 0 for none.
    frame : Frame
        What the canvas shows.
    """

    def front(ids: frozenset[int]) -> NDArray[np.int32]:
        visible = np.zeros(len(session.packed_tints()), np.bool_)
        visible[list(ids)] = True
        layers: NDArray[np.int32] = session.casters.ids(frame.camera, visible, frame.size, 1)
        return layers[0]

    rgba = outlined(front(packed), inks)
    if buried:
        through = outlined(front(frozenset({buried})), {buried: BURIED})
        rgba = through + (1.0 - through[..., 3:]) * rgba
    patch = ImagePatch(rgba, np.full(rgba.shape[:2], np.inf, np.float32), 0, 0).trimmed()
    shot = RenderedImage.of(patch, frame.camera, frame.size)
    return None if shot is None else replace(shot, in_front=True)


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
        self.arrow = DirectionArrow(session)

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

    def cards_at(self, frame: Frame) -> Sequence[Quad]:
        """Return everything to draw."""
        parts = (self.painter, self.ghost, self.arrow)
        return [card for part in parts for card in part.cards_at(frame)]
