"""Directional skipping: how far the bricks ahead of a brick are uniform, along one image's rays.

Rays of one image look nearly the same way, so what lies ahead of a brick is a narrow path of
bricks and no cube. It is narrower, and so it is longer until another object comes in.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.rays import Rays
from napari_unpack.kernels import njit
from napari_unpack.rendering.cpu.bricks import Strides
from napari_unpack.rendering.cpu.thread_pool import over_bands

# Layers of bricks that a path of bricks is followed.
LONGEST = 96
# Bricks sideways a brick ahead, above which cubes serve as well.
STEEPEST = 1.5
# Bricks that rounding may put a sample aside.
SLACK = 1e-9


@dataclass(frozen=True, eq=False)
class DirectionalSkipping:
    """Where rays may leap to: over layers of bricks along their leading axis, or over cubes.

    Parameters
    ----------
    grids : (n, Bz, By, Bx) ndarray of uint8
        0 where the brick is mixed, else 1 and as many layers of bricks along `axis`, the brick's
        own first, in which every ray that has been in the brick stays with its owner. Where
        `axis` is -1, `Strides.grids`.
    slots : (8,) ndarray of int64
        Which grid serves which octant, as in `Strides`.
    axis : int
        The axis along which all rays run fastest; -1 if they have none in common.
    """

    grids: NDArray[np.uint8]
    slots: NDArray[np.int64]
    axis: int

    @classmethod
    def none(cls) -> DirectionalSkipping:
        """Return what makes a kernel look at every sample."""
        strides = Strides.none()
        return cls(strides.grids, strides.slots, -1)

    @classmethod
    def of(cls, owners: NDArray[np.int32], rays: Rays) -> DirectionalSkipping:
        """Measure what lies ahead of every brick.

        Parameters
        ----------
        owners : (Bz, By, Bx) ndarray of int32
            From `Bricks.owners`; -1 is mixed.
        rays : Rays
            Of the image; parallel ones have the longest paths of bricks ahead.
        """
        ways = rays.corner_ways()
        axis = int(np.argmax(np.abs(ways).min(axis=0)))
        forward = ways[:, axis] > 0
        if (ways[:, axis] == 0).any() or forward.any() != forward.all():
            return cls._cubes(owners, rays)
        # Ratios of affine functions of the pixel are largest and smallest at its corners.
        slopes = np.delete(ways, axis, axis=1) / np.abs(ways[:, axis, None])
        if np.abs(slopes).max() > STEEPEST:
            return cls._cubes(owners, rays)
        sign = 1 if forward[0] else -1
        ahead = np.ascontiguousarray(np.moveaxis(owners, axis, 0)[::sign])
        out = np.zeros(ahead.shape, np.uint8)
        spread = _spread(slopes)

        def work(_: None, first: int, last: int) -> None:
            _follow(ahead, spread, first, last, out)

        over_bands(len(ahead), work, lambda: None)
        grid = np.ascontiguousarray(np.moveaxis(out[::sign], 0, axis))
        return cls(grid[None], np.zeros(8, np.int64), axis)

    @classmethod
    def _cubes(cls, owners: NDArray[np.int32], rays: Rays) -> DirectionalSkipping:
        strides = Strides.of(owners, rays)
        return cls(strides.grids, strides.slots, -1)


def _spread(slopes: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return (layers, 2 axes, 2) bricks sideways, first and last, that rays may be in.

    A ray somewhere in a brick has gone between m - 1 and m + 1 bricks ahead while it is in the
    m-th layer after it, and aside by that times its slope, from a start within one brick.
    """
    layers = np.arange(LONGEST)
    gone = np.stack([np.maximum(layers - 1, 0), layers + 1])[:, :, None]
    least = (gone * slopes.min(axis=0)).min(axis=0)
    most = (gone * slopes.max(axis=0)).max(axis=0)
    # A ray that does not turn back is not put back by rounding either.
    first = np.where(least == 0, 0, np.floor(least - SLACK))
    last = np.where(most == 0, 0, np.ceil(most + SLACK))
    return np.ascontiguousarray(np.stack([first, last], axis=2).astype(np.int64))


@njit(cache=True, nogil=True, error_model="numpy")
def _follow(owners, spread, first, last, out):  # type: ignore[no-untyped-def]
    depth, height, width = owners.shape
    for z in range(first, last):
        for y in range(height):
            for x in range(width):
                own = owners[z, y, x]
                # A mixed brick cannot be skipped.
                if own < 0:
                    continue
                layers = 0
                while layers < spread.shape[0]:
                    # Nothing lies beyond the volume, so the path ahead is uniform to its end.
                    if z + layers >= depth:
                        layers = spread.shape[0]
                        break
                    alike = True
                    low, high = y + spread[layers, 0, 0], y + spread[layers, 0, 1]
                    left, right = x + spread[layers, 1, 0], x + spread[layers, 1, 1]
                    for b in range(max(low, 0), min(high + 1, height)):
                        for c in range(max(left, 0), min(right + 1, width)):
                            alike = alike and owners[z + layers, b, c] == own
                    if not alike:
                        break
                    layers += 1
                out[z, y, x] = 1 + layers
