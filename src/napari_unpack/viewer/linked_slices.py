"""Three slices through one voxel, linked with each other and with the 3D view by the pointer."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from napari.layers import Image
from napari.layers.utils.layer_utils import calc_data_range
from numpy.typing import ArrayLike, NDArray
from psygnal import Signal, SignalGroup

from napari_unpack.appearance import tints_of
from napari_unpack.geometry.axes import Vector, transform_points
from napari_unpack.layers.placement import units_of, voxel_at
from napari_unpack.rendering.slice_image import PLANES, Plane, Window, object_window, slice_image
from napari_unpack.session.object_state import ObjectState
from napari_unpack.tasks import Task
from napari_unpack.viewer.layer_tables import hint
from napari_unpack.viewer.point_marker import PointMarker
from napari_unpack.viewer.protocols import Event, MouseEvent
from napari_unpack.viewer.scheduler import Worker
from napari_unpack.viewer.surface_points import surface_point

if TYPE_CHECKING:
    import napari

    from napari_unpack.geometry.view import Camera
    from napari_unpack.layers.view_camera import Frame
    from napari_unpack.session import Session
    from napari_unpack.viewer.controller import SessionController

Voxel = tuple[int, int, int]

# Share of a tint in the colour of an object that is outside the bag, of that of a packed one.
OUTSIDE = 0.3

# Between two drawings of the marker: without a graphics card each takes as long, and the slices
# are what the eye follows.
MARK_MS = 60


class SliceEvents(SignalGroup):
    """What linked slices tell.

    crosshair: the voxel that all three slices go through. drawn: a plane and the image of its
    slice, (H, W, 4) uint8. window: the densities shown black and white. rulers: measurements may
    be others.
    """

    crosshair = Signal(tuple)
    drawn = Signal(object, object)
    window = Signal(tuple)
    rulers = Signal()


@dataclass(frozen=True, eq=False)
class RulerInSlice:
    """A measurement as a slice shows it.

    Parameters
    ----------
    voxels : (N, 3) ndarray of float64
        Its points, z y x with fractions.
    numbers : tuple of str
        Its lengths and angle in words; none while it is being made.
    strength : float
        Opacity: less where a point lies beside the slice.
    """

    voxels: NDArray[np.float64]
    numbers: tuple[str, ...]
    strength: float


class LinkedSlices:
    """Follows the pointer in slices and in the 3D view, and has the slices drawn.

    Parameters
    ----------
    controller : SessionController
        An open one.

    Attributes
    ----------
    crosshair : (int, int, int)
        The voxel that all three slices go through, z y x.
    events : SliceEvents
    marker : PointMarker
        Shows in the 3D view what the hand points at in a slice.

    Notes
    -----
    Slices are read and drawn by a worker, so that a volume on a disk never holds up the window.
    """

    def __init__(self, controller: SessionController) -> None:
        self._controller, self._session = controller, controller.session
        self.events = SliceEvents()
        self.crosshair = self._voxel(self._session.bag.center / self._session.spacing)
        self._image = image_of(self._controller)
        self._limits = limits_of(self._image)
        self._follows = True
        self._window = object_window(self._session.volume, self._session.labels)
        if self._limits is not None and limits_chosen(self._image):
            self._window = self._limits
        self._overlay = 0.5
        self._marked = False
        # Stale: something has changed since the last call of `draw`.
        self._open = self._stale = False
        self.marker = PointMarker(self._marker_point)

    # Lifetime.

    def open(self) -> None:
        """Draw, and follow the pointer and the session."""
        if self._open:
            return
        self._open = True
        for event, slot in self._heard():
            event.connect(slot)
        self._controller.viewer.mouse_move_callbacks.append(self._move)
        self._controller.overlays.drawings.append(self.marker)
        # They may have changed while nobody saw the slices.
        self._follow_image()
        self.draw()

    def close(self) -> None:
        """Draw and follow nothing more."""
        if not self._open:
            return
        self._open = self._stale = False
        for event, slot in self._heard():
            event.disconnect(slot)
        if self._move in self._controller.viewer.mouse_move_callbacks:
            self._controller.viewer.mouse_move_callbacks.remove(self._move)
        self._controller.overlays.drawings.remove(self.marker)
        for plane in PLANES:
            self._controller.scheduler.cancel(_slot(plane))
        self._mark(False)

    @property
    def settled(self) -> bool:
        """Whether every image that was asked for is drawn, and no change is yet to be."""
        return not self._stale and not any(
            self._controller.scheduler.has(_slot(plane)) for plane in PLANES
        )

    def _heard(self) -> list[tuple[Event, Callable[..., None]]]:
        events = self._session.events
        changes = (events.labels, events.states, events.hues)
        # The unit of lengths is among the surroundings.
        measured = (events.measurements, events.surroundings, self._controller.rulers.picked)
        images = () if self._image is None else (self._image.events.contrast_limits,)
        return [
            *((event, self._redraw) for event in (*changes, *measured)),
            *((event, self._follow_image) for event in images),
            (events.selected, self._follow),
        ]

    # What is where.

    @property
    def shape(self) -> tuple[int, int, int]:
        """Voxels along z, y, x."""
        z, y, x = self._session.labels.shape
        return z, y, x

    @property
    def spacing(self) -> NDArray[np.float64]:
        """Voxel size in mm, z y x."""
        return self._session.spacing

    def object_at(self, voxel: Voxel) -> int:
        """Return the object of a voxel, 0 for none."""
        return int(self._session.labels[voxel])

    def name_at(self, voxel: Voxel) -> str:
        """Return what the object of a voxel is called, empty for none."""
        object_id = self.object_at(voxel)
        return hint(self._session, object_id) if object_id in self._session.states else ""

    # What the hand does in slices.

    def point_at(self, voxel: Voxel) -> None:
        """Move the crosshair, and show the point and its object in the 3D view."""
        self._go_to(self._voxel(voxel))
        self._mark(True)
        self._controller.interaction.point_at(self.object_at(self.crosshair), in_slice=True)

    def click_at(self, there: ArrayLike, modifiers: Collection[str] = ()) -> None:
        """Select the object at a voxel, none where there is none; or hand a tool its point.

        Parameters
        ----------
        there : (3,) array_like
            The voxel z y x, with fractions.
        modifiers : collection of str
            Keys held, as in the 3D view.
        """
        interaction = self._controller.interaction
        if interaction.tool is not None:
            interaction.tool.click_voxel(np.asarray(there, dtype=np.float64))
        else:
            interaction.select(self.object_at(self._voxel(there)), modifiers)

    def rulers_in(self, plane: Plane) -> list[RulerInSlice]:
        """Return what was measured in the slice of a plane, or through it."""
        near = self._controller.rulers.near_slice(plane.normal, self.crosshair[plane.normal])
        unit = self._session.length_unit
        return [
            RulerInSlice(voxels, () if one is None else one.numbers_in(unit), strength)
            for voxels, one, strength in near
        ]

    def center(self) -> None:
        """Move the crosshair into the selected object, or into the middle of the bag."""
        ids = sorted(self._session.selected)
        if ids:
            self.point_at(self._voxel(middle_of(self._session, ids[0])))
        else:
            self.point_at(self._voxel(self._session.bag.center / self.spacing))

    # How slices look.

    @property
    def window(self) -> Window:
        """Densities shown black and white."""
        return self._window

    @window.setter
    def window(self, window: Window) -> None:
        """Show densities otherwise; the white one stays above the black one."""
        self._follows = False
        self._show_window(window)

    def _show_window(self, window: Window) -> None:
        low, high = window
        least = 1e-3 * max(abs(low), abs(high), 1e-6)
        self._window = float(low), float(max(high, low + least))
        self.events.window.emit(self._window)
        self.draw()

    def reset_window(self) -> None:
        """Show what suits the objects, until somebody sets the contrast limits of the image."""
        self._follows = True
        self._show_window(object_window(self._session.volume, self._session.labels))

    def _follow_image(self, _event: object = None) -> None:
        before, self._limits = self._limits, limits_of(self._image)
        if self._follows and self._limits is not None and self._limits != before:
            self._show_window(self._limits)

    @property
    def overlay(self) -> float:
        """Share of the tints in the colours of packed objects, in [0, 1]."""
        return self._overlay

    @overlay.setter
    def overlay(self, share: float) -> None:
        """Show tints more or less."""
        self._overlay = float(np.clip(share, 0.0, 1.0))
        self.draw()

    def tints(self) -> NDArray[np.float32]:
        """Return the (M, 4) tints of slices: those of the 3D view, faint for what is outside."""
        session = self._session
        tints = tints_of(session.hues, session.label_data.largest_id, mode=session.tint_mode)
        # Opacity as it was chosen: a slice has no depth in which it would add up.
        for object_id, color in session.annotations.colors.items():
            tints[object_id] = color
        shares = {ObjectState.PACKED: 1.0, ObjectState.HIDDEN: 0.0}
        for object_id, state in session.states.items():
            tints[object_id, 3] *= self._overlay * shares.get(state, OUTSIDE)
        return tints

    def draw(self) -> None:
        """Have all three slices drawn."""
        self._stale = False
        if self._open:
            self.events.rulers.emit()
            tints = self.tints()
            for plane in PLANES:
                self._draw(plane, tints)

    def _draw(self, plane: Plane, tints: NDArray[np.float32]) -> None:
        session, index, window = self._session, self.crosshair[plane.normal], self._window
        volume, labels, selected = session.volume, session.labels, session.selected
        self._controller.scheduler.submit(
            Task(
                _slot(plane),
                lambda _: slice_image(volume, labels, tints, plane, index, window, selected),
            ),
            Worker.SLICE,
            partial(self.events.drawn.emit, plane),
        )

    def _redraw(self, *_: object) -> None:
        self._stale = True
        # Sessions tell from whichever thread changed them.
        self._controller.scheduler.soon(self.draw)

    # The crosshair.

    def _go_to(self, voxel: Voxel) -> None:
        if voxel == self.crosshair:
            return
        before, self.crosshair = self.crosshair, voxel
        self.events.crosshair.emit(voxel)
        if self._open:
            tints = self.tints()
            for plane in PLANES:
                if voxel[plane.normal] != before[plane.normal]:
                    self._draw(plane, tints)

    def _voxel(self, there: ArrayLike) -> Voxel:
        last = np.array(self._session.labels.shape) - 1
        z, y, x = (int(v) for v in np.clip(np.rint(np.asarray(there)), 0, last))
        return z, y, x

    def _follow(self, ids: frozenset[int]) -> None:
        """Go to an object that was selected elsewhere, unless the crosshair is in it."""
        known = [i for i in ids if i in self._session.states]
        if len(known) == 1 and self.object_at(self.crosshair) != known[0]:
            self._go_to(self._voxel(middle_of(self._session, known[0])))
        self._redraw()

    # The 3D view.

    def _move(self, viewer: napari.Viewer, event: MouseEvent) -> None:
        """Follow the pointer over the canvas; the object under it is known by now."""
        voxel = self._in_3d(event) if viewer.dims.ndisplay == 3 else self._in_2d(event)
        if voxel is not None:
            self._go_to(voxel)
            # The pointer itself is there.
            self._mark(False)

    def _in_3d(self, event: MouseEvent) -> Voxel | None:
        pixel = np.array([event.pos[1], event.pos[0]], dtype=np.float64)
        point = surface_point(self._controller, pixel)
        return None if point is None else self._voxel(point.at / self.spacing)

    def _in_2d(self, event: MouseEvent) -> Voxel | None:
        there = np.asarray(event.position, dtype=np.float64)[-3:]
        # Slices of napari's show the whole bag, of which an opened object is only a part.
        if self._controller.outer_session is not None or len(there) < 3:
            return None
        spot = np.rint(
            voxel_at(self._controller.packed, there, units_of(self._controller.viewer))
        ).astype(np.int64)
        inside = (spot >= 0).all() and (spot < self.shape).all()
        return self._voxel(spot) if inside else None

    def _mark(self, marked: bool) -> None:
        """Show the crosshair's point in the 3D view, or not."""
        if marked or self._marked:
            repaint = self._controller.renderer.transition.repaint
            self._controller.scheduler.throttle(MARK_MS, repaint)
        self._marked = marked

    def _marker_point(self, frame: Frame) -> tuple[Vector, Camera] | None:
        renderer, object_id = self._controller.renderer, self.object_at(self.crosshair)
        # Beside an inspected object the bag is dimmed, and so would be what the point is on.
        away = bool(renderer.inspected) and renderer.inspected != object_id
        projection = renderer.picker.projection_of(object_id, frame)
        if not self._marked or away or projection is None:
            return None
        there = np.array(self.crosshair) * self.spacing
        return transform_points(projection.pivot_from_scan, there), projection.camera


