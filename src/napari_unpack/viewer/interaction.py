"""The mouse on the stage: names under it, clicks that select, sprites to turn and to inspect.

What the pointer asks of the stage: what is under it, and what it does to things.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from qtpy.QtGui import QCursor
from qtpy.QtWidgets import QToolTip

from napari_unpack.geometry.axes import Matrix
from napari_unpack.geometry.transforms import rotation_about
from napari_unpack.layers import compat
from napari_unpack.layers.placement import units_of, voxel_at
from napari_unpack.layers.sprite_layer import SpriteLayer
from napari_unpack.layers.view_camera import Frame
from napari_unpack.viewer.direction_arrow import drawn_direction, surface_normal
from napari_unpack.viewer.layer_tables import describe
from napari_unpack.viewer.overlays import Overlays
from napari_unpack.viewer.scene_renderer import SceneRenderer, mark
from napari_unpack.viewer.slice_sync import SliceSteps


class Hands:
    """The pointer's side of a `SessionController`; pixels are the canvas's own, row and column."""

    viewer: Any
    session: Any
    overlays: Overlays
    layers: Any
    sprites: SpriteLayer
    events: Any
    _renderer: SceneRenderer
    _pointed: int
    _steps: SliceSteps
    around: Any
    drawing = False
    """Whether the next drag in the picture draws the direction in which objects leave."""

    @property
    def frame(self) -> Frame | None:
        """What the canvas showed last."""
        return self._renderer.frame

    def sprite_at(self, pixel: NDArray[np.float64]) -> int:
        """Return the object whose sprite is at a pixel of the canvas (row, column), or 0."""
        return self._renderer.sprite_at(*self.device_pixel(pixel))

    def packed_at(self, pixel: NDArray[np.float64]) -> list[int]:
        """Return the packed objects at a pixel of the canvas, the most visible first."""
        return self._renderer.packed_at(*self.device_pixel(pixel))

    def in_slice(self, position: Sequence[float]) -> int:
        """Return the object at a point of the viewer's world, 0 for none; as slices show it."""
        if self.around is not None:
            return 0
        packed, labels = self.layers[0], self.session.labels
        there = np.asarray(position, dtype=np.float64)[-3:]
        if len(there) < 3 or not np.isfinite(there).all():
            return 0
        voxel = voxel_at(packed, there, units_of(self.viewer))
        if (voxel < 0).any() or (voxel >= labels.shape).any():
            return 0
        return int(labels[tuple(voxel)])

    def point_at(self, object_id: int) -> None:
        """Show which object the mouse is on, 0 for none."""
        if object_id == self._pointed:
            return
        self._pointed = object_id
        words = describe(self.session, object_id) if object_id else ""
        for layer in self.layers:
            layer.words = words
        self.viewer.status = words or "Ready"
        # Beside a sprite its name; in the bag names would lie over what they are of.
        self._tell_name(words if object_id in self.session.poses else "")
        self.overlays.ghost.point_at(0 if self._renderer.inspected else object_id)
        self._mark()

    def select(self, object_id: int) -> None:
        """Select an object, 0 for none."""
        self.session.select([object_id] if object_id else [])

    def select_in_slice(self, position: Sequence[float]) -> None:
        """Select the object at a point of the viewer's world; the slice stays."""
        with self._steps.held():
            self.select(self.in_slice(position))

    def turn(self, object_id: int, rotation: Matrix) -> None:
        """Turn an object under the hand."""
        self._renderer.turn(object_id, rotation)

    def turned(self, object_id: int) -> None:
        """Let go of an object that was turned."""
        self._renderer.turned(object_id)

    def put_back(self) -> None:
        """End an inspection at once: the view is again what it was before."""
        self._renderer.end_inspection()

    def rotation_of(self, object_id: int) -> Matrix:
        """Return how an object is held now, from world axes to pivot axes."""
        return self._renderer.rotation_of(object_id)

    def move(self, object_id: int, pixels: NDArray[np.float64]) -> None:
        """Carry a sprite along with the hand."""
        self._renderer.move(object_id, self._scale() * pixels)

    def moved(self, object_id: int) -> None:
        """Let go of a sprite that was carried."""
        self._renderer.moved(object_id)

    def draw(self, start: NDArray[np.float64], end: NDArray[np.float64]) -> None:
        """Show an arrow under the hand."""
        self.overlays.arrow.drawn = np.array([self.device_pixel(start), self.device_pixel(end)])
        self._renderer.transition.repaint()

    def drawn(self, start: NDArray[np.float64], end: NDArray[np.float64], out: bool) -> None:
        """Let objects leave along an arrow that was drawn.

        Parameters
        ----------
        start, end : (2,) ndarray of float64
            Pixels of the canvas.
        out : bool
            Along the normal of the surface under its start instead; towards the viewer where
            there is none.
        """
        self.overlays.arrow.drawn = None
        self.drawing = False
        frame = self.frame
        if frame is not None:
            pixels = np.array([self.device_pixel(start), self.device_pixel(end)])
            found = drawn_direction(pixels, frame.camera)
            if out:
                row, col = (round(v) for v in pixels[0])
                depth = self._renderer.depth()
                mm = frame.camera.height / frame.size[0]
                found = surface_normal(depth, row, col, mm, frame.camera)
            if found is not None:
                self.session.direction = tuple(float(v) for v in found)
        self._renderer.transition.repaint()
        self.events.drawn.emit()

    def _tell_name(self, words: str) -> None:
        canvas = compat.native_canvas(self.viewer)
        if canvas is not None:
            QToolTip.showText(QCursor.pos(), words, canvas.native)

    def _scale(self) -> float:
        return 1.0 if self.frame is None else self.frame.size[0] / self.viewer.canvas.size[0]

    def _mark(self) -> None:
        mark(self.sprites, self.session.selected, self._pointed)
        self.overlays.renew()

    def device_pixel(self, pixel: NDArray[np.float64]) -> tuple[float, float]:
        """Return the frame's pixel (row, column) of one of the canvas."""
        height, width = self.viewer.canvas.size
        rows, cols = (height, width) if self.frame is None else self.frame.size
        return (
            float((pixel[0] + 0.5) * rows / height - 0.5),
            float((pixel[1] + 0.5) * cols / width - 0.5),
        )


