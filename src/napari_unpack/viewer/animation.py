"""What moves, and how: flights, an object under the hand or inspected, sprites, colours.

Every motion is a pure function of time. What shows it asks at each tick where things are now.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from qtpy.QtWidgets import QApplication, QStyle

from napari_unpack.geometry.axes import Matrix, Vector
from napari_unpack.geometry.easing import ease
from napari_unpack.geometry.transforms import Pose, packed_pose
from napari_unpack.layers.view_camera import Frame
from napari_unpack.session.object_state import ObjectState
from napari_unpack.viewer.scheduler import Scheduler

if TYPE_CHECKING:
    from napari_unpack.session import Session

# Long enough to be seen as a change of colours, short enough not to be waited for.
FADE_SECONDS = 0.3


class HueFade:
    """The short transition from one set of colours to the next.

    Parameters
    ----------
    scheduler : Scheduler
    step : callable
        Given, some sixty times a second, the part of the way, in [0, 1] and smooth at both ends;
        1 is the last.

    Attributes
    ----------
    allowed : bool
        False jumps to the end, where the desktop asks for reduced motion.
    """

    def __init__(self, scheduler: Scheduler, step: Callable[[float], None]) -> None:
        self.allowed = not motion_reduced()
        self._step = step
        self._began = 0.0
        self.animation = scheduler.animate(self._tick)

    @property
    def running(self) -> bool:
        """Whether a transition is under way."""
        return self.animation.running

    @property
    def part(self) -> float:
        """How far it has come; 1 where none is under way."""
        if not self.running:
            return 1.0
        return ease((self.animation.now() - self._began) / FADE_SECONDS)

    def begin(self) -> None:
        """Set out from the beginning."""
        self._began = self.animation.now()
        self.animation.start()

    def stop(self) -> None:
        """Leave the transition where it is."""
        self.animation.stop()

    def _tick(self, _now: float) -> None:
        part = self.part
        if part >= 1.0:
            self.animation.stop()
        self._step(part)


def motion_reduced() -> bool:
    """Return whether the desktop asks for no animations."""
    style = QApplication.style() if QApplication.instance() is not None else None
    hint = QStyle.StyleHint.SH_Widget_Animation_Duration
    return style is not None and style.styleHint(hint) == 0


# The eye follows the object to the middle; a jump would lose it.
FRAMING_SECONDS = 0.35
# How much of the view's shorter side the bounding sphere fills; sprites stay in view.
SHARE_OF_VIEW = 0.72


@dataclass(frozen=True, eq=False)
class Inspection:
    """An object on its way to the middle of the view, there, or on its way back.

    Parameters
    ----------
    object_id : int
    home : Pose or None
        Where it waits otherwise, pivot space. None: it is in the bag, and stays there.
    diameter : float
        Diagonal of its box, mm, at scale 1.
    rotation : (3, 3) ndarray of float64
        How it is turned now.
    since : float
        When it began to come, or to go, s; in the bag, when the camera moved last.
    height : float
        Of the view when it began, mm: the framed object fills its share of that.
    leaving : bool
        Whether it is on its way back.

    Notes
    -----
    docs/paper.md, R15: the object turns, not the camera. The framed pose follows the camera,
    so zooming zooms it. One that is in the bag is looked at where it lies, among its dimmed
    neighbours: there the camera comes near, and goes round it.
    """

    object_id: int
    home: Pose | None
    diameter: float
    rotation: Matrix
    since: float
    height: float
    leaving: bool = False

    def pose(self, now: float, frame: Frame, center: Vector) -> Pose:
        """Return where it is now.

        Parameters
        ----------
        now : float
            s, on the clock of `since`.
        frame : Frame
            What the canvas shows.
        center : (3,) ndarray of float64
            Of its box in the bag, world mm.
        """
        if self.home is None:
            return packed_pose(center, frame.camera)
        aspect = frame.size[1] / frame.size[0]
        framed = Pose(np.zeros(3), self.rotation, self.framed_scale(aspect))
        here = replace(self.home, rotation=self.rotation)
        return here.toward(framed, 1.0 - self._share_of_way_home(now))

    def flatness(self, now: float) -> float:
        """Return how flat it is seen: 1 beside the bag, as its sprite is, 0 in the middle."""
        return 0.0 if self.home is None else self._share_of_way_home(now)

    def _share_of_way_home(self, now: float) -> float:
        eased = ease((now - self.since) / FRAMING_SECONDS)
        return eased if self.leaving else 1.0 - eased

    def framed_scale(self, aspect: float) -> float:
        """Return the enlargement at which it fills its share of the view."""
        return SHARE_OF_VIEW * self.height * min(1.0, aspect) / self.diameter

    def still(self, now: float) -> bool:
        """Tell whether it has arrived."""
        return now >= self.since + FRAMING_SECONDS

    def turned(self, rotation: Matrix) -> Inspection:
        """Return it turned by a rotation of pivot space."""
        return replace(self, rotation=rotation @ self.rotation)

    def left(self, now: float) -> Inspection:
        """Return it on its way back from now on."""
        return replace(self, since=now, leaving=True)


@dataclass(frozen=True, eq=False)
class Moving:
    """One object to be cast where it is now.

    Parameters
    ----------
    pose : Pose
        Where, in the pivot space of the camera.
    in_front : bool
        Draw it before everything else instead of where it is.
    sharp : bool
        It does not move: cast all its pixels.
    flatness : float
        0 in the view's perspective, 1 as its sprite is (`Camera.flattened`).
    """

    pose: Pose
    in_front: bool = False
    sharp: bool = False
    flatness: float = 0.0


class Animator:
    """Keeps track of everything that is neither packed nor a sprite.

    Parameters
    ----------
    session : Session
    has_sprite, is_repacked : callable
        Given an ID: whether its sprite is there, whether the packed image shows it again.

    Notes
    -----
    An object that has landed stays in the transition layer until its next image is there, so
    that it is never missing for a moment.
    """

    def __init__(
        self,
        session: Session,
        has_sprite: Callable[[int], bool],
        is_repacked: Callable[[int], bool],
    ) -> None:
        self._session = session
        self._has_sprite, self._is_repacked = has_sprite, is_repacked
        self._landed: dict[int, Pose | None] = {}
        self.turning: dict[int, Pose] = {}
        self.carried: dict[int, Pose] = {}
        self.inspection: Inspection | None = None

    @property
    def flying(self) -> bool:
        """Whether a flight is in the air."""
        return bool(self._session.flights)

    @property
    def turned_by_hand(self) -> int:
        """The inspected object that a drag turns; 0 where there is none, or it is in the bag."""
        one = self.inspection
        return 0 if one is None or one.leaving or one.home is None else one.object_id

    @property
    def landing(self) -> bool:
        """Whether something that has landed waits for its next image."""
        return bool(self._landed)

    def active(self, now: float) -> bool:
        """Whether anything moves by itself or waits for its next image."""
        going = self.inspection is not None and not self.inspection.still(now)
        return self.flying or going or bool(self._landed)

    def arrivals(self, now: float) -> list[int]:
        """List the flights that have arrived."""
        return [i for i, flight in self._session.flights.items() if flight.done(now)]

    def landed(self, object_id: int, target: Pose | None) -> None:
        """Keep showing a landed object.

        Parameters
        ----------
        object_id : int
        target : Pose or None
            Its slot; None for its packed place.
        """
        self._landed[object_id] = target

    def moving(self, now: float, frame: Frame) -> dict[int, Moving]:
        """Return where everything is now.

        Parameters
        ----------
        now : float
            s, on the session's clock.
        frame : Frame
            What the canvas shows.
        """
        session, camera = self._session, frame.camera
        # Not before its sprite is there, or it would be gone for a moment.
        self._landed = {i: p for i, p in self._landed.items() if not self._shown_elsewhere(i)}
        objects: dict[int, Moving] = {}
        for object_id, flight in dict(session.flights).items():
            pose, flatness = flight.pose(now, camera), flight.flatness(now, camera)
            objects[object_id] = Moving(pose, flatness=flatness)
        for object_id, slot in self._landed.items():
            if object_id in session.poses:
                landed = Moving(slot or session.poses[object_id], flatness=1.0)
            else:
                center = session.boxes.center(object_id, session.spacing)
                landed = Moving(packed_pose(center, camera))
            # One that flies again is where its flight says.
            objects.setdefault(object_id, landed)
        for object_id, pose in self.turning.items():
            # A command may send it away while the mouse button is still down.
            if object_id in session.poses:
                objects[object_id] = Moving(pose, flatness=1.0)
        if self.inspection is not None:
            one = self.inspection
            center = session.boxes.center(one.object_id, session.spacing)
            pose = one.pose(now, frame, center)
            # A turned one is cast coarsely, so that it follows the hand.
            still = one.still(now) and one.object_id not in self.turning
            objects[one.object_id] = Moving(pose, True, still, one.flatness(now))
        return objects

    def turn(self, object_id: int, rotation: Matrix) -> None:
        """Turn an object under the hand.

        Parameters
        ----------
        object_id : int
        rotation : (3, 3) ndarray of float64
            Of pivot space.
        """
        if self.inspection is not None and self.inspection.object_id == object_id:
            self.inspection = self.inspection.turned(rotation)
        elif object_id in self._session.poses:
            pose = self.turning.get(object_id) or self._session.poses[object_id]
            self.turning[object_id] = self._session.pose_turned(object_id, rotation @ pose.rotation)

    def begin_inspection(self, object_id: int, frame: Frame, now: float) -> None:
        """Bring an object to the middle of the view.

        Parameters
        ----------
        object_id : int
        frame : Frame
            What the canvas shows.
        now : float
            s, on the session's clock.
        """
        session, camera = self._session, frame.camera
        home = session.poses.get(object_id)
        diameter = 2 * session.boxes.radius(object_id, session.spacing, camera.stretch)
        rotation = camera.rotation if home is None else home.rotation
        self.inspection = Inspection(object_id, home, diameter, rotation, now, camera.height)

    def view_changed(self, now: float) -> None:
        """Take note that the camera moves: what is inspected in the bag is cast coarsely then.

        Parameters
        ----------
        now : float
            s, on the session's clock.
        """
        one = self.inspection
        if one is not None and one.home is None and not one.leaving:
            self.inspection = replace(one, since=now)

    def _shown_elsewhere(self, object_id: int) -> bool:
        # Asked of what it is now: a command may have put it elsewhere since it landed.
        match self._session.states.get(object_id):
            case ObjectState.PACKED:
                return self._is_repacked(object_id)
            case ObjectState.UNPACKED:
                return self._has_sprite(object_id)
        return True


# A window being dragged replans slots many times a second: glides must keep up.
GLIDE_SECONDS = 0.25


@dataclass(frozen=True, eq=False)
class Glide:
    """One sprite's way: a pure function of time.

    Parameters
    ----------
    origin, target : Pose
        Pivot space; only place and size glide.
    start : float
        When it sets off, s.
    """

    origin: Pose
    target: Pose
    start: float

    def done(self, time: float) -> bool:
        """Tell whether it has arrived."""
        return time >= self.start + GLIDE_SECONDS

    def pose(self, time: float, held: Pose) -> Pose:
        """Return where it is and how large, at rest at both ends.

        Parameters
        ----------
        time : float
            s, on the clock of `start`.
        held : Pose
            How it is turned.
        """
        here = self.origin.toward(self.target, ease((time - self.start) / GLIDE_SECONDS))
        return replace(held, center=here.center, scale=here.scale)


class Glides:
    """Lets sprites glide wherever their slots were planned anew.

    Parameters
    ----------
    scheduler : Scheduler
    moved : callable
        Called at every moment of a glide.
    allowed : callable
        Returns False where the desktop asks for reduced motion: all jump.
    clock : callable, optional
        Returns the time, s; by default the scheduler's.

    Notes
    -----
    The quads of sprites lie in pivot space, so that nothing is cast and nothing uploaded.
    """

    def __init__(
        self,
        scheduler: Scheduler,
        moved: Callable[[], None],
        allowed: Callable[[], bool],
        clock: Callable[[], float] | None = None,
    ) -> None:
        self._moved, self._allowed = moved, allowed
        self.animation = scheduler.animate(self._tick, clock)
        self._plan: object = None
        self._poses: dict[int, Pose] = {}
        self._glides: dict[int, Glide] = {}

    @property
    def settled(self) -> bool:
        """Whether all sprites are where they belong."""
        return not self._glides

    def follow(self, poses: Mapping[int, Pose], plan: object) -> dict[int, Pose]:
        """Return where sprites are now.

        Parameters
        ----------
        poses : {id: Pose}
            Where they belong.
        plan : object
            Of the slots; another one lets those glide whose slots have moved. A sprite that
            moves under the same plan was moved by hand.
        """
        now = self.animation.now()
        planned_anew = self._plan is not None and plan is not self._plan and self._allowed()
        glides = {}
        for object_id, pose in poses.items():
            before = self._poses.get(object_id)
            glide = self._glides.get(object_id)
            if before is not None and _apart(before, pose):
                # Planned anew in the middle of a glide it goes on from where it is.
                origin = before if glide is None else glide.pose(now, before)
                glide = Glide(origin, pose, now) if planned_anew else None
            if glide is not None and not glide.done(now):
                glides[object_id] = glide
        self._plan, self._poses, self._glides = plan, dict(poses), glides
        if glides:
            self.animation.start()
        return dict(poses) | {i: glide.pose(now, poses[i]) for i, glide in glides.items()}

    def finish(self) -> None:
        """Have all where they belong, at once."""
        if self._glides:
            self._glides = {}
            self._moved()

    def close(self) -> None:
        """Move nothing more."""
        self.animation.stop()
        self._glides = {}

    def _tick(self, now: float) -> None:
        # First: what is told here finds out which glides are done.
        self._moved()
        if not self._glides:
            self.animation.stop()


def _apart(a: Pose, b: Pose) -> bool:
    return a.scale != b.scale or bool((a.center != b.center).any())
