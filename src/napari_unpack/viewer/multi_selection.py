"""Several objects selected by hand: Ctrl and Shift with a click, and rubber bands."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.layers.placement import data_to_world, units_of, voxel_at
from napari_unpack.layers.rendered_image import Sprite
from napari_unpack.layers.slice_frame import SliceFrame
from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.gl.depth_quads import Quad
from napari_unpack.session.object_state import ObjectState, ids_in
from napari_unpack.tasks import Task
from napari_unpack.viewer.canvas_lines import CanvasLines, Line
from napari_unpack.viewer.protocols import Pixel
from napari_unpack.viewer.scheduler import Worker

if TYPE_CHECKING:
    from napari_unpack.appearance import TransferFunction
    from napari_unpack.rendering.scene import Scene
    from napari_unpack.session.ray_queries import RayQueries
    from napari_unpack.viewer.controller import SessionController

INK = (0.45, 0.9, 1.0, 0.95)

# Of an object's visible pixels so many may lie outside the band: nobody draws along edges.
STRAY = 0.03
# Rays of the longer side: enough for a coin, and below a tenth of a second.
MOST_RAYS = 800
# Voxels of an object that are looked at to see whether it shows at all.
MOST_VOXELS = 50_000


def chosen(selected: frozenset[int], object_id: int, modifiers: Collection[str]) -> frozenset[int]:
    """Return what is selected after a click.

    Parameters
    ----------
    selected : frozenset of int
        Before it.
    object_id : int
        What was clicked, 0 for nothing.
    modifiers : collection of str
        Keys held: Control adds the object or takes it out, Shift adds it. On macOS Qt calls Cmd
        Control.
    """
    clicked = frozenset([object_id]) - {0}
    if "Control" in modifiers:
        return selected ^ clicked
    return selected | clicked if "Shift" in modifiers else clicked


class RubberBand:
    """A rectangle drawn by a drag; what it encloses is added to the selection when it is let go.

    Parameters
    ----------
    target : SessionController
    frame_pixel : callable
        Returns the frame's pixel of one of the canvas.
    start : (2,) ndarray of float64
        Pixel of the canvas where the drag begins, row and column.
    """

    def __init__(
        self,
        target: SessionController,
        frame_pixel: Callable[[Pixel], tuple[float, float]],
        start: Pixel,
    ) -> None:
        self._target, self._frame_pixel = target, frame_pixel
        self._corners = np.array([frame_pixel(start)] * 2)
        self._lines = CanvasLines(target.pixel_scale)

    def drag(self, _last: Pixel, pixel: Pixel) -> None:
        """Draw it up to a corner.

        Parameters
        ----------
        _last, pixel : (2,) ndarray of float64
            Of the canvas.
        """
        self._corners[1] = self._frame_pixel(pixel)
        drawings = self._target.overlays.drawings
        if self not in drawings:
            drawings.append(self)
        self._target.renderer.transition.repaint()

    def release(self) -> None:
        """Draw it no longer, and select."""
        target = self._target
        if self in target.overlays.drawings:
            target.overlays.drawings.remove(self)
        target.renderer.transition.repaint()
        frame, session = target.renderer.frame, target.session
        if frame is None:
            return
        low, high = self._corners.min(axis=0), self._corners.max(axis=0)
        sprites = target.renderer.sprites
        found = enclosed_sprites(sprites.sprites if sprites.visible else {}, frame, low, high)
        session.select(session.selected | found)
        if not target.renderer.packed.visible:
            return
        before = session.selected

        def add(ids: frozenset[int]) -> None:
            # A click since then counts, not what was to be selected before it.
            if session.selected == before:
                session.select(before | (ids & set(session.ids)))

        scene, rays = session.scene(), session.ray_queries
        packed = ids_in(session.states, ObjectState.PACKED)
        target.scheduler.submit(
            Task("rubber band", lambda _: enclosed(scene, rays, packed, frame, low, high)),
            Worker.BACKGROUND,
            add,
        )

    def quads_at(self, frame: Frame) -> Sequence[Quad]:
        """Return the quad of its four sides."""
        return self._lines.quads([band_line(self._corners)], frame.size)


class SliceBand:
    """A rectangle drawn upon a slice, in napari's 2D view; selects what it encloses there.

    Parameters
    ----------
    target : SessionController
    start : (2,) ndarray of float64
        Pixel of the canvas where the drag begins, row and column.
    position : (N,) sequence of float
        The same in napari's world.
    """

    def __init__(self, target: SessionController, start: Pixel, position: Sequence[float]) -> None:
        self._target, self._layer = target, target.layers[1]
        self._corners = np.stack([start, start])
        self._ends = np.array([position, position], dtype=np.float64)
        self._lines = CanvasLines(target.pixel_scale)
        self._others = self._layer.slice_overlays

    def drag(self, pixel: Pixel, position: Sequence[float]) -> None:
        """Draw it up to a corner.

        Parameters
        ----------
        pixel : (2,) ndarray of float64
            Of the canvas.
        position : (N,) sequence of float
            The same in napari's world.
        """
        self._corners[1], self._ends[1] = pixel, position
        self._layer.slice_overlays = self._quads_at
        self._layer.repaint()

    def release(self) -> None:
        """Draw it no longer, and select."""
        self._layer.slice_overlays = self._others
        self._layer.repaint()
        target, dims = self._target, self._target.viewer.dims
        shown = [axis - dims.ndim + 3 for axis in dims.displayed]
        # Another axis of the viewer than the volume's three: there is no slice of ours.
        if min(shown) < 0:
            return
        units, across = units_of(target.viewer), 3 - sum(shown)
        index = round(voxel_at(target.layers[0], self._ends[0], units)[across])
        labels = target.session.labels
        if not 0 <= index < labels.shape[across]:
            return
        world = data_to_world(target.layers[0], units)
        first, second = (axis for axis in range(3) if axis != across)
        plane = np.take(labels, index, axis=across)
        rows, cols = (np.arange(n) for n in plane.shape)
        inside = np.ones(plane.shape, np.bool_)
        for axis in shown:
            there = np.add.outer(world[axis, first] * rows, world[axis, second] * cols)
            there += world[axis, across] * index + world[axis, 3]
            low, high = np.sort(self._ends[:, axis - 3])
            inside &= (there >= low) & (there <= high)
        found = _whole_inside(plane, inside)
        target.session.select(target.session.selected | found)

    def _quads_at(self, frame: SliceFrame) -> Sequence[Quad]:
        sides = [band_line(self._corners * self._target.pixel_scale())]
        others = () if self._others is None else self._others(frame)
        return [*others, *self._lines.quads(sides, frame.size)]


def band_line(corners: NDArray[np.float64]) -> Line:
    """Return the four sides of a rectangle given by two corners."""
    (top, left), (bottom, right) = corners
    round_ = [(top, left), (top, right), (bottom, right), (bottom, left), (top, left)]
    return Line(np.array(round_), INK, 1.5)


def _whole_inside(ids: NDArray[np.integer[Any]], inside: NDArray[np.bool_]) -> frozenset[int]:
    """Return the objects of which no more than `STRAY` lies outside."""
    whole = np.bincount(ids.ravel())
    part = np.bincount(ids[inside], minlength=len(whole))
    found = (whole > 0) & (part >= (1 - STRAY) * whole)
    return frozenset(int(i) for i in np.flatnonzero(found) if i > 0)


def enclosed(
    scene: Scene,
    rays: RayQueries,
    packed: Sequence[int],
    frame: Frame,
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> frozenset[int]:
    """Return the packed objects all of whose visible pixels lie in a rectangle; for workers.

    Parameters
    ----------
    scene : Scene
    rays : RayQueries
        Of the scene's labels.
    packed : sequence of int
        What is in the bag.
    frame : Frame
        What the canvas shows.
    low, high : (2,) ndarray of float64
        Corners of the rectangle, row and column of the frame.
    """
    visible = np.zeros(len(scene.packed_tints), np.bool_)
    visible[[i for i in packed if _shows(scene, i, scene.transfer_function)]] = True
    share = min(1.0, MOST_RAYS / max(frame.size))
    size = max(1, round(frame.size[0] * share)), max(1, round(frame.size[1] * share))
    # Threads have no GL context.
    ids = rays.object_ids(frame.camera, visible, size, 1, scene.clipping, "cpu")[0]
    first, last = (low + 0.5) * share - 0.5, (high + 0.5) * share - 0.5
    rows, cols = (np.arange(n) for n in size)
    in_rows = (rows >= first[0]) & (rows <= last[0])
    in_cols = (cols >= first[1]) & (cols <= last[1])
    return _whole_inside(ids, np.logical_and.outer(in_rows, in_cols))


def _shows(scene: Scene, object_id: int, function: TransferFunction) -> bool:
    """Return whether anything of an object is opaque enough to be seen."""
    window = scene.boxes.slices(object_id)
    volume, labels = scene.volume[window], scene.label_data.labels[window]
    step = max(1, int((labels.size / MOST_VOXELS) ** (1 / 3)))
    thin = (slice(None, None, step),) * 3
    densities = np.asarray(volume[thin])[labels[thin] == object_id]
    return bool(densities.size) and bool((function.opacity_at(densities) > 0).any())


def enclosed_sprites(
    sprites: Mapping[int, Sprite],
    frame: Frame,
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> frozenset[int]:
    """Return the objects whose sprites lie in a rectangle.

    Parameters
    ----------
    sprites : mapping of int to Sprite
    frame : Frame
        What the canvas shows.
    low, high : (2,) ndarray of float64
        Corners of the rectangle, row and column of the frame.
    """
    found = []
    for object_id, sprite in sprites.items():
        box = sprite_pixels(sprite, frame)
        if (box[0] >= low).all() and (box[1] <= high).all():
            found.append(object_id)
    return frozenset(found)


def sprite_pixels(sprite: Sprite, frame: Frame) -> NDArray[np.float64]:
    """Return the rectangle that a sprite covers, (2, 2): first and last row and column.

    Parameters
    ----------
    sprite : Sprite
    frame : Frame
        What the canvas shows.
    """
    place = sprite.place
    center, half = np.array(place.center), np.array([0.0, *place.half])
    return frame.camera.pixels(np.stack([center - half, center + half]), frame.size)