CLICK_PIXELS = 4.0
RADIANS_PER_PIXEL = 0.011
DOWN, RIGHT = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


class Scene(Protocol):
    """What the pointer asks of the stage; pixels are the canvas's own, row and column."""

    @property
    def inspected(self) -> int:
        """The object being inspected, 0 for none."""

    @property
    def drawing(self) -> bool:
        """Whether a drag draws the direction in which objects leave."""

    def sprite_at(self, pixel: NDArray[np.float64]) -> int:
        """Return the object whose sprite is there, 0 for none."""

    def packed_at(self, pixel: NDArray[np.float64]) -> list[int]:
        """Return the packed objects there, the most visible first."""

    def in_slice(self, position: Sequence[float]) -> int:
        """Return the object at a point of the viewer's world, 0 for none."""

    def select_in_slice(self, position: Sequence[float]) -> None:
        """Select the object at a point of the viewer's world; the slice stays."""

    def point_at(self, object_id: int) -> None:
        """Show which object the mouse is on, 0 for none."""

    def select(self, object_id: int) -> None:
        """Select an object, 0 for none."""

    def inspect(self, object_id: int) -> None:
        """Enter inspection."""

    def leave(self) -> None:
        """Leave inspection."""

    def turn(self, object_id: int, rotation: Matrix) -> None:
        """Turn an object by a rotation of pivot space, under the hand."""

    def turned(self, object_id: int) -> None:
        """Let go of an object that was turned."""

    def move(self, object_id: int, pixels: NDArray[np.float64]) -> None:
        """Carry a sprite along with the hand."""

    def moved(self, object_id: int) -> None:
        """Let go of a sprite that was carried."""

    def draw(self, start: NDArray[np.float64], end: NDArray[np.float64]) -> None:
        """Show an arrow under the hand."""

    def drawn(self, start: NDArray[np.float64], end: NDArray[np.float64], out: bool) -> None:
        """Let objects leave along an arrow that was drawn."""


