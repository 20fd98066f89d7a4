"""The direction in which objects leave, as an arrow in the 3D view: shown, and drawn by hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import Vector, transform_points, triple, unit
from napari_unpack.geometry.view import Camera
from napari_unpack.layers.rendered_image import FRONT
from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.gl.depth_quads import Quad
from napari_unpack.rendering.gl.lines import Stroke
from napari_unpack.session.object_state import ObjectState
from napari_unpack.viewer.protocols import Pixel
from napari_unpack.viewer.surface_points import surface_normal

if TYPE_CHECKING:
    from napari_unpack.session import Session
    from napari_unpack.viewer.brush import Brush
    from napari_unpack.viewer.controller import SessionController

INK = (0.45, 0.9, 1.0, 1.0)
# A dark line under it, or it would be lost on bright objects.
HALO = (0.0, 0.0, 0.0, 0.55)
# Length of the head's sides, as a part of the arrow.
HEAD = 0.16

# A drag shorter than this draws no direction.
LEAST_PIXELS = 12.0

# A press of an arrow key turns the arrow by so much, as it turns the bag.
KEY_RADIANS = np.pi / 12


class DirectionArrow:
    """Draws an arrow before everything else.

    Parameters
    ----------
    session : Session
        Its direction is shown where it is not the view's own.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._strokes = [Stroke(HALO, 3.5) for _ in range(3)] + [Stroke(INK, 1.8) for _ in range(3)]
        self.drawn: NDArray[np.float64] | None = None
        """(2, 2) start and end of an arrow under the hand, pixels of the frame."""

    def middle(self, frame: Frame) -> NDArray[np.float64]:
        """Return the (2,) pixel of a frame, row and column, at which the bag's middle is."""
        return frame.camera.project(self._session.bag.center, frame.size)

    def quads_at(self, frame: Frame) -> Sequence[Quad]:
        """Return the arrow's quads: none where objects leave towards the viewer."""
        ends = self.ends(frame)
        if ends is None:
            return ()
        lines = arrow_lines(ends)
        quads = [
            stroke.quad(line, frame.camera, frame.size, 1.0)
            for stroke, line in zip(self._strokes, lines * 2, strict=True)
        ]
        return [
            replace(quad, place=replace(quad.place, ndc_depth=FRONT))
            for quad in quads
            if quad is not None
        ]

    def ends(self, frame: Frame) -> NDArray[np.float64] | None:
        """Return its (2, 3) start and tip in pivot space; None where there is no arrow."""
        if self.drawn is not None:
            return np.stack([frame.camera.ray(pixel, frame.size)[0] for pixel in self.drawn])
        inspecting = ObjectState.INSPECTED in self._session.states.values()
        if self._session.direction is None or inspecting:
            return None
        bag, camera = self._session.bag, frame.camera
        start = transform_points(camera.pivot_from_world(), bag.center)
        way = unit(camera.linear @ self._session.unpack_direction)
        points = np.stack([start, start + 1.05 * bag.radius_in(camera.stretch) * way])
        # Flat: a tip that comes near the eye in perspective would fill the view.
        points[:, 0] = 0.0
        return points


