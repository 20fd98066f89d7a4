"""The handle of the cutting plane in the 3D view: an arrow to push it, a rim to turn it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import Vector, transform_points, unit
from napari_unpack.geometry.boxes import box_corners
from napari_unpack.geometry.view import Camera
from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.gl.depth_quads import Quad
from napari_unpack.session import Session
from napari_unpack.session.object_state import ObjectState
from napari_unpack.viewer.canvas_lines import CanvasLines, Line
from napari_unpack.viewer.interaction import drag_rotation
from napari_unpack.viewer.protocols import Pixel

# Ink and width, as a line is and while the mouse is on it.
INK, CAUGHT = ((1.0, 0.62, 0.25, 0.95), 2.0), ((1.0, 0.92, 0.6, 1.0), 3.0)

# Of the bag's radius: the rim stands clear of most objects, the arrow does not reach it.
RIM, ARROW = 0.8, 0.35
RIM_LINES = 96
# Logical pixels within which a line is caught, and of the arrow's head.
CATCH, HEAD = 7.0, 9.0
# Of a mm of the normal so much must be seen for a push to go along its picture.
LEAST_SEEN = 0.25

Part = Literal["", "arrow", "rim"]


@dataclass(frozen=True, eq=False)
class HandleLines:
    """The lines of a handle on a frame.

    Parameters
    ----------
    rim : (N, 2) ndarray of float64
        Pixels, row and column.
    arrow : (2, 2) ndarray of float64
        From the plane to the side that is cut away.
    """

    rim: NDArray[np.float64]
    arrow: NDArray[np.float64]

    def caught(self, pixel: NDArray[np.float64], reach: float) -> Part:
        """Return which part is at a pixel of the frame.

        Parameters
        ----------
        pixel : (2,) ndarray of float64
        reach : float
            Pixels within which a line is caught.
        """
        if distance_to(self.arrow, pixel) <= reach:
            return "arrow"
        return "rim" if distance_to(self.rim, pixel) <= reach else ""


class CutHandle:
    """Draws the handle of a session's cutting plane, and says what a drag of it does.

    Parameters
    ----------
    session : Session
    pixel_scale : callable
        Returns the device pixels of a logical pixel.
    repaint : callable
        Has the canvas drawn again.
    """

    def __init__(
        self, session: Session, pixel_scale: Callable[[], float], repaint: Callable[[], None]
    ) -> None:
        self._session, self._pixel_scale, self._repaint = session, pixel_scale, repaint
        self._shown, self._caught = True, ""
        self._lines = CanvasLines(pixel_scale)

    @property
    def shown(self) -> bool:
        """Whether the handle is drawn and can be caught; the plane cuts in either case."""
        return self._shown

    @shown.setter
    def shown(self, shown: bool) -> None:
        self._shown = bool(shown)
        self._repaint()

    def quads_at(self, frame: Frame) -> Sequence[Quad]:
        """Return the handle's quads."""
        lines = self.lines(frame)
        if lines is None:
            return ()
        head = arrow_head(lines.arrow, HEAD * self._pixel_scale())
        rim, arrow = (CAUGHT if self._caught == part else INK for part in ("rim", "arrow"))
        drawn = [Line(lines.rim, *rim), *(Line(part, *arrow) for part in (lines.arrow, *head))]
        return self._lines.quads(drawn, frame.size)

    def lines(self, frame: Frame) -> HandleLines | None:
        """Return the handle's lines; None where there is none to be seen.

        Parameters
        ----------
        frame : Frame
            What the canvas shows.
        """
        world = self.points()
        if not len(world):
            return None
        pivot = transform_points(frame.camera.pivot_from_world(), world)
        # Behind the eye it would be drawn on the other side of the view.
        if frame.camera.behind_eye(pivot):
            return None
        pixels = frame.camera.pixels(pivot, frame.size)
        return HandleLines(pixels[: RIM_LINES + 1], pixels[RIM_LINES + 1 :])

    def points(self) -> NDArray[np.float64]:
        """Return the (N, 3) points of its lines, world mm, rim first; none where it is not seen."""
        session = self._session
        inspecting = ObjectState.INSPECTED in session.states.values()
        if session.cutting.plane is None or not self._shown or inspecting:
            return np.zeros((0, 3))
        center, normal = self._center(), session.cutting.plane[1]
        across = np.eye(3)[np.abs(normal).argmin()]
        u = unit(np.cross(normal, across))
        angles = np.linspace(0.0, 2 * np.pi, RIM_LINES + 1)
        circle = np.cos(angles)[:, None] * u + np.sin(angles)[:, None] * np.cross(normal, u)
        radius = session.bag.radius_in(np.eye(3))
        arrow = [0 * normal, -ARROW * radius * normal]
        points: NDArray[np.float64] = center + np.concatenate([RIM * radius * circle, arrow])
        return points

    def point_at(self, pixel: NDArray[np.float64] | None, frame: Frame | None) -> Part:
        """Light up what the mouse is on, and return it.

        Parameters
        ----------
        pixel : (2,) ndarray of float64, optional
            Of the frame.
        frame : Frame, optional
        """
        lines = None if frame is None or pixel is None else self.lines(frame)
        caught: Part = ""
        if lines is not None and pixel is not None:
            caught = lines.caught(pixel, CATCH * self._pixel_scale())
        if caught != self._caught:
            self._caught = caught
            self._repaint()
        return caught

    def push(self, pixels: Pixel, frame: Frame, merge: bool = False) -> None:
        """Move the plane along its normal, as far as the arrow's picture goes along.

        Parameters
        ----------
        pixels : (2,) ndarray of float64
            Way of the mouse, pixels of the frame, rows down and columns to the right.
        frame : Frame
        merge : bool
            Whether the same drag has moved it before: one step of undo takes all of it back.
        """
        plane = self._session.cutting.plane
        if plane is None:
            return
        normal, center = plane[1], self._center()
        per_mm = frame.size[0] / frame.camera.height
        seen = (frame.camera.linear @ normal)[1:] * per_mm
        if np.linalg.norm(seen) >= LEAST_SEEN * per_mm:
            mm = float(pixels @ seen / (seen @ seen))
        else:
            # The arrow points at the viewer: down is nearer, as if one pulled it.
            towards = float(np.sign((frame.camera.linear @ normal)[0])) or 1.0
            mm = towards * float(pixels[0]) / per_mm
        self._place(float((center - self._session.bag.center) @ normal) + mm, normal, merge)

    def turn(self, pixels: Pixel, frame: Frame, merge: bool = False) -> None:
        """Turn the plane about its middle, as sprites are turned.

        Parameters
        ----------
        pixels : (2,) ndarray of float64
            Way of the mouse, rows down and columns to the right.
        frame : Frame
        merge : bool
            As for `push`.
        """
        plane = self._session.cutting.plane
        if plane is not None:
            held = frame.camera.rotation
            normal = unit(held.T @ drag_rotation(pixels) @ held @ plane[1])
            middle = self._center()
            self._place(float((middle - self._session.bag.center) @ normal), normal, merge)

    def cut_along(self, normal: Vector, share: float = 0.5, merge: bool = False) -> None:
        """Put the plane across a direction.

        Parameters
        ----------
        normal : (3,) ndarray of float64
            World; what lies against it is cut away.
        share : float
            Of the bag that is cut away, from 0 to 1 along the normal.
        merge : bool
            As for `push`.
        """
        reach = self._reach(unit(normal))
        self._place(reach * (2.0 * share - 1.0), unit(normal), merge)

    @property
    def share(self) -> float:
        """How much of the bag is cut away, from 0 to 1 along the normal."""
        plane, bag = self._session.cutting.plane, self._session.bag
        if plane is None:
            return 0.0
        along = float((plane[0] - bag.center) @ plane[1])
        return float(np.clip((along / self._reach(plane[1]) + 1.0) / 2.0, 0.0, 1.0))

    def _center(self) -> Vector:
        """Return the point of the plane that is nearest to the bag's middle, world mm."""
        plane, middle = self._session.cutting.plane, self._session.bag.center
        assert plane is not None
        near: Vector = middle + ((plane[0] - middle) @ plane[1]) * plane[1]
        return near

    def _reach(self, normal: Vector) -> float:
        bag = self._session.bag
        corners = box_corners(bag.lower, bag.upper) - bag.center
        return float(np.abs(corners @ normal).max())

    def _place(self, along: float, normal: Vector, merge: bool) -> None:
        reach = self._reach(normal)
        # Beyond the bag it would cut nothing, and its handle be out of the window.
        along = float(np.clip(along, -reach, reach))
        plane = np.stack([self._session.bag.center + along * normal, normal])
        self._session.cutting.move_plane(plane, merge)
        self._repaint()


