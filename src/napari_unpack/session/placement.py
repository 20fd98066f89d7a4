"""Out of the bag and back: who keeps which place, and the flights there."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import Matrix, Vector
from napari_unpack.geometry.boxes import LabelBoxes
from napari_unpack.geometry.transforms import Pose
from napari_unpack.geometry.view import Camera
from napari_unpack.session.state import Placement
from napari_unpack.unpacking import (
    Ball,
    Flight,
    OrientedBox,
    Slots,
    broad_side,
    clearance,
    hull_vertices,
    image_extent,
    oriented_box,
    outline,
)

# Between the removals of two groups of one command, in flight times: they are seen one after
# another, and several are in the air at once.
STAGGER = 0.2

UNSTRETCHED = np.eye(3)

# Along each axis, of the voxels that the outline of the whole bag is taken from.
SILHOUETTE_VOXELS = 64

CORNERS = np.indices((2, 2, 2)).reshape(3, 8)
"""Which end of a box each of its corners has along z, y and x."""


@dataclass(frozen=True, eq=False)
class Bag:
    """The packed bag's geometry, which no command changes.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of uint16
        Object IDs.
    boxes : LabelBoxes
        Of these labels.
    spacing : (3,) ndarray of float64
        Voxel size in mm, z y x.
    """

    labels: NDArray[np.uint16]
    boxes: LabelBoxes
    spacing: NDArray[np.float64]
    _oriented: dict[tuple[int, bytes], OrientedBox] = field(default_factory=dict, repr=False)
    _radii: dict[bytes, float] = field(default_factory=dict, repr=False)
    _hulls: dict[int, NDArray[np.float64]] = field(default_factory=dict, repr=False)

    @property
    def lower(self) -> Vector:
        """Lower corner of the box around all objects, world mm."""
        # Voxel centres are at integers, so voxels begin half a voxel before.
        return np.asarray((self.boxes.lower.min(axis=0) - 0.5) * self.spacing)

    @property
    def upper(self) -> Vector:
        """Upper corner of the box around all objects, world mm."""
        return np.asarray((self.boxes.upper.max(axis=0) - 0.5) * self.spacing)

    @property
    def center(self) -> Vector:
        """Middle of the box around all objects, world mm."""
        return (self.lower + self.upper) / 2

    @cached_property
    def silhouette(self) -> NDArray[np.float64]:
        """(n, 3) corners of the hull of all objects, world mm, to within a sixtieth of the bag."""
        # Every k-th voxel: to frame the bag no more is needed, and large volumes have millions.
        steps = tuple(-(-n // SILHOUETTE_VOXELS) for n in self.labels.shape)
        coarse = self.labels[tuple(slice(None, None, k) for k in steps)]
        points = outline(coarse > 0, (0, 0, 0), self.spacing * steps)
        # Where all is smaller than k voxels, its boxes tell as much.
        return hull_vertices(points) if len(points) else np.stack([self.lower, self.upper])

    def radius_in(self, stretch: Matrix) -> float:
        """Return the radius of the sphere about `center` that holds every object's box, mm.

        Of a world that is stretched so (`Camera.stretch`).
        """
        # Slots ask for it at every redraw, and large bags have thousands of boxes.
        key = stretch.tobytes()
        if key not in self._radii:
            ends = np.stack([self.boxes.lower - 0.5, self.boxes.upper - 0.5]) * self.spacing
            ends -= self.center
            corners = np.stack([ends[c, :, axis] for axis, c in enumerate(CORNERS)], axis=-1)
            self._radii[key] = float(np.linalg.norm(corners @ stretch.T, axis=-1).max())
        return self._radii[key]

    def depths(self, direction: Vector) -> dict[int, float]:
        """Return by ID how far an object's box reaches along a direction, mm, foremost least."""
        middle = (self.boxes.lower + self.boxes.upper - 1) / 2 * self.spacing
        half = (self.boxes.upper - self.boxes.lower) / 2 * self.spacing
        # Faces in one plane are to be equal, whatever the sums leave: a millionth of a voxel.
        reach = np.round((middle @ direction + half @ np.abs(direction)) / min(self.spacing), 6)
        reach *= min(self.spacing)
        return {int(i): -float(r) for i, r in zip(self.boxes.ids, reach, strict=True)}

    def points(self, object_id: int) -> NDArray[np.float64]:
        """Return (n, 3) voxel centres around an object, world mm."""
        part = self.boxes.slices(object_id)
        origin = [axis.start for axis in part]
        return outline(self.labels[part] == object_id, origin, self.spacing)

    def outer_points(self) -> NDArray[np.float64]:
        """Return (n, 3) voxel centres around everything, world mm."""
        return outline(self.labels > 0, (0, 0, 0), self.spacing)

    def ball(self, object_id: int, pose: Pose) -> Ball:
        """Return what the centre of an object that is going to a pose must keep out of.

        Parameters
        ----------
        object_id : int
        pose : Pose
            Where it is going, in pivot space.
        """
        # A ball holds it however it turns on the way.
        half = self.boxes.radius(object_id, self.spacing, pose.stretch)
        return Ball(self.center, self.radius_in(pose.stretch) + half * max(1.0, pose.scale))

    def clear_way(self, group: Iterable[int], direction: Vector) -> float:
        """Return how far a group must go together until every member is clear of the bag, mm.

        Parameters
        ----------
        group : iterable of int
        direction : (3,) ndarray of float64
            D, unit vector in world.
        """
        ways = []
        for object_id in group:
            corners = self.boxes.corners(object_id, self.spacing)
            low, high = corners.min(axis=0), corners.max(axis=0)
            ways.append(clearance(low, high, self.lower, self.upper, direction))
        return max(ways)

    def unmeasured(self, ids: Iterable[int], stretch: Matrix) -> list[int]:
        """Return the objects whose tightest box in a stretched world is not known yet.

        Parameters
        ----------
        ids : iterable of int
        stretch : (3, 3) ndarray of float64
            As for `oriented`.
        """
        way = _upright(stretch).tobytes()
        return [i for i in ids if (i, way) not in self._oriented]

    def oriented(self, object_id: int, stretch: Matrix = UNSTRETCHED) -> OrientedBox:
        """Return an object's tightest box; a tenth of a second the first time, on any thread.

        Parameters
        ----------
        object_id : int
        stretch : (3, 3) ndarray of float64
            How the bag is stretched (`Camera.stretch`); the box is one of the stretched world.
        """
        upright = _upright(stretch)
        key = object_id, upright.tobytes()
        if key not in self._oriented:
            thickness = np.abs(upright) @ self.spacing
            self._oriented[key] = oriented_box(self.points(object_id) @ upright.T, thickness)
        return self._oriented[key]

    def picture(self, object_id: int, rotation: Matrix, stretch: Matrix) -> tuple[float, float]:
        """Return width and height in mm of an object's picture, held so and stretched so.

        Quick enough for every movement of a hand: the object's hull is kept.

        Parameters
        ----------
        object_id : int
        rotation : (3, 3) ndarray of float64
            How it is held, from (stretched) world axes to pivot axes.
        stretch : (3, 3) ndarray of float64
            How the bag is stretched (`Camera.stretch`).
        """
        # Of all points the hull alone touches the edges of a picture.
        if object_id not in self._hulls:
            self._hulls[object_id] = hull_vertices(self.points(object_id))
        return self._picture(self._hulls[object_id], object_id, rotation @ stretch)

    def placement(
        self, camera: Camera, object_id: int, slot: int, group: Sequence[int], direction: Vector
    ) -> Placement:
        """Choose how an unpacked object is held.

        Parameters
        ----------
        camera : Camera
            The user's: the object's broad side faces it.
        object_id : int
        slot : int
            Its place beside the bag.
        group : sequence of int
            What leaves with it, itself included.
        direction : (3,) ndarray of float64
            Along which, world.
        """
        points = self.points(object_id)
        rotation = broad_side(self.oriented(object_id, camera.stretch), camera.rotation)
        picture = self._picture(points, object_id, rotation @ camera.stretch)
        return Placement(slot, rotation, picture, direction, tuple(group))

    def _picture(
        self, points: NDArray[np.float64], object_id: int, turn: Matrix
    ) -> tuple[float, float]:
        # The middle of its box stands in the middle of its slot: turned, it may reach further to
        # one side, and would stand out of the slot and over the window's edge.
        middle = self.boxes.center(object_id, self.spacing)
        return image_extent(points, turn, self.spacing, middle)


