"""The camera that brings the bag and what is out of it into view: for the window and for films.

With nothing out the bag fills the window, and each object that comes out has the camera draw back
as far as its slot needs. Slots are planned in steps (`unpacking.slots`), so that few sprites leave
the bag large.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.boxes import box_corners
from napari_unpack.geometry.view import Camera
from napari_unpack.unpacking.slots import Slots, margin_pixels

if TYPE_CHECKING:
    from napari_unpack.session.session import Session

# Of the window's shorter side, at least, the longer side of the bag's picture while nothing is
# out. A tenth above what is promised: outlines are of voxel centres, and fringes are faint.
SHARE_OF_BAG = 0.78

# Of the view's height: napari rounds on its way to the canvas, and a notch of a wheel is 20 times
# as much.
ALIKE = 5e-3


def fitted(
    session: Session,
    camera: Camera | None = None,
    drawn: NDArray[np.float64] | None = None,
) -> Camera:
    """Return the camera that brings the bag, its box and all that is out and seen into view.

    Parameters
    ----------
    session : Session
        Of its window's shape.
    camera : Camera, optional
        Which way to look, and with which perspective; by default as the session's.
    drawn : (N, 3) ndarray of float64, optional
        What else is drawn about the bag, world mm.
    """
    camera = session.camera if camera is None else camera
    rows, cols = session.canvas_size
    slots = session.slots
    # Half a height of the window that is needed for what reaches so far down, or right.
    upright = np.array([1.0, rows / cols])
    margin = _margin(session)
    radius = slots.bag_radius_px * slots.height_mm / rows + margin
    silhouette = session.bag.silhouette
    longer = float(np.ptp(_away(session, camera, silhouette)[:, 1:], axis=0).max())
    # A round bag fits at every turn. A flat or long one may reach over the edge as it is turned:
    # it would be small else in nearly every view.
    least = longer / (2 * SHARE_OF_BAG) * rows / min(rows, cols)
    least = min(float(radius * upright.max()), least)
    half = [max(least, _reach(session, camera, silhouette, margin))]
    half += [_half_height(center, slots, margin, upright) for center in _out(session)]
    around = [] if drawn is None else [drawn]
    if session.decorations.box:
        around.append(box_corners(session.bag.lower, session.bag.upper))
    half += [_reach(session, camera, points, margin) for points in around if len(points)]
    return replace(camera, center=session.bag.center, height=2 * max(half))


def height_with(session: Session, ids: Iterable[int]) -> float:
    """Return the height of view in which objects at their slots are seen whole, mm.

    Parameters
    ----------
    session : Session
        Of its window's shape.
    ids : iterable of int
        Objects outside the bag.
    """
    rows, cols = session.canvas_size
    slots, poses = session.slots, session.poses
    margin, upright = _margin(session), np.array([1.0, rows / cols])
    return 2 * max(_half_height(poses[i].center, slots, margin, upright) for i in ids)


def drawn_back(session: Session, camera: Camera, ids: Iterable[int]) -> Camera:
    """Return a camera from as far off as it takes to see objects at their slots whole.

    Parameters
    ----------
    session : Session
        Of its window's shape.
    camera : Camera
        Wherever it looks; it comes no nearer.
    ids : iterable of int
        Objects outside the bag; without any, the camera is returned as it is.
    """
    out = list(ids)
    if not out:
        return camera
    rows, cols = session.canvas_size
    # Slots lie about the bag's middle, which a person may have moved out of the window's.
    aside = np.abs(_away(session, camera, camera.center)[1:]) * (1.0, rows / cols)
    needed = height_with(session, out) + 2 * float(aside.max())
    return replace(camera, height=max(camera.height, needed))


def contained(camera: Camera, window: tuple[int, int], size: tuple[int, int]) -> Camera:
    """Return the camera that shows in an image all that it shows in a window.

    Parameters
    ----------
    camera : Camera
    window, size : (int, int)
        Height and width of the window, and of the image.
    """
    wider = (window[1] / window[0]) / (size[1] / size[0])
    return replace(camera, height=camera.height * max(1.0, wider))


def alike(a: Camera, b: Camera) -> bool:
    """Tell whether two cameras are as near and look at the same point, however turned.

    Parameters
    ----------
    a, b : Camera
    """
    apart = float(np.abs(a.center - b.center).max())
    return abs(a.height / b.height - 1) <= ALIKE and apart <= ALIKE * b.height


def _margin(session: Session) -> float:
    """Return how far from the window's edge things are to stand, mm."""
    rows, cols = session.canvas_size
    return margin_pixels(rows, cols) * session.slots.height_mm / rows


def _half_height(
    center: NDArray[np.float64], slots: Slots, margin: float, upright: NDArray[np.float64]
) -> float:
    """Return half the height in which what waits at a place, pivot space, has room."""
    # All of its cell: turned by hand it may come to fill that.
    reach = np.abs(center[1:]) + slots.cell_mm / 2 + margin
    return float((reach * upright).max())


def _away(session: Session, camera: Camera, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return world points from the bag's middle on, (N, 3) in mm: towards the eye, down, right."""
    return np.asarray((points - session.bag.center) @ camera.linear.T)


def _reach(session: Session, camera: Camera, points: NDArray[np.float64], margin: float) -> float:
    """Return half the height in which world points have room."""
    rows, cols = session.canvas_size
    away = _away(session, camera, points)
    # In perspective the view is narrower where it is nearer to the eye.
    narrower = away[:, :1] * np.tan(np.radians(camera.fov) / 2)
    return float(((np.abs(away[:, 1:]) + margin) * (1.0, rows / cols) + narrower).max())


def _out(session: Session) -> list[np.ndarray]:
    """Return the centres of what is out and in sight, or flies there, pivot space."""
    slots, stretch = session.slots, session.camera.stretch
    out, hidden = session.state.placements, session.state.hidden
    return [one.pose(slots, stretch).center for i, one in out.items() if i not in hidden]
