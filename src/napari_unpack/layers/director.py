"""Who moves now, and how: flights, an object under the hand, an object inspected."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from napari_unpack.geometry.axes import Matrix
from napari_unpack.geometry.transforms import Pose, packed_pose
from napari_unpack.layers.inspection import Inspection, inspection_of
from napari_unpack.layers.moving import Moving
from napari_unpack.layers.view_camera import Frame


class Director:
    """Keeps track of everything that is neither packed nor a sprite.

    Parameters
    ----------
    session : Session
        With its flights.
    has_sprite, is_repacked : callable
        Given an ID: whether its sprite is there, whether the packed picture shows it again.

    Notes
    -----
    An object that has landed stays in the transition layer until its next picture is there, so
    that it is never missing for a moment.
    """

    def __init__(
        self,
        session: Any,
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

    def active(self, now: float) -> bool:
        """Whether anything moves by itself or waits for its next picture."""
        going = self.inspection is not None and not self.inspection.still(now)
        return self.flying or going or bool(self._landed)

    def arrivals(self, now: float) -> list[int]:
        """List the flights that have arrived."""
        return [i for i, flight in self._session.flights.items() if flight.done(now)]

    def landed(self, object_id: int, target: Pose | None) -> None:
        """Keep showing a landed object, at its slot or (None) at its packed place."""
        self._landed[object_id] = target

    def moving(self, now: float, frame: Frame) -> dict[int, Moving]:
        """Return where everything is now."""
        session, camera = self._session, frame.camera
        self._landed = {i: p for i, p in self._landed.items() if not self._shown_elsewhere(i, p)}
        objects: dict[int, Moving] = {}
        for object_id, flight in dict(session.flights).items():
            objects[object_id] = Moving(flight.pose(now, camera))
        for object_id, pose in self._landed.items():
            if pose is None:
                center = session.boxes.center(object_id, np.asarray(session.spacing))
                pose = packed_pose(center, camera)
            objects.setdefault(object_id, Moving(pose))
        for object_id, pose in self.turning.items():
            # One that a command sends away is out of the hand, if not yet let go.
            if object_id in session.poses:
                objects[object_id] = Moving(pose)
        if self.inspection is not None:
            one = self.inspection
            pose = one.pose(now, frame.size[1] / frame.size[0])
            still = one.still(now) and one.object_id not in self.turning
            objects[one.object_id] = Moving(pose, in_front=True, sharp=still)
        return objects

    def turn(self, object_id: int, rotation: Matrix) -> None:
        """Turn an object under the hand."""
        if self.inspection is not None and self.inspection.object_id == object_id:
            self.inspection = self.inspection.turned(rotation)
        elif object_id in self._session.poses:
            pose = self.turning.get(object_id) or self._session.poses[object_id]
            self.turning[object_id] = self._session.pose_turned(object_id, rotation @ pose.rotation)

    def begin_inspection(self, object_id: int, frame: Frame, now: float) -> None:
        """Bring an object to the middle of the view."""
        session = self._session
        spacing = np.asarray(session.spacing, dtype=np.float64)
        home = session.poses.get(object_id)
        if home is None:
            home = packed_pose(session.boxes.center(object_id, spacing), frame.camera)
        diameter = 2 * session.boxes.radius(object_id, spacing, frame.camera.stretch)
        self.inspection = inspection_of(object_id, home, diameter, frame.camera, now)

    def _shown_elsewhere(self, object_id: int, target: Pose | None) -> bool:
        if object_id in self._session.flights:
            return True
        return self._is_repacked(object_id) if target is None else self._has_sprite(object_id)
