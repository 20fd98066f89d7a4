"""Two clicks on one object, in the 3D view or in a slice, that say where to split it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.rays import voxel_from_world
from napari_unpack.rendering.casting import rays_for
from napari_unpack.session.object_state import ObjectState
from napari_unpack.viewer.protocols import Pixel
from napari_unpack.viewer.surface_points import before_planes, label_at

if TYPE_CHECKING:
    from napari_unpack.session import Session
    from napari_unpack.viewer.controller import SessionController

# So far under the surface a click counts: fringes belong to no side.
BELOW_SURFACE_VOXELS = 3

Voxel = tuple[int, int, int]


class SplitTool:
    """Takes the viewer's clicks until two voxels of one object were clicked.

    Parameters
    ----------
    controller : SessionController
        An open one.
    message : callable
        Given a sentence on what to click next, empty at the end.
    done : callable
        Given the object and both voxels (z, y, x); None where they were called off.
    """

    def __init__(
        self,
        controller: SessionController,
        message: Callable[[str], None],
        done: Callable[[tuple[int, Voxel, Voxel] | None], None],
    ) -> None:
        self._controller, self._message, self._done = controller, message, done
        self._clicked: Voxel | None = None
        controller.interaction.tool = self
        message("Click the object to split, on one of its parts. The larger part keeps its number.")

    def cancel(self) -> None:
        """Give the clicks back; nothing is split."""
        self._end(None)

    def click(self, pixel: Pixel) -> None:
        """Take a voxel under a surface, see `ClickTool`."""
        self._take(self._in_3d(pixel))

    def click_voxel(self, voxel: NDArray[np.float64]) -> None:
        """Take a voxel of a slice, see `ClickTool`."""
        session = self._controller.session
        label = label_at(session, voxel)
        if label is None or session.states.get(label) is not ObjectState.PACKED:
            self._take(None)
        else:
            self._take((label, _voxel(np.rint(voxel).astype(np.int64))))

    @property
    def _first(self) -> tuple[int, Voxel] | None:
        """Whose the first click is: a repair or undo may have come since, that left none."""
        session, voxel = self._controller.session, self._clicked
        label = 0 if voxel is None else int(session.labels[voxel])
        packed = session.states.get(label) is ObjectState.PACKED
        return (label, voxel) if packed and voxel is not None else None

    def _end(self, found: tuple[int, Voxel, Voxel] | None) -> None:
        self._controller.interaction.tool = None
        self._message("")
        self._done(found)

    def _take(self, found: tuple[int, Voxel] | None) -> None:
        session = self._controller.session
        if found is None:
            self._message("There is no packed object there: click on one.")
            return
        name, first = str(session.objects["name"][found[0]]), self._first
        if first is None:
            self._clicked = found[1]
            self._message(f"Now click the other part of {name}.")
        elif found[0] != first[0]:
            self._clicked = found[1]
            self._message(f"That is another object; now click the other part of {name}.")
        # The same voxel twice, a double click say, tells no two parts apart.
        elif found[1] != first[1]:
            self._end((found[0], first[1], found[1]))

    def _in_3d(self, pixel: NDArray[np.float64]) -> tuple[int, Voxel] | None:
        there = self._controller.interaction.packed_at(pixel)
        if not there:
            return None
        # The second click is meant for the object of the first, where that can be seen at all.
        wanted, first = there[0], self._first
        if first is not None and first[0] in there:
            wanted = first[0]
        voxel = surface_voxel(self._controller, pixel, wanted)
        return None if voxel is None else (wanted, voxel)


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
    spots = spots[inside & before_planes(points, session.clipping)]
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
