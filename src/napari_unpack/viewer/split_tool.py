"""Two clicks on one object, in the 3D view or in a slice, that say where to split it."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.rays import voxel_from_world
from napari_unpack.layers.placement import units_of, voxel_at
from napari_unpack.rendering.casting import rays_for
from napari_unpack.session.object_state import ObjectState
from napari_unpack.viewer.interaction import CLICK_PIXELS
from napari_unpack.viewer.protocols import MouseEvent

if TYPE_CHECKING:
    import napari

    from napari_unpack.session import Session
    from napari_unpack.viewer.controller import SessionController

# So far under the surface a click counts: fringes belong to no side.
BELOW_SURFACE_VOXELS = 3

Voxel = tuple[int, int, int]


class SplitTool:
    """Follows the viewer's mouse until two voxels of one object were clicked.

    Parameters
    ----------
    controller : SessionController
        An open one.
    message : callable
        Given a sentence on what to click next.
    done : callable
        Given the object and both voxels (z, y, x); not called where `close` came first.
    """

    def __init__(
        self,
        controller: SessionController,
        message: Callable[[str], None],
        done: Callable[[int, Voxel, Voxel], None],
    ) -> None:
        self._controller, self._message, self._done = controller, message, done
        self._first: tuple[int, Voxel] | None = None
        controller.viewer.mouse_drag_callbacks.append(self._drag)
        message("Click the object to split, on the part that should stay.")

    def close(self) -> None:
        """Give the mouse back."""
        if self._drag in self._controller.viewer.mouse_drag_callbacks:
            self._controller.viewer.mouse_drag_callbacks.remove(self._drag)

    def _drag(self, viewer: napari.Viewer, event: MouseEvent) -> Generator[None, None, None]:
        if event.button != 1:
            return
        start = np.asarray(event.pos[:2], dtype=np.float64)
        position = np.asarray(event.position, dtype=np.float64)
        yield
        while event.type == "mouse_move":
            # The user turns the bag to see the other part.
            if float(np.abs(np.asarray(event.pos[:2]) - start).max()) > CLICK_PIXELS:
                return
            yield
        flat = viewer.dims.ndisplay == 2
        found = self._in_slice(position) if flat else self._in_3d(start[::-1])
        self._take(found)

    def _take(self, found: tuple[int, Voxel] | None) -> None:
        session = self._controller.session
        if found is None:
            self._message("There is no packed object there: click on one.")
            return
        name = str(session.objects["name"][found[0]])
        if self._first is None:
            self._first = found
            self._message(f"Now click the other part of {name}.")
        elif found[0] != self._first[0]:
            self._first = found
            self._message(f"That is another object; now click the other part of {name}.")
        # The same voxel twice, a double click say, tells no two parts apart.
        elif found[1] != self._first[1]:
            self.close()
            self._done(found[0], self._first[1], found[1])

    def _in_3d(self, pixel: NDArray[np.float64]) -> tuple[int, Voxel] | None:
        there = self._controller.interaction.packed_at(pixel)
        if not there:
            return None
        # The second click is meant for the object of the first, where that can be seen at all.
        wanted = there[0]
        if self._first is not None and self._first[0] in there:
            wanted = self._first[0]
        voxel = surface_voxel(self._controller, pixel, wanted)
        return None if voxel is None else (wanted, voxel)

    def _in_slice(self, position: NDArray[np.float64]) -> tuple[int, Voxel] | None:
        layer, session = self._controller.packed, self._controller.session
        spot = voxel_at(layer, position, units_of(self._controller.viewer))
        if (spot < 0).any() or (spot >= session.labels.shape).any():
            return None
        label = int(session.labels[tuple(spot)])
        packed = session.states.get(label) is ObjectState.PACKED
        return (label, _voxel(spot)) if packed else None


def surface_voxel(
    controller: SessionController, pixel: NDArray[np.float64], object_id: int
) -> Voxel | None:
    """Return the voxel of an object that a pixel of the canvas shows, just under its surface.

    Parameters
    ----------
    controller : SessionController
    pixel : (2,) ndarray of float64
        Of the canvas, row and column.
    object_id : int
        A packed object.
    """
    session, frame = controller.session, controller.frame
    if frame is None:
        return None
    row, col = controller.interaction.frame_pixel(pixel)
    rays = rays_for(
        frame.camera, frame.size, session.spacing, voxel_from_world(session.spacing), 0.5
    )
    reach = float(np.linalg.norm(np.array(session.labels.shape) * session.spacing))
    # From one end of the bag to the other, wherever the camera is centred.
    reach += float(np.linalg.norm(frame.camera.center - session.bag.center))
    reach *= float(np.linalg.norm(frame.camera.stretch, 2))
    t = np.arange(max(-reach, rays.near), reach, rays.step)
    weights = np.array([1.0, row, col])
    points = weights @ rays.table[:3] + t[:, None] * (weights @ rays.table[3:])
    spots = np.rint(points).astype(np.int64)
    inside = ((spots >= 0) & (spots < session.labels.shape)).all(axis=1)
    spots = spots[inside]
    hits = np.flatnonzero(session.labels[tuple(spots.T)] == object_id)
    if not len(hits):
        return _beside(session, spots, object_id)
    # The first run of hits, some voxels deep or to its middle where it is thinner.
    gaps = np.flatnonzero(np.diff(hits) > 1)
    run = hits[: gaps[0] + 1] if len(gaps) else hits
    return _voxel(spots[run[min(2 * BELOW_SURFACE_VOXELS, len(run) // 2)]])


def _beside(session: Session, spots: NDArray[np.int64], object_id: int) -> Voxel | None:
    """Return the object's voxel nearest to where a ray passes through its fringe."""
    fringe = np.flatnonzero(session.display_labels[tuple(spots.T)] == object_id)
    if not len(fringe):
        return None
    spot = spots[fringe[0]]
    low = np.maximum(spot - BELOW_SURFACE_VOXELS, 0)
    box = tuple(
        slice(int(a), int(b) + BELOW_SURFACE_VOXELS + 1) for a, b in zip(low, spot, strict=True)
    )
    near = np.argwhere(session.labels[box] == object_id) + low
    away = ((near - spot) ** 2).sum(axis=1)
    return _voxel(near[away.argmin()]) if len(near) else None


def _voxel(spot: NDArray[np.int64]) -> Voxel:
    z, y, x = (int(v) for v in spot)
    return z, y, x
