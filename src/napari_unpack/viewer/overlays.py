"""What is drawn over the bag and belongs to no object: outlines, the ghost, the arrow."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from napari_unpack.layers.rendered_image import RenderedImage
from napari_unpack.layers.view_camera import Frame, same_camera
from napari_unpack.rendering.gl.depth_quads import Quad
from napari_unpack.rendering.image_patch import ImagePatch
from napari_unpack.rendering.outlines import Ink, outlined
from napari_unpack.session.object_state import ObjectState, ids_in
from napari_unpack.tasks import Task
from napari_unpack.viewer.direction_arrow import DirectionArrow
from napari_unpack.viewer.ghost import Ghost
from napari_unpack.viewer.protocols import Drawing
from napari_unpack.viewer.scheduler import IdlePhase, Scheduler, Worker

if TYPE_CHECKING:
    from napari_unpack.rendering.scene import Scene
    from napari_unpack.session import Session
    from napari_unpack.session.ray_queries import RayQueries

# Between the full image (120 ms) and the queries (250 ms), which take the processor longer.
OUTLINES_MS = 160

UNPACKABLE = Ink((1.0, 1.0, 1.0, 0.5))
INTERLOCKED = Ink((1.0, 0.82, 0.4, 0.9), width=2)
SELECTED = Ink((1.0, 1.0, 1.0, 0.95), width=2)
LEAVING_FIRST = Ink((0.45, 0.9, 1.0, 0.95), width=2, fill=0.08)
LEAST_OCCLUDED = Ink((1.0, 0.55, 0.3, 0.9), width=2)
BURIED = Ink((1.0, 0.75, 0.2, 1.0), width=2, fill=0.3)

# Of what must leave for a buried object: lines of more would drown its own.
MOST_LEAVING = 12


@dataclass(frozen=True)
class Outlined:
    """Which packed objects have an outline.

    Parameters
    ----------
    unpackable : bool
        Whether those that can leave now do; interlocked groups have an ink of their own, and so
        has the least occluded object where nothing can leave.
    selected : frozenset of int
    leaving : frozenset of int
        What must leave for the buried object; more than a dozen have no outline.
    buried : int
        Drawn through everything before it; 0 for none.
    """

    unpackable: bool = False
    selected: frozenset[int] = frozenset()
    leaving: frozenset[int] = frozenset()
    buried: int = 0

    def inks(
        self, packed: frozenset[int], groups: Iterable[Sequence[int]] = (), least: int = 0
    ) -> dict[int, Ink]:
        """Return the ink of every packed object that has one, except the buried one.

        Parameters
        ----------
        packed : frozenset of int
            What is in the bag.
        groups : iterable of sequence of int
            What can leave now, interlocked objects in one group.
        least : int
            The least occluded object, 0 while that is unknown.
        """
        wanted = tuple(groups) if self.unpackable else ()
        inks = {
            i: UNPACKABLE if len(group) == 1 else INTERLOCKED for group in wanted for i in group
        }
        if self.unpackable and not wanted:
            inks[least] = LEAST_OCCLUDED
        if self.buried:
            few = self.leaving if len(self.leaving) <= MOST_LEAVING else ()
            inks = dict.fromkeys(few, LEAVING_FIRST)
        inks |= dict.fromkeys(self.selected, SELECTED)
        inks.pop(self.buried, None)
        return {i: ink for i, ink in inks.items() if i in packed}


class OutlineRenderer:
    """Draws outlines once the camera rests; while it moves there are none.

    Parameters
    ----------
    session, scheduler, show
        As for `Ghost`.
    """

    def __init__(self, session: Session, scheduler: Scheduler, show: Callable[[], None]) -> None:
        self._session, self._scheduler, self._show = session, scheduler, show
        self._outlined = Outlined()
        self._frame: Frame | None = None
        self._revision = 0
        self._drawn: tuple[dict[int, Ink], int] = {}, 0
        self._image: RenderedImage | None = None

    @property
    def outlined(self) -> Outlined:
        """Which objects are to have an outline."""
        return self._outlined

    @property
    def pending(self) -> bool:
        """Whether outlines are about to be drawn."""
        return self._scheduler.pending(self._draw)

    def outline(self, outlined: Outlined) -> None:
        """Outline these and no others."""
        # Asked at every movement of the mouse.
        if outlined != self._outlined:
            self._outlined = outlined
            self.redraw()

    def set_view(self, frame: Frame) -> None:
        """Follow the canvas."""
        if not frame.same_as(self._frame):
            self._frame = frame
            self.redraw()

    def redraw(self) -> None:
        """Draw anew, after the camera moved or objects left or came back."""
        self._revision += 1
        # Lines of the view before would lie beside their objects.
        if self._image is not None:
            self._image = None
            self._show()
        self._scheduler.debounce(OUTLINES_MS, self._draw)

    def unpackable_known(self) -> None:
        """Draw anew where others can leave than those that were drawn."""
        if not self.pending and self._wanted() != self._drawn:
            self.redraw()

    def close(self) -> None:
        """Draw nothing more."""
        self._scheduler.forget(self._draw)
        self._frame = self._image = None

    def quads_at(self, frame: Frame) -> Sequence[Quad]:
        """Return the one quad of all outlines, as long as they are of this view."""
        image = self._image
        if image is None or not same_camera(image.camera, frame.camera):
            return ()
        return (image.quad(frame.camera),)

    def _draw(self) -> None:
        frame, revision = self._frame, self._revision
        if frame is not None and self._scheduler.idle_held(IdlePhase.IMAGE):
            self._scheduler.debounce(OUTLINES_MS, self._draw)
            return
        # Every landing draws them anew.
        if frame is None or self._session.flights:
            return
        self._drawn = inks, buried = self._wanted()
        if inks or buried:
            scene, rays = self._session.scene(), self._session.ray_queries
            self._scheduler.submit(
                Task("outlines", lambda _: draw_outlines(scene, rays, inks, buried, frame)),
                Worker.BACKGROUND,
                lambda image: self._finish(image, revision),
            )

    def _wanted(self) -> tuple[dict[int, Ink], int]:
        """Return the inks of all but the buried object, and that; 0 for none."""
        queries, outlined = self._session.queries, self._outlined
        packed = frozenset(ids_in(self._session.states, ObjectState.PACKED))
        groups = queries.unpackable_groups() if outlined.unpackable else ()
        least = queries.least_occluded() if outlined.unpackable and not groups else None
        inks = outlined.inks(packed, groups, 0 if least is None else least[0])
        return inks, outlined.buried if outlined.buried in packed else 0

    def _finish(self, image: RenderedImage | None, revision: int) -> None:
        # Something has moved since: another image is on its way.
        if revision == self._revision:
            self._image = image
            self._show()


def draw_outlines(
    scene: Scene, rays: RayQueries, inks: Mapping[int, Ink], buried: int, frame: Frame
) -> RenderedImage | None:
    """Draw outlines for what a canvas shows; for worker threads.

    Parameters
    ----------
    scene : Scene
    rays : RayQueries
        Of the scene's labels.
    inks : {id: Ink}
    buried : int
        Seen through all others; 0 for none.
    frame : Frame
        What the canvas shows.
    """

    def front(ids: frozenset[int]) -> NDArray[np.int32]:
        visible = np.zeros(len(scene.packed_tints), np.bool_)
        visible[list(ids)] = True
        # Threads have no GL context.
        layers: NDArray[np.int32] = rays.object_ids(
            frame.camera, visible, frame.size, 1, scene.clipping, "cpu"
        )
        return layers[0]

    rgba = outlined(front(scene.packed), inks)
    if buried:
        through = outlined(front(frozenset({buried})), {buried: BURIED})
        rgba = through + (1.0 - through[..., 3:]) * rgba
    # Without depth, so that nothing of the bag hides a line.
    patch = ImagePatch(rgba, np.full(rgba.shape[:2], np.inf, np.float32), 0, 0).trimmed()
    image = RenderedImage.of(patch, frame.camera, frame.size)
    return None if image is None else replace(image, in_front=True)


class Overlays:
    """Outlines, ghost and arrow together.

    Parameters
    ----------
    session, scheduler, show
        As for `Ghost`.
    shows : callable
        Given what the canvas shows, tells whether the bag's image is seen and is of that view.

    Attributes
    ----------
    outlines : OutlineRenderer
    ghost : Ghost
    arrow : DirectionArrow
    drawings : list of Drawing
        What else is drawn, for as long as it is in the list.
    """

    def __init__(
        self,
        session: Session,
        scheduler: Scheduler,
        show: Callable[[], None],
        shows: Callable[[Frame], bool],
    ) -> None:
        self._session, self._shows = session, shows
        self._wanted = Outlined(unpackable=True)
        self.outlines = OutlineRenderer(session, scheduler, show)
        self.ghost = Ghost(session, scheduler, show)
        self.arrow = DirectionArrow(session)
        self.drawings: list[Drawing] = []

    @property
    def outlines_unpackable(self) -> bool:
        """Whether objects that can leave now are outlined."""
        return self._wanted.unpackable

    @outlines_unpackable.setter
    def outlines_unpackable(self, wanted: bool) -> None:
        self._wanted = replace(self._wanted, unpackable=bool(wanted))
        self.update()

    @property
    def settled(self) -> bool:
        """Whether all outlines are drawn, and no ghost comes or goes."""
        return self.ghost.settled and not self.outlines.pending

    def set_view(self, frame: Frame) -> None:
        """Follow the canvas."""
        self.outlines.set_view(frame)
        self.ghost.set_view(frame)

    def states_changed(self) -> None:
        """Follow what is in the bag, and what can leave it."""
        self.outlines.redraw()
        self.ghost.states_changed()
        self.update()

    def show_reveal_plan(self, buried: int, leaving: frozenset[int]) -> None:
        """Show what must leave for a buried object.

        Parameters
        ----------
        buried : int
            0 shows no plan any more.
        leaving : frozenset of int
        """
        self._wanted = replace(self._wanted, buried=buried, leaving=leaving)
        self.update()

    def update(self) -> None:
        """Outline what is to be outlined now."""
        session = self._session
        inspecting = ObjectState.INSPECTED in session.states.values()
        self._wanted = replace(self._wanted, selected=frozenset(session.selected))
        # Lines of the dimmed bag would lie over the inspected object.
        self.outlines.outline(Outlined() if inspecting else self._wanted)

    def close(self) -> None:
        """Draw nothing more."""
        self.outlines.close()
        self.ghost.close()

    def quads_at(self, frame: Frame) -> Sequence[Quad]:
        """Return everything to draw."""
        parts: list[Drawing] = [self.ghost, self.arrow, *self.drawings]
        # Without the picture they are of, or beside it, lines would outline nothing.
        if self._shows(frame):
            parts.insert(0, self.outlines)
        return [quad for part in parts for quad in part.quads_at(frame)]
