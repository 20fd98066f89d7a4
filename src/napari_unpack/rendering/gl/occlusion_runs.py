"""Occlusion counts from run lengths: shaders walk the rays, numpy adds up.

Needs neither atomics nor queries, so it works wherever the other passes do; on drivers that have
atomics it is the slower way.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from vispy import gloo

from napari_unpack.geometry.occlusion_counts import MOST_IN_TABLE, OcclusionCounts
from napari_unpack.geometry.rays import Rays
from napari_unpack.rendering.gl.framebuffer import Target
from napari_unpack.rendering.gl.lookup_tables import IdTable
from napari_unpack.rendering.gl.programs import compiled
from napari_unpack.rendering.gl.textures import VolumeTextures
from napari_unpack.rendering.gl.uniforms import Leaps, assign, plane_uniforms, ray_uniforms

# Two runs in each of three RGBA targets; the fourth says where to resume.
RUNS_A_PASS = 6
# Where a ray that is done would resume; the twin of shaders/passes/label_runs.frag.
NO_MORE = 1.0e30


class OcclusionPass:
    """The run-length pass of one GL context."""

    # Attachments of its targets: six runs, and where to resume.
    channels = (4, 4, 4, 1)

    def __init__(self) -> None:
        self.visible = IdTable()
        self.leaps = Leaps()
        self._program: gloo.Program | None = None

    def runs(
        self,
        targets: tuple[Target, Target],
        textures: VolumeTextures,
        rays: Rays,
        visible: NDArray[np.bool_],
        occupied: NDArray[np.bool_] | None = None,
    ) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """List the runs of visible objects on every ray.

        Parameters
        ----------
        targets : two Targets
            Of the rays' size, with `channels`; used in turn.
        textures, rays, visible, occupied
            As in `ObjectIdPass.draw`.

        Returns
        -------
        ids, samples : (P, R) ndarray of int32
            ID and samples of the P-th run of every ray that meets something, 0 beyond its last.
        """
        if self._program is None:
            self._program = compiled("label_runs.frag")
        table = np.zeros((len(visible), 4), np.float32)
        table[:, 0] = visible
        assign(
            self._program,
            ray_uniforms(rays, textures)
            | plane_uniforms(None)
            | self.leaps.uniforms(occupied)
            | {
                "u_visible": self.visible.update(table),
                "u_visible_rows": float(self.visible.rows),
                "u_size": (float(rays.size[1]), float(rays.size[0])),
            },
        )
        parts: list[NDArray[np.float32]] = []
        resume = True
        # A pass cannot read what it writes, so two sets of targets take turns.
        while resume:
            target, before = targets[len(parts) % 2], targets[(len(parts) + 1) % 2]
            first = {"u_first": float(not parts), "u_resume": before.textures[3]}
            assign(self._program, first)
            with target.drawing():
                self._program.draw("triangle_strip")
            parts.append(np.concatenate([target.read(i) for i in range(3)], axis=2))
            resume = bool((target.read(3) < NO_MORE).any())
        table_of_runs = np.concatenate(parts, axis=2).reshape(-1, 2 * RUNS_A_PASS * len(parts))
        met = table_of_runs[table_of_runs[:, 0] > 0].astype(np.int32)
        return np.ascontiguousarray(met[:, 0::2].T), np.ascontiguousarray(met[:, 1::2].T)


def counts_of_runs(
    ids: NDArray[np.int32], samples: NDArray[np.int32], visible: NDArray[np.bool_]
) -> OcclusionCounts:
    """Add up who hides whom.

    Parameters
    ----------
    ids, samples : (P, R) ndarray of int32
        Runs in order along each of R rays, 0 beyond the last.
    visible : (M,) ndarray of bool
        By ID.

    Notes
    -----
    Li et al. 2012, section 5.1; see `rendering.cpu.occlusion_counts`. Quadratic in the runs of a
    ray, P, which is about twice the objects it meets.
    """
    size = len(visible)
    candidates = np.flatnonzero(visible)
    slots = np.zeros(size, np.int64)
    slots[candidates] = np.arange(len(candidates))
    tabulate = len(candidates) <= MOST_IN_TABLE
    blocks = np.zeros((len(candidates),) * 2 if tabulate else (0, 0), np.bool_)
    counts = np.zeros((5, size), np.int64)
    met = np.zeros(ids.shape[1], np.int32)

    def add(row: int, mask: NDArray[np.bool_], weights: NDArray[np.int32] | None = None) -> None:
        chosen = None if weights is None else weights[mask]
        found = np.bincount(ids[place][mask], chosen, minlength=size)
        counts[row] += np.rint(found).astype(np.int64)

    for place in range(len(ids)):
        here = ids[place] > 0
        if not here.any():
            break
        new = here.copy()
        # Vectorised over rays: the place-th run of all rays against each run before it.
        for earlier in range(place):
            other = here & (ids[earlier] != ids[place])
            new &= other
            if tabulate:
                blocks[slots[ids[earlier][other]], slots[ids[place][other]]] = True
        met += new
        add(0, here, samples[place])
        add(1, new)
        add(2, new & (met > 1))
        add(3, here & (ids[place] != ids[0]), samples[place])
        add(4, here & (met > 1), samples[place])
    found = np.flatnonzero(counts[0])
    table = blocks[np.ix_(slots[found], slots[found])] if tabulate else None
    return OcclusionCounts(found, counts[0], counts[1], counts[2], counts[3], counts[4], table)