class Pointer:
    """Hears the viewer's mouse while the stage is on.

    Parameters
    ----------
    viewer : napari.Viewer
    scene : Scene
        The stage.

    Notes
    -----
    napari's own double click zooms; while the stage is on it is asked only where ours has
    nothing to do.
    """

    def __init__(self, viewer: Any, scene: Scene) -> None:
        self._viewer, self._scene = viewer, scene
        self._clicked: tuple[NDArray[np.float64] | None, int] = None, 0
        self._theirs = list(viewer.mouse_double_click_callbacks)
        viewer.mouse_double_click_callbacks[:] = [self._double_click]
        viewer.mouse_move_callbacks.append(self._move)
        viewer.mouse_drag_callbacks.append(self._drag)

    def close(self) -> None:
        """Give the mouse back."""
        self._viewer.mouse_double_click_callbacks[:] = self._theirs
        for callbacks, ours in (
            (self._viewer.mouse_move_callbacks, self._move),
            (self._viewer.mouse_drag_callbacks, self._drag),
        ):
            if ours in callbacks:
                callbacks.remove(ours)

    def _in_3d(self) -> bool:
        return bool(self._viewer.dims.ndisplay == 3)

    def _move(self, _viewer: Any, event: Any) -> None:
        if self._in_3d():
            self._scene.point_at(self._under(_pixel(event)))
        else:
            self._scene.point_at(self._scene.in_slice(event.position))

    def _under(self, pixel: NDArray[np.float64]) -> int:
        if self._scene.inspected:
            return self._scene.inspected
        sprite = self._scene.sprite_at(pixel)
        return sprite or next(iter(self._scene.packed_at(pixel)), 0)

    def _double_click(self, viewer: Any, event: Any) -> None:
        if self._in_3d():
            if self._scene.inspected:
                self._scene.leave()
                event.handled = True
                return
            sprite = self._scene.sprite_at(_pixel(event))
            if sprite:
                self._scene.inspect(sprite)
                event.handled = True
                return
        for callback in self._theirs:
            callback(viewer, event)

    def _drag(self, _viewer: Any, event: Any) -> Generator[None, None, None]:
        if event.button != 1:
            return
        if not self._in_3d():
            yield from self._click_in_slice(event)
            return
        modifiers = _modifiers(event)
        start = _pixel(event)
        held = self._scene.inspected or self._scene.sprite_at(start)
        if self._scene.drawing:
            grip: Grip | None = _Pencil(self._scene, start, "Shift" in modifiers)
        elif held and not modifiers:
            grip = _Turn(self._scene, held)
        elif held and modifiers == {"Shift"} and not self._scene.inspected:
            grip = _Carry(self._scene, held)
        else:
            grip = None
        last, moved = start, False
        with self._held_off(grip is not None):
            yield
            while event.type == "mouse_move":
                pixel = _pixel(event)
                moved = moved or float(np.abs(pixel - start).max()) > CLICK_PIXELS
                if grip is not None and moved:
                    grip.drag(last, pixel)
                    last = pixel
                yield
        if grip is not None and (moved or self._scene.drawing):
            grip.release()
        elif not moved and not self._scene.inspected:
            self._click(start, "Alt" in modifiers)

    def _click_in_slice(self, event: Any) -> Generator[None, None, None]:
        start, there, moved = _pixel(event), event.position, False
        yield
        while event.type == "mouse_move":
            moved = moved or float(np.abs(_pixel(event) - start).max()) > CLICK_PIXELS
            yield
        if not moved:
            self._scene.select_in_slice(there)

    @contextmanager
    def _held_off(self, held: bool) -> Generator[None, None, None]:
        """Keep the viewer from turning and panning the bag meanwhile."""
        camera = self._viewer.scene.camera
        before = bool(camera.mouse_pan)
        if held:
            camera.mouse_pan = False
        try:
            yield
        finally:
            if held:
                camera.mouse_pan = before

    def _click(self, pixel: NDArray[np.float64], deeper: bool) -> None:
        sprite = self._scene.sprite_at(pixel)
        if sprite:
            self._scene.select(sprite)
            return
        there, which = self._scene.packed_at(pixel), 0
        if deeper and there:
            # Another click at the same place goes on from where the last one got.
            last, step = self._clicked
            near = last is not None and float(np.abs(pixel - last).max()) <= CLICK_PIXELS
            which = (step + 1 if near else 1) % len(there)
        self._clicked = pixel, which
        self._scene.select(there[which] if there else 0)


class Grip(Protocol):
    """What a drag does."""

    def drag(self, last: NDArray[np.float64], pixel: NDArray[np.float64]) -> None:
        """Follow the mouse from one pixel to the next."""

    def release(self) -> None:
        """Let go."""


@dataclass
class _Turn:
    scene: Scene
    held: int

    def drag(self, last: NDArray[np.float64], pixel: NDArray[np.float64]) -> None:
        self.scene.turn(self.held, drag_rotation(pixel - last))

    def release(self) -> None:
        self.scene.turned(self.held)


@dataclass
class _Carry:
    scene: Scene
    held: int

    def drag(self, last: NDArray[np.float64], pixel: NDArray[np.float64]) -> None:
        self.scene.move(self.held, pixel - last)

    def release(self) -> None:
        self.scene.moved(self.held)


class _Pencil:
    def __init__(self, scene: Scene, start: NDArray[np.float64], out: bool) -> None:
        self.scene, self.start, self.end, self.out = scene, start, start, out

    def drag(self, _last: NDArray[np.float64], pixel: NDArray[np.float64]) -> None:
        self.end = pixel
        self.scene.draw(self.start, pixel)

    def release(self) -> None:
        self.scene.drawn(self.start, self.end, self.out)


def drag_rotation(pixels: NDArray[np.float64]) -> Matrix:
    """Return the turn of pivot space under which what faces the viewer follows the mouse.

    Parameters
    ----------
    pixels : (2,) ndarray of float64
        Way of the mouse, rows down and columns to the right.

    Returns
    -------
    (3, 3) ndarray of float64
    """
    down, right = pixels * RADIANS_PER_PIXEL
    turned: Matrix = rotation_about(DOWN, -right) @ rotation_about(RIGHT, down)
    return turned


def _pixel(event: Any) -> NDArray[np.float64]:
    x, y = event.pos[:2]
    return np.array([float(y), float(x)])


def _modifiers(event: Any) -> set[str]:
    """Return the names of the keys held; vispy hands out `Key` objects, napari's tests words."""
    return {str(getattr(key, "name", key)) for key in getattr(event, "modifiers", ())}