def _slot(plane: Plane) -> tuple[str, Plane]:
    return "slice", plane


def image_of(controller: SessionController) -> Image | None:
    """Return the image a session was made of; None for what is inside an object."""
    if controller.outer_session is not None:
        return None
    return next((layer for layer in controller.sources if isinstance(layer, Image)), None)


def limits_of(image: Image | None) -> Window | None:
    """Return the contrast limits of an image, None without one."""
    if image is None:
        return None
    low, high = image.contrast_limits
    return float(low), float(high)


def limits_chosen(image: Image) -> bool:
    """Tell whether somebody chose an image's contrast limits, rather than napari.

    Notes
    -----
    napari does not say. It begins with the whole range of the data, in which metal leaves plastic
    and water nearly black: floats, but for bytes 0 to 255. Of data that are no NumPy array it
    takes those of the first plane. What is given as just these, to the last digit and of the same
    kind, passes for napari's; set while the slices are open it is followed.
    """
    data = image.data[-1] if image.multiscale else image.data
    if image.multiscale or not isinstance(data, np.ndarray):
        data = data[(0,) * (data.ndim - 2)]
    limits = image.contrast_limits
    if limits != [*calc_data_range(data, dtype=image.dtype)]:
        return True
    return image.dtype != np.uint8 and any(type(limit) is not float for limit in limits)


def middle_of(session: Session, object_id: int) -> NDArray[np.float64]:
    """Return the voxel of an object nearest to its middle, in the middle slice of its box.

    Parameters
    ----------
    session : Session
    object_id : int
    """
    box = session.boxes.slices(object_id)
    z = (box[0].start + box[0].stop - 1) // 2
    spots = np.argwhere(session.labels[z, box[1], box[2]] == object_id)
    # Parts of an object may lie on either side of the slice.
    if not len(spots):
        return session.boxes.center(object_id, np.ones(3))
    nearest = spots[((spots - spots.mean(axis=0)) ** 2).sum(axis=1).argmin()]
    return np.array([z, box[1].start + nearest[0], box[2].start + nearest[1]], dtype=np.float64)
