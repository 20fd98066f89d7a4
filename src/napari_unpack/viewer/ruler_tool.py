"""Clicks on surfaces, in the 3D view or in a slice, that measure a length or an angle."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import triple
from napari_unpack.session.measurements import SurfacePoint, owner_after
from napari_unpack.viewer.protocols import Pixel
from napari_unpack.viewer.surface_points import label_at, surface_point

if TYPE_CHECKING:
    from napari_unpack.viewer.controller import SessionController

ASKED = {
    2: ("Click the point to measure from.", "Now click the point to measure to."),
    3: (
        "Click a point on the first side of the angle.",
        "Now click the point where the sides meet.",
        "Now click a point on the other side.",
    ),
}


class RulerTool:
    """Takes the viewer's clicks until two points were clicked, or three for an angle.

    Parameters
    ----------
    controller : SessionController
        An open one.
    count : {2, 3}
        How many points.
    message : callable
        Given a sentence on what to click next.
    done : callable
        Given the points; an empty list where they were called off.

    Attributes
    ----------
    count : int
    """

    def __init__(
        self,
        controller: SessionController,
        count: int,
        message: Callable[[str], None],
        done: Callable[[list[SurfacePoint]], None],
    ) -> None:
        self._controller, self.count = controller, count
        self._message, self._done = message, done
        self._points: list[SurfacePoint] = []
        # Of the last click: a repair or undo may come before the next.
        self._labels = controller.session.labels
        controller.interaction.tool = self
        message(ASKED[count][0])

    def cancel(self) -> None:
        """Give the clicks back; nothing is measured."""
        self._end([])

    def click(self, pixel: Pixel) -> None:
        """Take a point of a surface, see `ClickTool`."""
        self._take(surface_point(self._controller, pixel))

    def click_voxel(self, voxel: NDArray[np.float64]) -> None:
        """Take a point of a slice, see `ClickTool`."""
        session = self._controller.session
        label = label_at(session, voxel)
        at = triple(voxel * session.spacing)
        self._take(None if label is None else SurfacePoint(label, at))

    def _take(self, point: SurfacePoint | None) -> None:
        if point is None:
            self._message("There is nothing there to measure: click on an object.")
        # The same place twice, a double click say, has no length.
        elif not self._points or point.at != self._points[-1].at:
            self._points = [*map(self._on_what_is_there, self._points), point]
            self._labels = self._controller.session.labels
            self._controller.rulers.pending = tuple(self._points)
            if len(self._points) == self.count:
                self._end(self._points)
            else:
                self._message(ASKED[self.count][len(self._points)])

    def _on_what_is_there(self, point: SurfacePoint) -> SurfacePoint:
        """Return a point with the object that it is on now; of what was deleted, with none."""
        session = self._controller.session
        owner = owner_after(point, self._labels, session.labels, session.spacing)
        return SurfacePoint(owner if owner in session.states else 0, point.at)

    def _end(self, points: list[SurfacePoint]) -> None:
        self._controller.interaction.tool = None
        self._controller.rulers.pending = ()
        self._done(points)
