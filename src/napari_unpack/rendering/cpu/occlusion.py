"""Who hides whom along a direction: every counter of every occlusion ratio in one pass."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.occlusion_counts import OcclusionCounts
from napari_unpack.geometry.rays import Rays
from napari_unpack.rendering.cpu.bricks import Bricks
from napari_unpack.rendering.cpu.label_runs import Counters, RunCounter, Runs, Scratch, Tracing
from napari_unpack.rendering.cpu.ray_sampling import band_of
from napari_unpack.rendering.cpu.thread_pool import over_bands


def occlusion_counts(
    labels: NDArray[np.uint16],
    rays: Rays,
    visible: NDArray[np.bool_],
    bricks: Bricks | None = None,
    threads: int | None = None,
) -> OcclusionCounts:
    """Count how much of every object is hidden by others.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of uint16
        Object IDs, C-contiguous.
    rays : Rays
        Orthographic, looking along -D; at the voxel pitch or finer to decide what is unpackable.
    visible : (M,) ndarray of bool
        By ID, M above every label; `visible[0]` False. Hidden objects are as air.
    bricks : Bricks, optional
        Of these labels; saves visiting what is uniform, changes nothing.
    threads : int, optional
        Workers, by default one a core.

    Notes
    -----
    Li et al. 2012, section 5.1, eq. 2 and both listings, plus `exact` (docs/paper.md, R1).
    All denominators are exact. The paper bounds each object's pass by its box; here all objects
    share one pass over the whole lattice.
    """
    tracing, counter = Tracing.of(labels, rays, visible, bricks), RunCounter.of(visible)

    def state() -> tuple[Counters, Scratch]:
        return counter.counters(), tracing.scratch()

    def work(own: tuple[Counters, Scratch], first: int, last: int) -> None:
        counters, scratch = own
        for runs in tracing.runs(first, last, scratch):
            counter.add(runs, counters)

    parts = over_bands(rays.size[0], work, state, threads, band_of(rays.size[0]))
    return counter.sum([counters for counters, _ in parts])


def occlusion_runs(
    labels: NDArray[np.uint16], rays: Rays, visible: NDArray[np.bool_], bricks: Bricks | None = None
) -> Runs:
    """List what every ray meets, to be counted now and when some have left.

    Parameters
    ----------
    labels, rays, visible, bricks
        As for `occlusion_counts`.

    Returns
    -------
    Runs
        About 10 bytes a ray that meets something.
    """
    tracing = Tracing.of(labels, rays, visible, bricks)
    found: list[NDArray[np.uint32]] = []

    def work(scratch: Scratch, first: int, last: int) -> None:
        found.extend(runs.copy() for runs in tracing.runs(first, last, scratch))

    over_bands(rays.size[0], work, tracing.scratch, band=band_of(rays.size[0]))
    return Runs(tuple(found), rays, visible.copy())
