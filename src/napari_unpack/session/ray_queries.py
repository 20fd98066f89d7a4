"""What a session asks of its labels by casting rays and by moving voxels."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import Vector
from napari_unpack.geometry.occlusion_counts import OcclusionCounts
from napari_unpack.geometry.view import Camera

if TYPE_CHECKING:
    from napari_unpack.rendering.cpu import Bricks
    from napari_unpack.rendering.cpu.label_runs import Runs

# Runs are kept for the next question along the same direction; those of the largest pictures
# would take more memory than a second cast is worth.
MOST_KEPT_BYTES = 64 * 2**20

Mask = NDArray[np.bool_]
BlockingTable = tuple[NDArray[np.int64], Mask]
"""(ids, blocks): row blocks column."""

Size = tuple[int, int]
Blockers = Callable[[int, tuple[slice, ...], int], frozenset[int]]
"""Given an object, its box and how many are enough, returns what it meets on its way out."""


class RayQueries(Protocol):
    """What a session asks of one label volume; safe to call from several threads.

    Attributes
    ----------
    can_sweep : bool
        Whether voxels can be moved (`sweep_table`, `sweep_test`); else rays are all there is.
    """

    @property
    def can_sweep(self) -> bool:
        """Whether voxels can be moved."""

    def occlusion_counts(
        self, camera: Camera, visible: Mask, size: Size, backend: str
    ) -> OcclusionCounts:
        """Count what is in front of what.

        Parameters
        ----------
        camera : Camera
            Orthographic, looking along -D.
        visible : (M,) ndarray of bool
            By ID; False is air.
        size : (int, int)
            Rays, height and width.
        backend : {"auto", "cpu", "gl"}
        """

    def object_ids(
        self,
        camera: Camera,
        visible: Mask,
        size: Size,
        layers: int,
        clipping: NDArray[np.float64],
        backend: str,
    ) -> NDArray[np.int32]:
        """Return (layers, H, W) IDs that rays meet.

        Parameters
        ----------
        camera : Camera
        visible : (M,) ndarray of bool
            By ID; False is air.
        size : (int, int)
            Rays, height and width.
        layers : int
        clipping : (N, 2, 3) ndarray of float64
            Planes that cut the picture, voxels.
        backend : {"auto", "cpu", "gl"}
        """

    def sweep_table(self, direction: Vector, visible: Mask, moved: Mask) -> BlockingTable | None:
        """Return what blocks what by moving voxels; None where there are too many objects.

        Parameters
        ----------
        direction : (3,) ndarray of float64
            D, unit vector in world.
        visible : (M,) ndarray of bool
            By ID, what is in the bag.
        moved : (M,) ndarray of bool
            By ID, what to move.
        """

    def sweep_test(self, direction: Vector, visible: Mask) -> Blockers:
        """Return what tells whom one object meets; agrees with `sweep_table`.

        Parameters
        ----------
        direction : (3,) ndarray of float64
            D, unit vector in world.
        visible : (M,) ndarray of bool
            By ID, what is in the bag.
        """


class RenderingQueries:
    """Ray queries by `rendering`.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of uint16
        Object IDs; never written to.
    spacing : (3,) ndarray of float64
        Voxel size in mm, z y x.
    """

    can_sweep = True

    def __init__(self, labels: NDArray[np.uint16], spacing: NDArray[np.float64]) -> None:
        self._labels, self._spacing = labels, spacing
        self._runs: list[Runs] = []

    @cached_property
    def _bricks(self) -> Bricks:
        from napari_unpack.rendering.cpu import Bricks

        return Bricks.of(self._labels)

    def occlusion_counts(
        self, camera: Camera, visible: Mask, size: Size, backend: str
    ) -> OcclusionCounts:
        """Count what is in front of what; see `RayQueries`.

        Parameters
        ----------
        camera, visible, size, backend
            As for `RayQueries.occlusion_counts`.
        """
        from napari_unpack.rendering import cast_occlusion, cast_runs
        from napari_unpack.rendering.backends import on_cpu

        labels, mm = self._labels, self._spacing
        if not on_cpu(backend):
            return cast_occlusion(
                labels, mm, camera, visible, size, bricks=self._bricks, backend=backend
            )
        # One slot, replaced at once: tasks run on several threads.
        known = next(iter(self._runs), None)
        runs = cast_runs(labels, mm, camera, visible, size, bricks=self._bricks, known=known)
        self._runs[:] = [runs] if runs.nbytes <= MOST_KEPT_BYTES else []
        return runs.counts(visible)

    def object_ids(
        self,
        camera: Camera,
        visible: Mask,
        size: Size,
        layers: int,
        clipping: NDArray[np.float64],
        backend: str,
    ) -> NDArray[np.int32]:
        """Return (layers, H, W) IDs that rays meet.

        Parameters
        ----------
        camera, visible, size, layers, clipping, backend
            As for `RayQueries.object_ids`.
        """
        from napari_unpack.rendering import cast_ids

        return cast_ids(
            self._labels, self._spacing, camera, visible, size, layers,
            bricks=self._bricks, clipping=clipping, backend=backend,
        )  # fmt: skip

    def sweep_table(self, direction: Vector, visible: Mask, moved: Mask) -> BlockingTable | None:
        """Return what blocks what by moving voxels.

        Parameters
        ----------
        direction, visible, moved
            As for `RayQueries.sweep_table`.
        """
        from napari_unpack.rendering.cpu.sweep import sweep_blockers

        return sweep_blockers(self._labels, self._spacing, direction, visible, self._bricks, moved)

    def sweep_test(self, direction: Vector, visible: Mask) -> Blockers:
        """Return what tells whom one object meets.

        Parameters
        ----------
        direction, visible
            As for `RayQueries.sweep_test`.
        """
        from napari_unpack.rendering.cpu.sweep import SweepTest

        return SweepTest.of(self._labels, self._spacing, direction, visible, self._bricks).blockers
