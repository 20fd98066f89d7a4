"""The flight of an object out of the bag and back: a pure function of time and camera.

Key frames: packed, clear of the bag's box along D, at its slot. The first two stand in the bag and
turn with it, the last stands in pivot space. Each is evaluated with the camera of the moment, so a
flight is right while the bag turns, and the way back is the way out run backwards. A slot may lie
on the other side of the bag than the one an object leaves by: then the path goes on along D until
it is clear of a ball around the bag, and then around the ball.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.axes import Vector, unit
from napari_unpack.geometry.easing import ease
from napari_unpack.geometry.transforms import Pose, packed_pose
from napari_unpack.geometry.view import Camera

# Parts of the way: on along D until the first, round the bag from the second.
STRAIGHT_UNTIL = 0.5
TURNING_FROM = 0.2
# Of the ball's radius: what is clear of the ball already goes on so far, to turn in a curve.
LEAST_STRAIGHT = 0.15


@dataclass(frozen=True, eq=False)
class Ball:
    """What no object may fly through.

    Parameters
    ----------
    center : (3,) ndarray of float64
        Of the bag, world mm.
    radius : float
        Of the bag and of the objects that fly together, mm of pivot space.
    """

    center: Vector
    radius: float


def path_around_bag(
    start: Vector,
    along: Vector,
    target: Vector,
    center: Vector,
    radius: float,
    gone: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return places, (N, 3), on the way round a ball, all in pivot space, mm.

    Parameters
    ----------
    start : (3,) ndarray of float64
        Where the way begins.
    along : (3,) ndarray of float64
        D, a unit vector.
    target : (3,) ndarray of float64
        Where it ends.
    center, radius
        The ball.
    gone : (N,) ndarray of float64
        How much of the way is behind, 0 to 1.

    Notes
    -----
    Directions from the centre are interpolated along the arc between them, distances from it
    linearly. Towards the opposite side the arc passes on the viewer's side.
    """
    out = 1.0 - np.maximum(0.0, 1.0 - gone / STRAIGHT_UNTIL) ** 2
    straight = max(_way_out(start - center, along, radius), LEAST_STRAIGHT * radius)
    first = start - center + (straight * out)[:, None] * along
    last = target - center
    turned = np.array([[ease((g - TURNING_FROM) / (1.0 - TURNING_FROM))] for g in gone])
    near, far = np.linalg.norm(first, axis=1, keepdims=True), float(np.linalg.norm(last))
    # From the centre itself no direction can be turned: go straight.
    if min(float(near.min()), far) < 1e-9 * radius:
        return center + (1.0 - turned) * first + turned * last
    a, b = first / near, last / far
    across = a @ b
    side = b - across[:, None] * a
    sine = np.linalg.norm(side, axis=1)
    # Towards the viewer, or down where that is the way already.
    towards = np.where((abs(a[:, :1]) < 0.9), np.eye(3)[0], np.eye(3)[1])
    towards = towards - np.einsum("ij,ij->i", a, towards)[:, None] * a
    side = np.where(sine[:, None] < 1e-3, towards, side)
    side = side / np.linalg.norm(side, axis=1, keepdims=True)
    # atan2 is exact at both ends, where acos loses half its digits.
    angle = turned * np.arctan2(sine, across)[:, None]
    arc = np.cos(angle) * a + np.sin(angle) * side
    places: NDArray[np.float64] = center + ((1.0 - turned) * near + turned * far) * arc
    # Exactly, so that a landed object does not move by a rounding error.
    places[turned[:, 0] >= 1.0] = target
    return places


def _way_out(start: Vector, along: Vector, radius: float) -> float:
    """Return how far it is along a unit vector until out of a ball about the origin, mm."""
    towards = float(start @ along)
    inside = radius**2 - float(start @ start)
    return 0.0 if inside <= 0.0 else float(np.sqrt(towards**2 + inside)) - towards


# Least and most of a flight's time spent on the way along D.
SHARE_OF_FIRST_LEG = (0.22, 0.42)
# How long a second leg usually is, in radii of the ball: median of 132 flights of three simulated
# bags, a tenth of them shorter than 1.5, a tenth longer than 2.3.
USUAL_SECOND_LEG = 1.85
# A movement that begins faster than this many times its mean would overshoot and come back
# (Fritsch and Carlson 1980, SIAM J. Numer. Anal. 17, monotone cubics).
FASTEST_ENTRY = 3.0
# Places on the second leg between which its length is measured. With half as many, the speed
# changes by a tenth of its mean between two of them.
SAMPLES = 129

# No object flies further towards the viewer than this fraction of the eye's distance, or than it
# stood in the bag.
NEAREST_TO_EYE = 0.6


