"""Questions to the ray casters: who is free along D, and who interferes in this view.

A question holds all it needs and changes nothing, so it may be answered on another thread while
the session goes on; the session decides afterwards whether the answer still fits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import Vector
from napari_unpack.geometry.occlusion_counts import OcclusionCounts
from napari_unpack.geometry.view import Camera
from napari_unpack.unpacking import BlockingGraph, ratios, unpackable_ids
from napari_unpack.unpacking.blocking_graph import blocking_graph
from napari_unpack.unpacking.occlusion import Rule

SURELY_HELD = 0.35
"""Share of an object's samples behind others above which it is held by more than corners."""

MOST_RAYS = 2048
"""Most rays along one side of the picture that decides who is free."""

MOST_KEPT = 64 * 2**20
"""Bytes of runs that are kept for the next question along the same direction."""

Mask = NDArray[np.bool_]
Table = tuple[NDArray[np.int64], Mask]
Size = tuple[int, int]
Prober = Callable[[int, tuple[slice, ...], int], frozenset[int]]


@dataclass(frozen=True)
class Casters:
    """The two passes a session needs; by default those of `rendering`.

    Parameters
    ----------
    occlusion : callable
        (camera, visible, size) -> OcclusionCounts.
    ids : callable
        (camera, visible, size, layers) -> (layers, H, W) int32.
    pull : callable, optional
        (direction, visible, pulled) -> (ids, blocks) by moving the voxels of `pulled` objects, or
        None where there are too many objects. Without it the table of the rays is all there is.
    probe : callable, optional
        (direction, visible) -> what tells, by moving one object's voxels, whom it meets: given
        the object, its box and how many are enough. Agrees with `pull`.
    """

    occlusion: Callable[[Camera, Mask, Size], OcclusionCounts]
    ids: Callable[[Camera, Mask, Size, int], NDArray[np.int32]]
    pull: Callable[[Vector, Mask, Mask], Table | None] | None = None
    probe: Callable[[Vector, Mask], Prober] | None = None


def imaging_casters(
    labels: NDArray[np.uint16],
    spacing: NDArray[np.float64],
    backend: Callable[[], str],
    clipping: Callable[[], NDArray[np.float64]],
) -> Casters:
    """Return the casters of `rendering` for a label volume.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of uint16
        Object IDs.
    spacing : (3,) ndarray of float64
        Voxel size in mm, z y x.
    backend : callable
        Returns "auto", "cpu" or "gl" when asked.
    clipping : callable
        Returns the (N, 2, 3) planes that cut the picture; they cut no occlusion.

    Returns
    -------
    Casters
    """
    kept: list[Any] = []
    met: list[Any] = []

    def bricks() -> Any:
        from napari_unpack.rendering.cpu import Bricks

        if not kept:
            kept.append(Bricks.of(labels))
        return kept[0]

    def occlusion(camera: Camera, visible: Mask, size: Size) -> OcclusionCounts:
        from napari_unpack.rendering import cast_occlusion, cast_runs
        from napari_unpack.rendering.backends import on_cpu

        if on_cpu(backend()):
            # One slot, replaced at once: questions are answered on several threads.
            known = next(iter(met), None)
            runs = cast_runs(labels, spacing, camera, visible, size, bricks=bricks(), known=known)
            met[:] = [runs] if runs.nbytes <= MOST_KEPT else []
            known_counts: OcclusionCounts = runs.counts(visible)
            return known_counts
        counts: OcclusionCounts = cast_occlusion(
            labels, spacing, camera, visible, size, bricks=bricks(), backend=backend()
        )
        return counts

    def ids(camera: Camera, visible: Mask, size: Size, layers: int) -> NDArray[np.int32]:
        from napari_unpack.rendering import cast_ids

        return cast_ids(
            labels, spacing, camera, visible, size, layers,
            bricks=bricks(), clipping=clipping(), backend=backend(),
        )  # fmt: skip

    def pull(direction: Vector, visible: Mask, pulled: Mask) -> Table | None:
        from napari_unpack.rendering.cpu.sweep import sweep_blockers

        return sweep_blockers(labels, spacing, direction, visible, bricks(), pulled)

    def probe(direction: Vector, visible: Mask) -> Prober:
        from napari_unpack.rendering.cpu.sweep import SweepTest

        return SweepTest.of(labels, spacing, direction, visible, bricks()).blockers

    return Casters(occlusion, ids, pull, probe)