def _upright(stretch: Matrix) -> Matrix:
    # A mirrored box lies as it did.
    upright: Matrix = stretch * np.sign(np.linalg.det(stretch))
    return upright


def launch(
    bag: Bag,
    placements: Mapping[int, Placement],
    slots: Slots,
    stretch: Matrix,
    now: float,
    seconds: float,
    back: bool,
) -> dict[int, Flight]:
    """Make the flights of objects that leave or return with one command.

    Parameters
    ----------
    bag : Bag
    placements : mapping of int to Placement
        Who flies, the first to leave first.
    slots : Slots
        Where they wait.
    stretch : (3, 3) ndarray of float64
        How the bag is stretched (`Camera.stretch`).
    now : float
        When the first departs, s.
    seconds : float
        What one flight takes.
    back : bool
        True towards the bag.

    Returns
    -------
    dict of int to Flight
        Members of a group depart at once and go the same first leg; groups follow each other.
    """
    flights: dict[int, Flight] = {}
    poses = {i: placement.pose(slots, stretch) for i, placement in placements.items()}
    removals: dict[tuple[int, ...], tuple[float, float, Ball]] = {}
    for object_id, placement in placements.items():
        # Members are held together, so they must go the same way at the same time.
        group = placement.group
        if group not in removals:
            start = now + len(removals) * STAGGER * seconds
            balls = [bag.ball(i, poses[i]) for i in group if i in poses]
            around = max(balls, key=lambda ball: ball.radius)
            removals[group] = start, bag.clear_way(group, placement.direction), around
        start, clear, around = removals[group]
        flights[object_id] = Flight(
            object_id,
            bag.boxes.center(object_id, bag.spacing),
            placement.direction,
            clear,
            poses[object_id],
            around,
            start,
            seconds,
            back,
        )
    return flights
