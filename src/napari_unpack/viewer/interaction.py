"""The mouse in the viewer: names under it, clicks that select, sprites to turn and to inspect."""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray
from qtpy.QtGui import QCursor

from napari_unpack.geometry.axes import Matrix
from napari_unpack.geometry.transforms import rotation_about
from napari_unpack.layers import compat
from napari_unpack.layers.placement import units_of, voxel_at
from napari_unpack.viewer.brush import Brush
from napari_unpack.viewer.direction_arrow import Pencil
from napari_unpack.viewer.layer_tables import describe, hint
from napari_unpack.viewer.multi_selection import RubberBand, SliceBand, chosen
from napari_unpack.viewer.plain_text import show_status_as_written, show_tip
from napari_unpack.viewer.protocols import ClickTool, MouseEvent, Pixel
from napari_unpack.viewer.surface_points import label_at

if TYPE_CHECKING:
    import napari

    from napari_unpack.layers.view_camera import Frame
    from napari_unpack.viewer.controller import SessionController

# A drag no longer than this is a click: hands shake.
CLICK_PIXELS = 4.0

# A drag across 285 pixels turns an object by half a turn.
RADIANS_PER_PIXEL = 0.011

DOWN, RIGHT = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


class Interaction:
    """Follows the viewer's mouse while a session is open.

    Parameters
    ----------
    target : SessionController
        The controller.

    Attributes
    ----------
    pencil : Pencil
        Draws the direction in which objects leave, with the next drag in the 3D view.
    tool : ClickTool or None
        What takes clicks in place of selecting; another one calls it off.

    Notes
    -----
    Pixels are the canvas's own, row and column. napari's own double click zooms; while a session
    is open it does so in slices alone.
    """

    def __init__(self, target: SessionController) -> None:
        self._brush = Brush(target.viewer)
        self.pencil = Pencil(target, self.frame_pixel, self._brush)
        self._tool: ClickTool | None = None
        self._target = target
        self._pointed = 0
        self._in_slice = False
        # How things were when the mouse came upon it.
        self._found: tuple[object, ...] = ()
        # None once its name may be another.
        self._named: int | None = 0
        self._clicked: tuple[Pixel | None, int] = None, 0
        self._zoom: Callable[..., None] | None = None
        self._put_status_back: Callable[[], None] = lambda: None

    def open(self) -> None:
        """Take the mouse."""
        viewer = self._target.viewer
        clicks, self._zoom = viewer.mouse_double_click_callbacks, compat.zoom_by_click(viewer)
        at = len(clicks) if self._zoom is None else clicks.index(self._zoom)
        # napari's zoom would move the view away under an inspection.
        clicks[at : at + 1] = [self._double_click]
        viewer.mouse_move_callbacks.append(self._move)
        viewer.mouse_drag_callbacks.append(self._drag)
        viewer.dims.events.ndisplay.connect(self._follow_dims)
        self._put_status_back = show_status_as_written(viewer)

    def close(self) -> None:
        """Give the mouse back."""
        viewer = self._target.viewer
        viewer.dims.events.ndisplay.disconnect(self._follow_dims)
        clicks = viewer.mouse_double_click_callbacks
        if self._double_click in clicks:
            at = clicks.index(self._double_click)
            clicks[at : at + 1] = [] if self._zoom is None else [self._zoom]
        if self._move in viewer.mouse_move_callbacks:
            viewer.mouse_move_callbacks.remove(self._move)
        if self._drag in viewer.mouse_drag_callbacks:
            viewer.mouse_drag_callbacks.remove(self._drag)
        self._put_status_back()
        # Last: other plugins hear of it.
        self._brush.take_up()

    @property
    def pointed(self) -> int:
        """The object the mouse is on, 0 for none."""
        return self._pointed

    @property
    def tool(self) -> ClickTool | None:
        """What takes clicks in place of selecting."""
        return self._tool

    @tool.setter
    def tool(self, tool: ClickTool | None) -> None:
        """Have another tool take the clicks; the one before is called off, and so is an arrow.

        A brush is put down meanwhile, or the clicks would paint as well.
        """
        if tool is not None and self._tool is not None:
            self._tool.cancel()
        if tool is not None and self.pencil.drawing:
            self.pencil.stop()
        self._tool = tool
        if tool is None:
            self._brush.take_up()
        else:
            self._brush.put_down()

    # What is under a pixel.

    def frame_pixel(self, pixel: Pixel) -> tuple[float, float]:
        """Return the frame's pixel (row, column) of one of the canvas."""
        return self._pixel_in(self._frame, pixel)

    def _pixel_in(self, frame: Frame | None, pixel: Pixel) -> tuple[float, float]:
        corner = np.zeros(2) if frame is None else np.array(frame.corner)
        row, col = (pixel + 0.5) * self._target.pixel_scale() - 0.5 - corner
        return float(row), float(col)

    def sprite_at(self, pixel: Pixel) -> int:
        """Return the object whose sprite is at a pixel, 0 for none."""
        # In napari's grid they have a view of their own.
        there = self._pixel_in(self._target.sprites.frame, pixel)
        return self._target.renderer.picker.sprite_at(*there)

    def packed_at(self, pixel: Pixel) -> list[int]:
        """Return the packed objects at a pixel, the most visible first."""
        return self._target.renderer.picker.packed_at(*self.frame_pixel(pixel))

    def under(self, pixel: Pixel) -> int:
        """Return the object at a pixel, 0 for none: inspected, unpacked, or packed."""
        inspected = self._target.renderer.inspected
        # The inspected object covers the view, whatever lies behind it.
        return inspected or self.sprite_at(pixel) or next(iter(self.packed_at(pixel)), 0)

    def in_slice(self, position: Sequence[float]) -> int:
        """Return the object at a point of the viewer's world, 0 for none; as slices show it."""
        voxel = self._voxel_in_slice(position)
        return 0 if voxel is None else label_at(self._target.session, voxel) or 0

    def _voxel_in_slice(self, position: Sequence[float]) -> NDArray[np.float64] | None:
        target, there = self._target, np.asarray(position, dtype=np.float64)[-3:]
        # In an opened object slices show the whole bag, of which this session has no labels.
        if target.outer_session is not None or len(there) < 3 or not np.isfinite(there).all():
            return None
        return voxel_at(target.layers[0], there, units_of(target.viewer))

    # What the mouse does.

    def point_at(self, object_id: int, in_slice: bool = False) -> None:
        """Show which object the mouse is on.

        Parameters
        ----------
        object_id : int
            0 for none.
        in_slice : bool
            Whether a slice shows it, which stays as it is when objects leave the bag.
        """
        # Every movement of the mouse comes here.
        self._in_slice = in_slice
        if object_id == self._named:
            return
        self._pointed = self._named = object_id
        target, session = self._target, self._target.session
        self._found = self._whereabouts()
        words = describe(session, object_id) if object_id else ""
        for layer in target.layers:
            layer.words = words
        target.viewer.status = words or "Ready"
        compat.refresh_status(target.viewer)
        self._show_name(hint(session, object_id) if object_id else "")
        target.overlays.ghost.point_at(0 if target.renderer.inspected else object_id)
        self.selection_changed()

    def states_changed(self) -> None:
        """Name what the mouse is on anew when it moves next: it may have been renamed.

        What has gone from under the mouse, or was dimmed for an inspection, is no longer pointed
        at, the mouse unmoved.
        """
        is_there = self._in_slice and self._pointed in self._target.session.states
        if self._pointed and not is_there and self._found != self._whereabouts():
            self.point_at(0)
        self._named = None

    def _whereabouts(self) -> tuple[object, ...]:
        session, pointed = self._target.session, self._pointed
        pose = session.poses.get(pointed)
        center = () if pose is None else tuple(pose.center)
        return session.states.get(pointed), session.state.inspected, center

    def select(self, object_id: int, modifiers: Collection[str] = ()) -> None:
        """Select an object, or add it to what is selected.

        Parameters
        ----------
        object_id : int
            0 for none.
        modifiers : collection of str
            Keys held, see `chosen`.
        """
        session = self._target.session
        session.select(chosen(session.selected, object_id, modifiers))

    def selection_changed(self) -> None:
        """Outline the selected objects and the one under the mouse."""
        selected = frozenset(self._target.session.selected)
        self._target.layers[2].choose(selected | ({self._pointed} - {0}))
        self._target.overlays.update()

    def move(self, object_id: int, pixels: Pixel) -> None:
        """Carry a sprite along with the hand.

        Parameters
        ----------
        object_id : int
        pixels : (2,) ndarray of float64
            Rows down and columns to the right.
        """
        self._target.renderer.held.move(object_id, self._target.pixel_scale() * pixels)

    @property
    def _frame(self) -> Frame | None:
        return self._target.renderer.frame

    def _in_frame(self, pixel: Pixel) -> Pixel:
        # Of the layer that draws what is over the bag.
        return np.array(self._pixel_in(self._target.transition.frame, pixel))

    def _show_name(self, words: str) -> None:
        canvas = compat.native_canvas(self._target.viewer)
        if canvas is not None:
            show_tip(QCursor.pos(), words, canvas.native)

    # napari's mouse callbacks.

    def _in_3d(self) -> bool:
        return self._target.viewer.dims.ndisplay == 3

    def _follow_dims(self, _event: object = None) -> None:
        # No arrow is drawn in slices, and its keys are theirs.
        if self.pencil.drawing and not self._in_3d():
            self.pencil.stop()

    def _move(self, _viewer: napari.Viewer, event: MouseEvent) -> None:
        if self._in_3d():
            pixel = _pixel(event)
            handle = self._target.cut_handle.point_at(self._in_frame(pixel), self._frame)
            self.point_at(0 if handle else self.under(pixel))
        else:
            self.point_at(self.in_slice(event.position), in_slice=True)

    def _double_click(self, viewer: napari.Viewer, event: MouseEvent) -> None:
        if self.tool is not None:
            # Its clicks may come as fast as they like.
            event.handled = True
            return
        if self._in_3d():
            if self._brush.in_hand:
                return
            if self._target.renderer.inspected:
                self._target.leave()
                event.handled = True
                return
            found = self.under(_pixel(event))
            if found:
                self._target.inspect(found)
            # napari would zoom in, and leave all sprites out of the window.
            event.handled = True
            return
        if self._zoom is not None:
            self._zoom(viewer, event)

    def _drag(self, _viewer: napari.Viewer, event: MouseEvent) -> Generator[None, None, None]:
        if event.button != 1:
            return
        if not self._in_3d():
            yield from self._click_in_slice(event)
            return
        if self._brush.in_hand:
            # Selecting would set its label, which a dab must not.
            return
        modifiers, start = _modifiers(event), _pixel(event)
        grip = self._grip(start, modifiers)
        last, moved = start, False
        with self._camera_held(grip is not None):
            yield
            while event.type == "mouse_move":
                pixel = _pixel(event)
                moved = moved or _is_far(pixel, start)
                if grip is not None and moved:
                    grip.drag(last, pixel)
                    last = pixel
                yield
        # A click ends drawing too: its arrow is too short to set a direction.
        if grip is not None and (moved or self.pencil.drawing):
            grip.release()
        elif not moved and self.tool is not None:
            self.tool.click(start)
        elif not moved and not self._target.renderer.inspected:
            self._click(start, modifiers)

    def _grip(self, start: Pixel, modifiers: set[str]) -> _Grip | None:
        """Return what a drag that begins here does; None turns the view."""
        inspected = self._target.renderer.inspected
        turned = self._target.renderer.animator.turned_by_hand
        held = turned if inspected else self.sprite_at(start)
        if self.pencil.drawing:
            return _Stroke(self.pencil, start, "Shift" in modifiers)
        handle = self._target.cut_handle.point_at(self._in_frame(start), self._frame)
        if handle and not modifiers:
            return _Cut(self._target, handle, self._in_frame)
        if "Control" in modifiers and not inspected:
            return RubberBand(self._target, self.frame_pixel, start)
        hand = self._target.renderer.held
        if held and not modifiers:
            return _Held(lambda way: hand.turn(held, drag_rotation(way)), lambda: hand.turned(held))
        if held and modifiers == {"Shift"} and not inspected:
            return _Held(lambda way: self.move(held, way), lambda: hand.moved(held))
        return None

    def _click_in_slice(self, event: MouseEvent) -> Generator[None, None, None]:
        if self._brush.in_hand:
            return
        start, there, moved = _pixel(event), event.position, False
        modifiers = _modifiers(event)
        # In an opened object slices show the whole bag, of which this session has no labels.
        bands = "Control" in modifiers and self._target.outer_session is None
        band = SliceBand(self._target, start, there) if bands else None
        with self._camera_held(bands):
            yield
            while event.type == "mouse_move":
                moved = moved or _is_far(_pixel(event), start)
                if band is not None and moved:
                    band.drag(_pixel(event), event.position)
                yield
        steps = self._target.slice_steps
        with nullcontext() if steps is None else steps.held():
            if moved and band is not None:
                band.release()
            elif not moved and self.tool is None:
                self.select(self.in_slice(there), modifiers)
        if not moved and self.tool is not None:
            voxel = self._voxel_in_slice(there)
            if voxel is not None:
                self.tool.click_voxel(voxel)

    @contextmanager
    def _camera_held(self, held: bool) -> Generator[None, None, None]:
        """Keep the viewer from turning and panning the bag meanwhile."""
        camera = self._target.viewer.scene.camera
        before = bool(camera.mouse_pan)
        if held:
            camera.mouse_pan = False
        try:
            yield
        finally:
            if held:
                camera.mouse_pan = before

    def _click(self, pixel: Pixel, modifiers: set[str]) -> None:
        sprite = self.sprite_at(pixel)
        if sprite:
            self.select(sprite, modifiers)
            return
        there, which = self.packed_at(pixel), 0
        if "Alt" in modifiers and there:
            # Another click at the same place goes on from where the last one got.
            last, step = self._clicked
            near = last is not None and not _is_far(pixel, last)
            which = (step + 1 if near else 1) % len(there)
        self._clicked = pixel, which
        self.select(there[which] if there else 0, modifiers)