@dataclass(frozen=True, eq=False)
class OcclusionAnswer:
    """Who is free along D among the objects that were in the bag.

    Parameters
    ----------
    direction : (3,) ndarray of float64
        D, unit vector in world.
    packed : frozenset of int
        Objects that were in the bag.
    free : frozenset of int
        Those that nothing blocked. What no ray meets counts as free: nothing is known to be in
        front of it.
    blocking : BlockingGraph, optional
        Who blocks whom; None where there is no table.
    first_hit : mapping of int to float
        The paper's ratio, by which objects are ranked when nobody is free.
    seconds : float
        What the question took.
    criterion : (str, float)
        The rule and the tolerance it was asked with.
    edition : int
        Of the labels it was asked about.
    """

    direction: Vector
    packed: frozenset[int]
    free: frozenset[int]
    blocking: BlockingGraph | None
    first_hit: Mapping[int, float]
    seconds: float
    criterion: tuple[str, float] = ("exact", 0.0)
    edition: int = 0

    def serves(self, direction: Vector, packed: frozenset[int]) -> bool:
        """Tell whether it holds for this D and these objects, or more than these."""
        return bool(np.allclose(self.direction, direction, rtol=0, atol=1e-6)) and (
            packed <= self.packed
        )

    def groups(self, packed: frozenset[int], most: int) -> list[tuple[int, ...]]:
        """Return what can leave: single objects, and groups of at most `most` that hold together.

        A larger knot is as good as nobody: half a bag flying out at once shows nothing.
        """
        if self.blocking is None:
            return [(i,) for i in sorted(self.free & packed)]
        free = self.blocking.among(packed).unpackable_groups()
        return [group for group in free if len(group) <= most]

    def least_occluded(self, packed: frozenset[int]) -> int:
        """Return the packed object with the least ratio, ties by ID."""
        return min(packed, key=lambda i: (self.first_hit.get(i, 0.0), i))


@dataclass(frozen=True, eq=False)
class OcclusionQuestion:
    """The question who is free along D.

    Parameters
    ----------
    direction : (3,) ndarray of float64
        D, unit vector in world.
    packed : frozenset of int
        Objects in the bag.
    rule, tolerance
        See `unpacking.unpackable_ids`.
    cast : callable
        Returns the counts.
    pull : callable, optional
        Given which objects (by ID) to move, returns who is met by whom when their voxels are;
        asked for the rule "exact" only.
    edition : int
        Of the labels.
    """

    direction: Vector
    packed: frozenset[int]
    rule: Rule
    tolerance: float
    cast: Callable[[], OcclusionCounts]
    pull: Callable[[Mask], Table | None] | None = None
    edition: int = 0

    def answer(self) -> OcclusionAnswer:
        """Cast the rays and work out the answer; may run on any thread.

        Notes
        -----
        Rays rank the objects and tell who is free within the tolerance. Who blocks whom is what
        the voxels themselves meet on their way, where that can be had: off the axes rays find
        things that merely touch to be held by the corners of each other's voxels. What is held
        by more than a few corners need not be moved: there the rays' table serves.
        """
        start = perf_counter()
        counts = self.cast()
        met = {int(i) for i in counts.ids}
        free = frozenset(unpackable_ids(counts, self.rule, self.tolerance)) | (self.packed - met)
        table = self._table(counts)
        if table is None:
            blocking = BlockingGraph.of(counts, self.rule, self.tolerance)
        else:
            ids, blocks = table
            exempt = free if self.tolerance > 0 else frozenset()
            blocking = BlockingGraph(blocking_graph(blocks, ids, exempt))
            free = frozenset(i for i, before in blocking.graph.in_degree() if not before)
        if blocking is not None:
            blocking.graph.add_nodes_from(self.packed - met)
        return OcclusionAnswer(
            self.direction,
            self.packed,
            free,
            blocking,
            ratios(counts),
            perf_counter() - start,
            (self.rule, self.tolerance),
            self.edition,
        )

    def _table(self, counts: OcclusionCounts) -> Table | None:
        """Return who blocks whom among the packed, by voxels where rays leave it open."""
        if self.pull is None or self.rule != "exact" or counts.blocks is None:
            return None
        held = counts.exact_samples > SURELY_HELD * counts.samples
        table = self.pull(~held)
        if table is None:
            return None
        ids, blocks = table
        # Every ID that a ray meets is among those pulled or held.
        places = np.searchsorted(ids, counts.ids)
        columns = held[counts.ids]
        blocks[np.ix_(places, places[columns])] = counts.blocks[:, columns]
        return ids, blocks


def view_along(
    direction: Vector,
    lower: NDArray[np.float64],
    upper: NDArray[np.float64],
    pitch: float,
    camera: Camera,
) -> tuple[Camera, tuple[int, int]]:
    """Return the orthographic camera and size of the picture that decides who is free along D.

    Parameters
    ----------
    direction : (3,) ndarray of float64
        D; the camera looks along -D.
    lower, upper : (3,) ndarray of float64
        The bag's box, world mm.
    pitch : float
        Distance of rays, mm: the voxel pitch, so that nothing thin slips between them.
    camera : Camera
        The user's, whose up is kept where D is towards the viewer.

    Returns
    -------
    camera : Camera
        Just holding the box.
    size : (int, int)
        Rays, height and width.

    Notes
    -----
    Across an axis whose voxels are one pitch long, rays go through the voxels' middles: on
    their faces rounding would pass over one row and look at its neighbour twice.
    """
    from napari_unpack.geometry.boxes import box_corners

    same = float(direction @ -camera.direction) > 1 - 1e-12
    center = (lower + upper) / 2
    looking = Camera.looking(-direction, camera.up if same else None, center, 1.0)
    flat = (box_corners(lower, upper) - center) @ looking.rotation[1:].T
    extent = np.ptp(flat, axis=0)
    pitch = max(pitch, float(extent.max()) / MOST_RAYS)
    # A whole number of rays, give or take a rounding error, is centred on the voxels.
    rows, columns = (int(n) for n in np.maximum(np.ceil(extent / pitch - 1e-6), 1))
    return Camera(looking.rotation, center, rows * pitch), (rows, columns)
