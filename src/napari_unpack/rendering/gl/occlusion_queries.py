"""Occlusion queries: the driver counts every object's blocked rays, a pass an object.

The paper's first method. It needs nothing above OpenGL 1.5, so it is what old drivers and macOS
have; each pass is confined to the object's rectangle of the image and to its box along the ray.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from vispy import gloo

from napari_unpack.geometry.axes import flip
from napari_unpack.geometry.boxes import LabelBoxes, box_corners
from napari_unpack.geometry.rays import Rays
from napari_unpack.rendering.gl.framebuffer import Target, current_context
from napari_unpack.rendering.gl.programs import compiled
from napari_unpack.rendering.gl.textures import VolumeTextures
from napari_unpack.rendering.gl.uniforms import assign, plane_uniforms, ray_uniforms

# Above this many objects one pass for all of them is the better way.
MOST_QUERIED = 256


@dataclass(frozen=True, eq=False)
class FirstHits:
    """What occlusion queries count of every object.

    Parameters
    ----------
    ids : (n,) ndarray of int64
        Objects queried, ascending.
    hits, occluded_hits : (n,) ndarray of int64
        Rays that meet the object, and those of them whose first object is another.
    """

    ids: NDArray[np.int64]
    hits: NDArray[np.int64]
    occluded_hits: NDArray[np.int64]

    @property
    def ratios(self) -> dict[int, float]:
        """Occlusion ratio `first_hit` of every object that a ray meets."""
        met = self.hits > 0
        shares = self.occluded_hits[met] / self.hits[met]
        return dict(zip(self.ids[met].tolist(), shares.tolist(), strict=True))


class OcclusionQueries:
    """The query passes of one GL context."""

    def __init__(self) -> None:
        self._program: gloo.Program | None = None

    def count(
        self,
        target: Target,
        first: Target,
        textures: VolumeTextures,
        rays: Rays,
        boxes: LabelBoxes,
        visible: NDArray[np.bool_],
    ) -> FirstHits:
        """Count the rays that meet every visible object, and those that meet it behind another.

        Parameters
        ----------
        target : Target
            One channel, of the rays' size; what is drawn there means nothing.
        first : Target
            The first object-ID layer of the same rays and visible objects.
        textures : VolumeTextures
            Labels suffice.
        rays : Rays
            Orthographic, looking along -D.
        boxes : LabelBoxes
        visible : (M,) ndarray of bool
            By ID.

        Notes
        -----
        Li et al. 2012, section 5.1, `find1stOccluded`, one query an object. The paper takes the
        front area of the object's box for the denominator; here a second query counts it.
        """
        from OpenGL import GL

        if self._program is None:
            self._program = compiled("occluded_first_hit.frag")
        ids = boxes.ids[visible[boxes.ids]]
        assign(
            self._program,
            ray_uniforms(rays, textures)
            | plane_uniforms(None)
            | {"u_first": first.textures[0], "u_size": (float(rays.size[1]), float(rays.size[0]))},
        )
        context = current_context()
        queries = np.atleast_1d(np.asarray(GL.glGenQueries(max(2 * len(ids), 1)), np.uint32))
        try:
            with target.drawing():
                gloo.set_state(scissor_test=True)
                for place, name in enumerate(ids.tolist()):
                    row = boxes.index(name)
                    low, high = boxes.lower[row], boxes.upper[row]
                    window = picture_window(rays, low, high)
                    gloo.set_scissor(*window)
                    box = {"u_low": flip(low), "u_high": flip(high), "u_queried": float(name)}
                    for occluded in (0, 1):
                        assign(self._program, box | {"u_occluded": float(occluded)})
                        context.flush_commands()
                        GL.glBeginQuery(GL.GL_SAMPLES_PASSED, int(queries[2 * place + occluded]))
                        self._program.draw("triangle_strip")
                        context.flush_commands()
                        GL.glEndQuery(GL.GL_SAMPLES_PASSED)
            found = [_result(int(q)) for q in queries[: 2 * len(ids)]]
        finally:
            GL.glDeleteQueries(len(queries), queries)
        table = np.array(found, np.int64).reshape(-1, 2)
        return FirstHits(ids, table[:, 0], table[:, 1])


def picture_window(
    rays: Rays, low: NDArray[np.int64], high: NDArray[np.int64]
) -> tuple[int, int, int, int]:
    """Return the pixels whose parallel rays may meet a box.

    Parameters
    ----------
    rays : Rays
        Orthographic.
    low, high : (3,) ndarray of int64
        Half-open box in voxels, z y x.

    Returns
    -------
    (int, int, int, int)
        First column, first row, width and height, cut to the image; at least one pixel.
    """
    corners = box_corners(low.astype(np.float64) - 0.5, high.astype(np.float64) - 0.5)
    columns = np.stack([rays.table[1], rays.table[2], rays.table[3]], axis=1)
    rows_cols = np.linalg.solve(columns, (corners - rays.table[0]).T)[:2]
    last = np.array(rays.size) - 1
    first = np.clip(np.floor(rows_cols.min(axis=1)).astype(int), 0, last)
    end = np.clip(np.ceil(rows_cols.max(axis=1)).astype(int), first, last)
    height, width = end - first + 1
    return int(first[1]), int(first[0]), int(width), int(height)


def _result(query: int) -> int:
    from OpenGL import GL

    return int(np.asarray(GL.glGetQueryObjectuiv(query, GL.GL_QUERY_RESULT)).reshape(-1)[0])