def facing(camera: Camera) -> Vector:
    """Return the normal of the plane that cuts away what is nearest to the viewer."""
    # A covector: under a stretch the plane across the view is not across the way of looking.
    return unit(-camera.linear[0])


def distance_to(line: NDArray[np.float64], pixel: NDArray[np.float64]) -> float:
    """Return the distance of a point from a line of straight pieces.

    Parameters
    ----------
    line : (N, 2) ndarray of float64
    pixel : (2,) ndarray of float64
    """
    start, way = line[:-1], np.diff(line, axis=0)
    squares = np.maximum((way**2).sum(axis=1), 1e-12)
    share = np.clip(((pixel - start) * way).sum(axis=1) / squares, 0.0, 1.0)
    return float(np.linalg.norm(start + share[:, None] * way - pixel, axis=1).min())


def arrow_head(arrow: NDArray[np.float64], length: float) -> NDArray[np.float64]:
    """Return the two sides of an arrow's head, (2, 2, 2); a cross where it points at the eye.

    Parameters
    ----------
    arrow : (2, 2) ndarray of float64
        Its start and tip, pixels.
    length : float
        Of a side.
    """
    way, tip = arrow[1] - arrow[0], arrow[1]
    if np.linalg.norm(way) < 1.0:
        arms = length * np.array([[0.7, 0.7], [0.7, -0.7]])
        return np.stack([tip - arms, tip + arms], axis=1)
    back = -way / np.linalg.norm(way)
    side = 0.6 * np.array([-back[1], back[0]])
    return np.array([[tip, tip + length * (back + sign * side)] for sign in (1.0, -1.0)])