class _Grip(Protocol):
    def drag(self, last: Pixel, pixel: Pixel) -> None: ...

    def release(self) -> None: ...


@dataclass
class _Held:
    follow: Callable[[Pixel], None]
    let_go: Callable[[], None]

    def drag(self, last: Pixel, pixel: Pixel) -> None:
        self.follow(pixel - last)

    def release(self) -> None:
        self.let_go()


@dataclass
class _Cut:
    target: SessionController
    part: str
    in_frame: Callable[[Pixel], Pixel]
    moved: bool = False

    def drag(self, last: Pixel, pixel: Pixel) -> None:
        frame, handle = self.target.renderer.frame, self.target.cut_handle
        if frame is None:
            return
        if self.part == "rim":
            handle.turn(pixel - last, frame, self.moved)
        else:
            handle.push(self.in_frame(pixel) - self.in_frame(last), frame, self.moved)
        self.moved = True

    def release(self) -> None:
        """Nothing is left to do: every movement has cut already."""


class _Stroke:
    def __init__(self, pencil: Pencil, start: Pixel, along_normal: bool) -> None:
        self._pencil, self._along_normal = pencil, along_normal
        self._start, self._end = start, start

    def drag(self, _last: Pixel, pixel: Pixel) -> None:
        self._end = pixel
        self._pencil.show(self._start, pixel)

    def release(self) -> None:
        self._pencil.take(self._start, self._end, self._along_normal)


def drag_rotation(pixels: Pixel) -> Matrix:
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


def _is_far(pixel: Pixel, other: Pixel) -> bool:
    return float(np.abs(pixel - other).max()) > CLICK_PIXELS


def _pixel(event: MouseEvent) -> Pixel:
    x, y = event.pos[:2]
    return np.array([float(y), float(x)])


def _modifiers(event: MouseEvent) -> set[str]:
    """Return the names of the keys held; vispy hands out `Key` objects, napari's tests words."""
    return {str(getattr(key, "name", key)) for key in getattr(event, "modifiers", ())}