def clearance(
    lower: ArrayLike, upper: ArrayLike, bag_lower: ArrayLike, bag_upper: ArrayLike, d: ArrayLike
) -> float:
    """Return how far along d an object must go until its box is clear of the bag's, mm; 0 if it is.

    Parameters
    ----------
    lower, upper : (3,) array_like
        The object's axis-aligned box, world mm.
    bag_lower, bag_upper : (3,) array_like
        The bag's.
    d : (3,) array_like
        Unit vector in world.
    """
    low, high = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    bag_low, bag_high = np.asarray(bag_lower, dtype=float), np.asarray(bag_upper, dtype=float)
    if (low >= bag_high).any() or (high <= bag_low).any():
        return 0.0
    direction = np.asarray(d, dtype=float)
    distances = np.where(direction > 0, bag_high - low, high - bag_low)
    with np.errstate(divide="ignore"):
        return float(np.min(np.where(direction != 0, distances / np.abs(direction), np.inf)))


@dataclass(frozen=True, eq=False)
class Flight:
    """One object on its way.

    Parameters
    ----------
    object_id : int
        Whose flight.
    box_center : (3,) ndarray of float64
        Centre of the object's box at its packed place, world mm (the paper's o).
    direction : (3,) ndarray of float64
        The D it was tested for, unit vector in world.
    clear : float
        Length of the first leg, mm.
    target : Pose
        Its place outside the bag (the paper's u), pivot space.
    around : Ball
        What the second leg leads round: the bag.
    start : float
        When it leaves, s, on whatever clock `pose` is asked with.
    seconds : float
        How long it takes.
    back : bool
        True on the way into the bag.
    before : Flight, optional
        The flight that it was until it was sent elsewhere: it turns from one to the other.
    sent : float
        When that was, s.

    Raises
    ------
    ValueError
        If `seconds` is not positive.
    """

    object_id: int
    box_center: Vector
    direction: Vector
    clear: float
    target: Pose
    around: Ball
    start: float = 0.0
    seconds: float = 1.5
    back: bool = False
    before: Flight | None = None
    sent: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.seconds) and self.seconds > 0):
            raise ValueError(f"seconds must be positive, got {self.seconds!r}")

    def progress(self, time: float) -> float:
        """Return the fraction of the flight's time that has passed, 0 to 1."""
        return float(np.clip((time - self.start) / self.seconds, 0.0, 1.0))

    def done(self, time: float) -> bool:
        """Tell whether it has arrived."""
        return time >= self.start + self.seconds

    def pose(self, time: float, camera: Camera) -> Pose:
        """Return where the object is, pivot space.

        Parameters
        ----------
        time : float
            Seconds on the clock of `start`; clamped to the flight.
        camera : Camera
            The camera of now.

        Notes
        -----
        Li et al. 2012, sections 5.2 and 5.3, with linear interpolation between key frames
        replaced by one that starts and ends at rest, is as fast before as after it is clear of
        the bag's box, and from there on goes along a curve. Deviation: the first leg goes
        along D whatever D is (docs/paper.md, R12).
        """
        pose = self.pose_at(self._share_of_way_out(time), camera)
        if self.before is None:
            return pose
        return self.before.pose(time, camera).toward(pose, self._share_of_turn(time))

    def pose_at(self, fraction: float, camera: Camera) -> Pose:
        """Return the pose at a fraction.

        Parameters
        ----------
        fraction : float
            Of the way out: 0 packed, 1 at the target.
        camera : Camera
            Whose pivot space it is.
        """
        return self.legs(camera).pose_at(fraction)

    def legs(self, camera: Camera) -> Legs:
        """Return the way out as a camera sees it, for many poses on it."""
        leaving = packed_pose(self.box_center, camera)
        outside = packed_pose(self.box_center, camera, self.direction * self.clear)
        leg = outside.center - leaving.center
        length = float(np.linalg.norm(leg))
        room = _nearest_depth(leaving, camera) - leaving.center[0]
        cut = 1.0
        if leg[0] > room:
            # Along D still, so that it meets nothing there.
            cut = float(room / leg[0])
            outside = replace(outside, center=leaving.center + cut * leg)
        if length == 0.0:
            return Legs(self, camera, leaving, outside, 0.0)
        # The same for all that leave together, wherever each is going.
        share = length / (length + USUAL_SECOND_LEG * self.around.radius)
        first = cut * float(np.clip(share, *SHARE_OF_FIRST_LEG))
        return Legs(self, camera, leaving, outside, first)

    def flatness(self, time: float, camera: Camera) -> float:
        """Return how flat it is seen: 0 in the bag, 1 at its slot, as its sprite is.

        Parameters
        ----------
        time, camera
            As for `pose`.
        """
        first = self.first_leg(camera)
        # Among its neighbours it is seen as they are.
        flatness = ease((self._share_of_way_out(time) - first) / (1.0 - first))
        if self.before is None:
            return flatness
        turned = self._share_of_turn(time)
        return (1.0 - turned) * self.before.flatness(time, camera) + turned * flatness

    def _share_of_way_out(self, time: float) -> float:
        passed = self.progress(time)
        return 1.0 - passed if self.back else passed

    def _share_of_turn(self, time: float) -> float:
        """Return how much of this flight, and not of the one before, is seen by now."""
        return ease((time - self.sent) / (self.start + self.seconds - self.sent))

    def first_leg(self, camera: Camera) -> float:
        """Return the fraction of the way out at which it is clear of the bag's box."""
        return self.legs(camera).first

    def reversed(self, time: float) -> Flight:
        """Return the flight that turns round at this time, from where the object is then."""
        start = time - (1.0 - self.progress(time)) * self.seconds
        # Half way from one place to another it is on neither's way.
        bends = self.before is not None and not self.done(time)
        before = self if bends else None
        return replace(self, back=not self.back, start=start, before=before, sent=time)

    def toward(self, target: Pose, time: float | None = None) -> Flight:
        """Return the same flight with another place outside the bag.

        Parameters
        ----------
        target : Pose
            Where, in pivot space.
        time : float, optional
            When it turns there, from where it is then; by default it is on the way there at once,
            and a turn that has begun goes on. A flight that goes there already stays as it is.

        Notes
        -----
        To turn takes half a flight's time at least: what is nearly at its slot, or stands
        there still, would jump to another one.
        """
        if self.target.is_at(target):
            return self
        if time is None:
            return replace(self, target=target)
        # In the bag it stands where it does wherever it goes.
        if self._share_of_way_out(time) == 0.0:
            return replace(self, target=target, before=None)
        start = self.start if self.back else max(self.start, time - self.seconds / 2)
        return replace(self, target=target, start=start, before=self, sent=time)


