"""Where the viewer's camera goes by itself: to all there is, to a side of it, to one object."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import transform_points
from napari_unpack.geometry.camera_glide import CameraGlide
from napari_unpack.geometry.view import Camera
from napari_unpack.layers import compat
from napari_unpack.layers.packed_layer import PackedLayer
from napari_unpack.layers.placement import scene_from_world, units_of
from napari_unpack.rendering.compose import SHARE_OF_VIEW
from napari_unpack.session.framing import alike, contained, fitted
from napari_unpack.viewer.camera_sync import point_camera
from napari_unpack.viewer.scene_renderer import SceneRenderer
from napari_unpack.viewer.scheduler import Scheduler
from napari_unpack.viewer.viewer_state import SavedView

if TYPE_CHECKING:
    import napari

    from napari_unpack.session import Session


@dataclass(frozen=True, eq=False)
class _Before:
    """The view before an inspection: napari's own, the camera of it, and whether it held all.

    napari's own is None where slices were looked at.
    """

    view: SavedView | None
    seen: Camera
    target: Camera | None


@dataclass(frozen=True, eq=False)
class _Given:
    """A camera that was asked for, the window it is of, and what shows as much in this one."""

    camera: Camera
    window: tuple[int, int]
    target: Camera


class Framing:
    """Moves the camera of one viewer, and leaves alone what a person has zoomed or panned.

    Parameters
    ----------
    viewer : napari.Viewer
    session : Session
    layer : PackedLayer
        Knows how the canvas looks.
    renderer : SceneRenderer
    scheduler : Scheduler
    drawn : callable
        Returns what is drawn about the bag and to be seen, (N, 3) world mm.

    Notes
    -----
    Turning is not zooming: the camera is still drawn back for what comes out after it.
    """

    def __init__(
        self,
        viewer: napari.Viewer,
        session: Session,
        layer: PackedLayer,
        renderer: SceneRenderer,
        scheduler: Scheduler,
        drawn: Callable[[], NDArray[np.float64]],
    ) -> None:
        self._viewer, self._session, self._layer = viewer, session, layer
        self._renderer, self._scheduler, self._drawn = renderer, scheduler, drawn
        self._glide: CameraGlide | None = None
        # What the camera was set to last, where it is going, and the last of these to hold all.
        self._set: Camera | None = None
        self._target: Camera | None = None
        self._fit: Camera | None = None
        # How a saved session was looked at, until something else moves the camera.
        self._given: _Given | None = None
        self._size = (0, 0)
        self._axes, self._units = layer.axis_order, units_of(viewer)
        # Whether slices are looked at, whose camera stays, and what was asked of it meanwhile.
        self._sliced = self._late = False
        # napari's camera as it was in 3D: it has one for slices too, and fits it to other axes.
        self._solid: SavedView | None = None
        self._side: NDArray[np.float64] | None = None
        self._before: _Before | None = None
        # By the session's clock: a film that steps it glides along.
        self.animation = scheduler.animate(self._tick, lambda: session.clock())

    @property
    def settled(self) -> bool:
        """Whether the camera is where it goes by itself."""
        return not (self.animation.running or self._scheduler.pending(self._follow))

    @property
    def is_fit(self) -> bool:
        """Whether a person has neither zoomed nor panned since all was brought into view."""
        return self._fit is not None and self._fit is self._target and self._untouched()

    def open(self) -> None:
        """Follow napari's Home button, its order of axes and its units from now on."""
        self._axes, self._units = self._layer.axis_order, units_of(self._viewer)
        self._viewer.events.reset_view.connect(self._follow_home)
        self._viewer.dims.events.ndisplay.connect(self._follow_dims)
        self._viewer.dims.events.units.connect(self._follow_dims)

    def close(self) -> None:
        """Move the camera no more."""
        self._viewer.events.reset_view.disconnect(self._follow_home)
        self._viewer.dims.events.ndisplay.disconnect(self._follow_dims)
        self._viewer.dims.events.units.disconnect(self._follow_dims)
        self._scheduler.forget(self._follow)
        self._stop()

    def fit(self, glides: bool = True, camera: Camera | None = None) -> None:
        """Bring the bag and all that is out of it into view; in an inspection its object.

        Parameters
        ----------
        glides : bool, optional
            False is there at once.
        camera : Camera, optional
            Which way to look; by default as now.
        """
        self._session.canvas_size = self._size = _pixels(self._viewer)
        self._go_fit(self._fitted(camera or self._seen), glides)

    def look_from(self, camera: Camera, window: tuple[int, int] | None = None) -> None:
        """Have the camera look so, at once.

        Parameters
        ----------
        camera : Camera
        window : (int, int), optional
            Height and width of the window in which it looked so: all that showed there shows.
        """
        self._session.canvas_size = self._size = _pixels(self._viewer)
        # As saved by a person who saw it fitted: room is then made for what comes out.
        whole = self._fitted(camera)
        self._look_given(camera, self._size if window is None else window)
        self._fit = self._target if alike(self._target or camera, whole) else None

    def turn_to(self, rotation: np.ndarray) -> None:
        """Look from another side; what a person has zoomed to stays as near.

        A slice has no sides: from 2D it is done when the bag comes back.

        Parameters
        ----------
        rotation : (3, 3) ndarray of float64
            From (stretched) world axes to pivot axes.
        """
        if self._viewer.dims.ndisplay != 3:
            self._side = rotation
            return
        turned = replace(self._seen, rotation=rotation)
        if self.is_fit:
            self._go_fit(self._fitted(turned))
        else:
            self._go(turned)

    def turn_by(self, rotation: np.ndarray) -> None:
        """Turn the bag, or what is inspected, at once, as a drag does; zoom and fit stay.

        Parameters
        ----------
        rotation : (3, 3) ndarray of float64
            Of pivot space.
        """
        held = self._renderer.animator.turned_by_hand
        if held:
            self._renderer.held.turn(held, rotation)
            self._renderer.held.turned(held)
        elif self._viewer.dims.ndisplay == 3:
            if self._glide is not None:
                self._tick(float("inf"))
            seen = self._seen
            turned = replace(seen, rotation=rotation @ seen.rotation)
            point_camera(self._viewer, self._layer, turned)

    def zoom_by(self, factor: float) -> None:
        """Show everything larger, as the wheel does: as near it is a person's from here on."""
        self._viewer.scene.camera.zoom *= factor

    def move_by(self, down: float, right: float) -> None:
        """Look at what is further down and to the right: the view is a person's from here on.

        Parameters
        ----------
        down, right : float
            In visible heights.
        """
        if self._viewer.dims.ndisplay == 3:
            seen = self._seen
            step = seen.rotation.T @ np.array([0.0, down * seen.height, right * seen.height])
            center = seen.center + np.linalg.solve(seen.stretch, step)
            point_camera(self._viewer, self._layer, replace(seen, center=center))

    def follow(self) -> None:
        """Make room for what comes out, and fill the window again as things go back."""
        # What asks may be a draw, in which the camera must not move.
        self._scheduler.debounce(0, self._follow)

    def begin_inspection(self, object_id: int) -> None:
        """Keep the view to come back to; bring near what is inspected in the bag.

        Parameters
        ----------
        object_id : int
        """
        if self._before is not None:
            return
        target = self._fit if self.is_fit else None
        solid = self._viewer.dims.ndisplay == 3
        view = SavedView.of(self._viewer.scene.camera) if solid else None
        self._before = _Before(view, self._seen, target)
        if object_id not in self._session.state.placements:
            self._go(_near(self._session, self._seen, object_id))

    def leave_inspection(self) -> None:
        """Glide back, while the object goes back."""
        if self._before is not None:
            self._go(_as_deep(self._viewer, self._before.seen))

    def end_inspection(self) -> None:
        """Be back where the inspection began."""
        if self._before is None:
            return
        self._stop()
        before, self._before = self._before, None
        self._target = before.target
        if before.view is None or self._viewer.dims.ndisplay != 3:
            self._look(_as_deep(self._viewer, before.seen))
        else:
            # Its own numbers, which no rounding has moved.
            self._set, self._late = before.seen, False
            camera = self._viewer.scene.camera
            replace(before.view, perspective=float(camera.perspective)).give_back(camera)
        self.follow()

    def catch_up(self, finish: bool = False) -> None:
        """Do what the next tick would do.

        Parameters
        ----------
        finish : bool, optional
            Be where the camera goes.
        """
        if self._scheduler.pending(self._follow):
            self._scheduler.forget(self._follow)
            self._follow()
        if self._glide is not None:
            self._tick(float("inf") if finish else self.animation.now())

    @property
    def _seen(self) -> Camera:
        frame = self._layer.frame_now()
        return self._session.camera if frame is None else frame.camera

    def _fitted(self, camera: Camera) -> Camera:
        return fitted(self._session, camera, self._drawn())

    def _untouched(self) -> bool:
        """Tell whether the camera is as near and where it was put last; turned, perhaps."""
        frame = self._layer.frame_now()
        # Not drawn yet, there is nothing that a person could have moved.
        if frame is None or self._set is None:
            return True
        # Where the window has grown, as much more is seen at the same zoom.
        grown = frame.size[0] / self._size[0]
        return alike(frame.camera, replace(self._set, height=self._set.height * grown))

    def _follow(self) -> None:
        if self._viewer.dims.ndisplay != 3:
            return
        if self._late and self._set is not None:
            # Of slices: sliders beneath them leave the canvas less room.
            self._session.canvas_size = self._size = _pixels(self._viewer)
            self._look(self._set)
        if self._side is not None:
            side, self._side = self._side, None
            self.turn_to(side)
        session = self._session
        resized = session.canvas_size != self._size
        given = self._given
        kept = given is not None and given.target is self._target and not self.is_fit
        if resized and given is not None and kept and self._untouched():
            # The window is still being laid out: as much is to be seen as when it was saved.
            self._size = session.canvas_size
            self._look_given(_as_deep(self._viewer, given.camera), given.window)
            return
        # Before the size is taken over, by which it is known whether a person has zoomed.
        if self._before is not None or not self.is_fit or self._fit is None:
            return
        self._size = session.canvas_size
        # As near as it was turned then: to turn the bag brings it no nearer.
        wanted = self._fitted(_as_deep(self._viewer, self._fit))
        if resized or not alike(wanted, self._fit):
            self._go_fit(replace(wanted, rotation=self._seen.rotation), glides=not resized)

    def _follow_dims(self, _event: Any = None) -> None:
        self._follow_units()
        camera = self._viewer.scene.camera
        was_sliced, self._sliced = self._sliced, self._viewer.dims.ndisplay != 3
        if self._sliced and not was_sliced:
            self._solid = SavedView.of(camera)
        if self._follow_axes() or self._sliced or not was_sliced:
            return
        solid, self._solid = self._solid or SavedView.of(camera), None
        # napari looks at the slice: from another side the bag would stand beside the middle.
        scene = scene_from_world(self._layer, self._units)
        depth = transform_points(scene, self._session.camera.center)[0]
        camera.center = (float(depth), *solid.center[-2:])
        camera.zoom = solid.zoom
        self.follow()

    def _follow_units(self) -> None:
        """Have all stay where it is seen where napari's world has other units."""
        units, camera = units_of(self._viewer), self._viewer.scene.camera
        if units == self._units:
            return
        before, now = (scene_from_world(self._layer, each) for each in (self._units, units))
        moved, self._units = now @ np.linalg.inv(before), units
        compat.draw_in_units(self._viewer, self._layer, units)
        # napari's camera keeps its numbers, which mean another place and size from here on.
        SavedView.of(camera).moved(moved).give_back(camera)
        if self._solid is not None:
            self._solid = self._solid.moved(moved)
        if self._before is not None and self._before.view is not None:
            self._before = replace(self._before, view=self._before.view.moved(moved))

    def _follow_axes(self) -> bool:
        """Bring all into view where napari has ordered its axes anew, and return whether it has."""
        axes = self._layer.axis_order
        if self._viewer.dims.ndisplay != 3 or axes == self._axes:
            return False
        # napari keeps its angles and turns what is seen: no view of before leads anywhere.
        self._axes, self._before, self._side = axes, None, None
        self.fit(glides=False)
        return True

    def _follow_home(self, _event: Any = None) -> None:
        if self._viewer.dims.ndisplay != 3 or self._follow_axes():
            return
        frame = self._renderer.frame
        # napari has reset the camera by now; what was seen before is what is gone on from.
        origin = self._session.camera if frame is None else frame.camera
        if self._session.canvas_size != self._size and self._scheduler.pending(self._follow):
            # For a picture of another size, after which napari puts its own view back.
            point_camera(self._viewer, self._layer, self._fitted(origin))
            return
        self._go_fit(self._fitted(origin), origin=origin)

    def _look_given(self, camera: Camera, window: tuple[int, int]) -> None:
        target = contained(camera, window, self._size)
        self._given = _Given(camera, window, target)
        self._go(target, glides=False)

    def _go_fit(self, camera: Camera, glides: bool = True, origin: Camera | None = None) -> None:
        inspected = self._session.state.inspected
        if self._before is not None and inspected is not None:
            packed = inspected not in self._session.state.placements
            near = _near(self._session, self._seen, inspected)
            self._go(near if packed else _as_deep(self._viewer, self._before.seen), origin=origin)
            return
        self._fit = camera
        self._go(camera, glides, origin)

    def _go(self, camera: Camera, glides: bool = True, origin: Camera | None = None) -> None:
        self._stop()
        self._target = camera
        seen = self._seen if origin is None else origin
        shown = self._renderer.frame is not None and self._viewer.dims.ndisplay == 3
        allowed = self._renderer.packed_renderer.fade.allowed
        same = alike(seen, camera) and np.allclose(seen.rotation, camera.rotation, atol=1e-6)
        if not (glides and shown and allowed) or same:
            self._look(camera)
            return
        self._glide = CameraGlide(seen, camera, self.animation.now())
        self._look(seen, turns=origin is not None)
        self.animation.start()

    def _look(self, camera: Camera, turns: bool = True) -> None:
        self._set, self._late = camera, self._viewer.dims.ndisplay != 3
        if not self._late:
            point_camera(self._viewer, self._layer, camera, turns)

    def _tick(self, now: float) -> None:
        glide = self._glide
        if glide is None or not self._untouched():
            # A wheel or a hand has taken the camera: it is a person's from here on.
            self._stop()
            return
        camera = glide.camera(now)
        self._look(camera, glide.turns)
        if glide.done(now):
            self._stop()

    def _stop(self) -> None:
        self._glide = None
        self.animation.stop()


def _as_deep(viewer: napari.Viewer, camera: Camera) -> Camera:
    """Return a camera with the perspective of a viewer's, which a person may have changed."""
    return replace(camera, fov=float(viewer.scene.camera.perspective))


def _pixels(viewer: napari.Viewer) -> tuple[int, int]:
    """Return height and width of a viewer's canvas."""
    # Slots of sprites are planned for device pixels; napari counts logical ones.
    height, width = viewer.canvas.size
    pixels = compat.pixel_scale(viewer)
    return max(1, round(height * pixels)), max(1, round(width * pixels))


def _near(session: Session, seen: Camera, object_id: int) -> Camera:
    """Return the camera that an object fills where it lies, seen as now."""
    spacing, (rows, cols) = session.spacing, session.canvas_size
    diameter = 2 * session.boxes.radius(object_id, spacing, seen.stretch)
    height = diameter / SHARE_OF_VIEW / min(1.0, cols / rows)
    return replace(seen, center=session.boxes.center(object_id, spacing), height=height)