class Pencil:
    """Draws the direction in which objects leave: by a drag of the mouse, or by keys.

    Parameters
    ----------
    target : SessionController
        The controller.
    frame_pixel : callable
        Given a pixel of the canvas, returns that of the frame.
    brush : Brush
        Put down while an arrow is drawn.

    Attributes
    ----------
    drawing : bool
        Whether it waits for an arrow.
    """

    def __init__(
        self,
        target: SessionController,
        frame_pixel: Callable[[Pixel], tuple[float, float]],
        brush: Brush,
    ) -> None:
        self.drawing = False
        self._target, self._frame_pixel, self._brush = target, frame_pixel, brush

    def begin(self) -> None:
        """Wait for an arrow; a tool that takes clicks is called off."""
        tool = self._target.interaction.tool
        if tool is not None:
            tool.cancel()
        self.drawing = True
        self._brush.put_down()

    def show(self, start: Pixel, end: Pixel) -> None:
        """Show an arrow under the hand.

        Parameters
        ----------
        start, end : (2,) ndarray of float64
            Pixels of the canvas.
        """
        self._show(np.array([self._frame_pixel(start), self._frame_pixel(end)]))

    def take(self, start: Pixel, end: Pixel, along_normal: bool) -> None:
        """Let objects leave along an arrow.

        Parameters
        ----------
        start, end : (2,) ndarray of float64
            Pixels of the canvas.
        along_normal : bool
            Along the normal of the surface under its start instead; towards the viewer where
            there is none.
        """
        pixels = np.array([self._frame_pixel(start), self._frame_pixel(end)])
        self._take(pixels, along_normal)

    def turn(self, way: Sequence[float]) -> None:
        """Turn the arrow by a step, or begin one at the bag's middle.

        Parameters
        ----------
        way : (2,) sequence of float
            Unit vector, rows down and columns to the right: begun, the arrow points there, and
            then it turns towards it.
        """
        frame, arrow = self._target.renderer.frame, self._target.overlays.arrow
        if not self.drawing or frame is None:
            return
        if arrow.drawn is None:
            start = arrow.middle(frame)
            # As long as the arrow of a direction that was taken.
            length = self._target.session.bag.radius_in(frame.camera.stretch)
            tip = start + length * frame.size[0] / frame.camera.height * np.asarray(way)
            self._show(np.stack([start, tip]))
        else:
            self._show(turned_towards(arrow.drawn, way))

    def take_turned(self, along_normal: bool = False) -> None:
        """Let objects leave along the arrow that keys have turned.

        Parameters
        ----------
        along_normal : bool, optional
            As for `take`; without an arrow, of the surface before the bag's middle.
        """
        frame, arrow = self._target.renderer.frame, self._target.overlays.arrow
        if not self.drawing or frame is None:
            return
        if arrow.drawn is not None:
            self._take(arrow.drawn, along_normal)
        elif along_normal:
            self._take(np.stack([arrow.middle(frame)] * 2), along_normal)

    def stop(self) -> None:
        """Let go of the arrow; the direction stays."""
        self.drawing = False
        self._brush.take_up()
        self._show(None)
        self._target.events.direction_drawn.emit()

    def _show(self, pixels: NDArray[np.float64] | None) -> None:
        self._target.overlays.arrow.drawn = pixels
        self._target.renderer.transition.repaint()

    def _take(self, pixels: NDArray[np.float64], along_normal: bool) -> None:
        target, frame = self._target, self._target.renderer.frame
        if frame is not None:
            found = drawn_direction(pixels, frame.camera)
            if along_normal:
                normal = surface_normal(target, pixels[0], frame)
                found = -frame.camera.direction if normal is None else normal
            if found is not None:
                target.session.direction = triple(found)
        self.stop()


def turned_towards(arrow: NDArray[np.float64], way: Sequence[float]) -> NDArray[np.float64]:
    """Return an arrow turned about its start by a step of the keys, or by what is left.

    Parameters
    ----------
    arrow : (2, 2) ndarray of float64
        Start and tip, pixels, row and column.
    way : (2,) sequence of float
        Where it is to point in the end.

    Returns
    -------
    (2, 2) ndarray of float64
    """
    shaft = arrow[1] - arrow[0]
    # Straight back is as far either way.
    apart = np.arctan2(way[0], way[1]) - np.arctan2(shaft[0], shaft[1])
    apart = (apart + np.pi) % (2 * np.pi) - np.pi
    turn = np.clip(apart, -KEY_RADIANS, KEY_RADIANS)
    cos, sin = np.cos(turn), np.sin(turn)
    return np.stack([arrow[0], arrow[0] + np.array([[cos, sin], [-sin, cos]]) @ shaft])


def arrow_lines(ends: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return shaft and head of an arrow, three lines of two (3,) ends in the pivot plane."""
    way = ends[1] - ends[0]
    side = np.array([0.0, -way[2], way[1]])
    barbs = [ends[1] - HEAD * (way + sign * 0.6 * side) for sign in (1, -1)]
    return [ends, *(np.stack([ends[1], barb]) for barb in barbs)]


def drawn_direction(pixels: NDArray[np.float64], camera: Camera) -> Vector | None:
    """Return the world direction of an arrow drawn in the pivot plane.

    Parameters
    ----------
    pixels : (2, 2) ndarray of float64
        Its start and end, row and column.
    camera : Camera

    Returns
    -------
    (3,) ndarray of float64 or None
        Unit vector; None where the arrow is too short to tell.
    """
    down, right = pixels[1] - pixels[0]
    length = float(np.hypot(down, right))
    if length < LEAST_PIXELS:
        return None
    return unit(camera.in_world((0.0, down, right)))