@dataclass(frozen=True, eq=False)
class Legs:
    """A flight's two legs as one camera sees them; the second is measured once.

    Parameters
    ----------
    flight : Flight
    camera : Camera
        Whose pivot space it is.
    leaving, outside : Pose
        Where the first leg begins and ends.
    first : float
        The first leg's share of the way.
    """

    flight: Flight
    camera: Camera
    leaving: Pose
    outside: Pose
    first: float

    def pose_at(self, fraction: float) -> Pose:
        """Return the pose at a fraction of the way: 0 packed, 1 at the target."""
        leaving, outside, first = self.leaving, self.outside, self.first
        if fraction < first:
            gone = (fraction / first) ** 2
            center = (1 - gone) * leaving.center + gone * outside.center
            return replace(leaving, center=center)
        rest = (fraction - first) / (1.0 - first)
        steps, lengths = self._measured
        # As fast as the first leg ends: (f / first)^2 of its length.
        leg = float(np.linalg.norm(outside.center - leaving.center))
        entry = 2.0 * leg / first * (1.0 - first) / lengths[-1] if first else 0.0
        gone = _entered(rest, min(entry, FASTEST_ENTRY))
        [place] = self._places(np.interp([gone * lengths[-1]], lengths, steps))
        target = self.flight.target
        turned = outside.toward(target, ease(rest))
        # Small before it is there, large only once there: an object still large beside its slot
        # would leave the window.
        sized = 1.0 - (1.0 - gone) ** 2 if target.scale < 1.0 else gone**2
        return replace(turned, center=place, scale=target.scale**sized)

    @cached_property
    def _measured(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Shares of the second leg, and how long the way is until each, mm."""
        steps = np.linspace(0.0, 1.0, SAMPLES)
        places = self._places(steps)
        lengths = np.cumsum(np.linalg.norm(np.diff(places, axis=0, prepend=places[:1]), axis=1))
        # What stands still all the way still turns and changes its size.
        lengths += 1e-3 * self.flight.around.radius * steps
        return steps, lengths

    def _places(self, gone: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return places on the second leg, (N, 3), pivot space mm."""
        flight, around = self.flight, self.flight.around
        along = unit(self.camera.linear @ flight.direction)
        middle = packed_pose(around.center, self.camera).center
        ends = self.outside.center, along, flight.target.center
        places = path_around_bag(*ends, middle, around.radius, gone)
        places[:, 0] = np.minimum(places[:, 0], _nearest_depth(self.leaving, self.camera))
        return places


def _nearest_depth(leaving: Pose, camera: Camera) -> float:
    """Return how near to the viewer an object may fly, pivot space mm: never back for that."""
    return max(NEAREST_TO_EYE * camera.distance, float(leaving.center[0]))


def _entered(passed: float, speed: float) -> float:
    """Return how far a movement is that begins with a speed and ends at rest, 0 to 1.

    The cubic h with h(0) = 0, h(1) = 1, h'(0) = speed, h'(1) = 0 (Hermite); the speed is in
    ways a movement's time.
    """
    return speed * passed * (1.0 - passed) ** 2 + ease(passed)
