"""A coarse view of a volume, in bricks of 8 voxels, that tells rays where nothing can be seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from napari_unpack.raycasting.lattice import BRICK
from napari_unpack.raycasting.threads import over_bands

Density = NDArray[np.uint16] | NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Bricks:
    """Density range and objects of every brick; made once a volume, asked at every change.

    A sample belongs to the brick of its nearest voxel.

    Parameters
    ----------
    low, high : (Bz, By, Bx) ndarray of uint16 or float32
        Smallest and largest density of the brick and the voxel layer around it, which together
        are all that interpolation at its samples can read.
    starts : (Bz * By * Bx + 1,) ndarray of int64
        Where each brick's objects begin in `ids`.
    ids : (K,) ndarray of uint16
        The labels present in each brick, 0 among them.
    """

    low: Density
    high: Density
    starts: NDArray[np.int64]
    ids: NDArray[np.uint16]

    @classmethod
    def of(
        cls, labels: NDArray[np.uint16], volume: Density | None = None, threads: int | None = None
    ) -> Bricks:
        """Look over a volume once.

        Parameters
        ----------
        labels : (Z, Y, X) ndarray of uint16
            Object IDs, C-contiguous.
        volume : (Z, Y, X) ndarray of uint16 or float32, optional
            Density, C-contiguous. Without it only the ID passes can use the bricks.
        threads : int, optional
            Workers, by default one a core.

        Returns
        -------
        Bricks
        """
        grid = tuple(-(-n // BRICK) for n in labels.shape)
        density = labels if volume is None else volume
        low = np.zeros(grid, density.dtype)
        high = np.zeros(grid, density.dtype)
        counts = np.zeros(grid, np.int64)
        found: list[tuple[int, NDArray[np.uint16]]] = []

        def work(_: None, first: int, last: int) -> None:
            if volume is not None:
                _ranges(volume, first, last, low, high)
            found.append((first, _objects(labels, first, last, counts)))

        over_bands(grid[0], work, lambda: None, threads, band=1)
        starts = np.concatenate([[0], np.cumsum(counts.ravel())])
        ids = np.concatenate([part for _, part in sorted(found, key=lambda pair: pair[0])])
        return cls(low, high, starts, ids)

    def occupied(
        self,
        table: NDArray[np.float32],
        domain: tuple[float, float],
        tints: NDArray[np.float32],
    ) -> NDArray[np.bool_]:
        """Tell which bricks may hold a sample that is not fully transparent.

        Parameters
        ----------
        table : (K, 4) ndarray of float32
            Transfer function: straight RGB and opacity per voxel.
        domain : (float, float)
            Densities of the table's first and last row.
        tints : (M, 4) ndarray of float32
            Tints by ID; alpha 0 hides.

        Returns
        -------
        (Bz, By, Bx) ndarray of bool
        """
        opaque = np.concatenate([[0], np.cumsum(table[:, 3] > 0)])
        seen = np.ascontiguousarray(tints[:, 3] > 0)
        out = np.zeros(self.low.shape, np.bool_)
        lo, hi = float(domain[0]), float(domain[1])
        _occupied(self.low, self.high, self.starts, self.ids, opaque, lo, hi, seen, out)
        return out

    def inhabited(self, visible: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Tell which bricks hold a voxel of a visible object; (Bz, By, Bx) of bool."""
        out = np.zeros(self.low.shape, np.bool_)
        _inhabited(self.starts, self.ids, visible, out)
        return out

    def owners(self, visible: NDArray[np.bool_]) -> NDArray[np.int32]:
        """Tell which bricks show one object only, and which nothing.

        Parameters
        ----------
        visible : (M,) ndarray of bool
            By ID; the background is not visible.

        Returns
        -------
        (Bz, By, Bx) ndarray of int32
            The ID of the one visible object that fills the brick, 0 where the brick shows
            nothing, -1 where it is mixed.
        """
        out = np.zeros(self.low.shape, np.int32)
        _owners(self.starts, self.ids, visible, out)
        return out


def strides(owners: NDArray[np.int32]) -> NDArray[np.uint8]:
    """Measure the distance from every brick to the nearest one that differs.

    Parameters
    ----------
    owners : (Bz, By, Bx) ndarray of int32
        From `Bricks.owners`; -1 is mixed.

    Returns
    -------
    (Bz, By, Bx) ndarray of uint8
        Chebyshev distance in bricks to another owner: 0 where mixed, at most 255. The outside
        of the volume differs from nobody.
    """
    outside = -2
    around = np.pad(owners, 1, constant_values=outside)
    out = np.full(around.shape, 255, np.uint8)
    out[around == -1] = 0
    _stride(around, outside, out)
    return np.ascontiguousarray(out[1:-1, 1:-1, 1:-1])


@njit(cache=True, nogil=True, error_model="numpy")
def _ranges(volume, first, last, low, high):  # type: ignore[no-untyped-def]
    depth, height, width = volume.shape
    least = np.empty(width, volume.dtype)
    most = np.empty(width, volume.dtype)
    for bz in range(first, last):
        for by in range(low.shape[1]):
            z0, y0 = max(bz * BRICK - 1, 0), max(by * BRICK - 1, 0)
            least[:] = volume[z0, y0]
            most[:] = volume[z0, y0]
            for z in range(z0, min(bz * BRICK + BRICK + 1, depth)):
                for y in range(y0, min(by * BRICK + BRICK + 1, height)):
                    row = volume[z, y]
                    for x in range(width):
                        value = row[x]
                        least[x] = value if value < least[x] else least[x]
                        most[x] = value if value > most[x] else most[x]
            for bx in range(low.shape[2]):
                x0 = max(bx * BRICK - 1, 0)
                smallest, largest = least[x0], most[x0]
                for x in range(x0 + 1, min(bx * BRICK + BRICK + 1, width)):
                    smallest = min(smallest, least[x])
                    largest = max(largest, most[x])
                low[bz, by, bx] = smallest
                high[bz, by, bx] = largest


@njit(cache=True, nogil=True, error_model="numpy")
def _objects(labels, first, last, counts):  # type: ignore[no-untyped-def]
    depth, height, width = labels.shape
    ids = np.empty(4096, np.uint16)
    used = 0
    for bz in range(first, last):
        for by in range(counts.shape[1]):
            for bx in range(counts.shape[2]):
                if used + BRICK**3 > ids.shape[0]:
                    larger = np.empty(2 * ids.shape[0], np.uint16)
                    larger[:used] = ids[:used]
                    ids = larger
                start = used
                previous = np.int64(-1)
                for z in range(bz * BRICK, min(bz * BRICK + BRICK, depth)):
                    for y in range(by * BRICK, min(by * BRICK + BRICK, height)):
                        for x in range(bx * BRICK, min(bx * BRICK + BRICK, width)):
                            label = np.int64(labels[z, y, x])
                            if label == previous:
                                continue
                            previous = label
                            known = False
                            for i in range(start, used):
                                if ids[i] == label:
                                    known = True
                                    break
                            if not known:
                                ids[used] = label
                                used += 1
                counts[bz, by, bx] = used - start
    return ids[:used].copy()


@njit(cache=True, nogil=True, error_model="numpy")
def _occupied(low, high, starts, ids, opaque, lo, hi, seen, out):  # type: ignore[no-untyped-def]
    entries = opaque.shape[0] - 1
    scale = (entries - 1) / (hi - lo)
    grid = out.reshape(-1)
    least, most = low.reshape(-1), high.reshape(-1)
    for b in range(grid.shape[0]):
        a = min(max((float(least[b]) - lo) * scale, 0.0), entries - 1.0)
        z = min(max((float(most[b]) - lo) * scale, 0.0), entries - 1.0)
        # One entry of slack on both sides: the kernels look up in float32.
        first = max(int(a) - 1, 0)
        last = min(int(z) + 3, entries)
        if opaque[last] == opaque[first]:
            continue
        for i in range(starts[b], starts[b + 1]):
            if seen[ids[i]]:
                grid[b] = True
                break


@njit(cache=True, nogil=True, error_model="numpy")
def _inhabited(starts, ids, visible, out):  # type: ignore[no-untyped-def]
    grid = out.reshape(-1)
    for b in range(grid.shape[0]):
        for i in range(starts[b], starts[b + 1]):
            if visible[ids[i]]:
                grid[b] = True
                break


@njit(cache=True, nogil=True, error_model="numpy")
def _owners(starts, ids, visible, out):  # type: ignore[no-untyped-def]
    grid = out.reshape(-1)
    for b in range(grid.shape[0]):
        for i in range(starts[b], starts[b + 1]):
            if visible[ids[i]]:
                grid[b] = ids[i] if starts[b + 1] - starts[b] == 1 else -1
                break


@njit(cache=True, nogil=True, error_model="numpy")
def _near(owners, outside, out, own, best, z, y, x):  # type: ignore[no-untyped-def]
    other = owners[z, y, x]
    if other == outside:
        return best
    return min(best, int(out[z, y, x]) + 1 if other == own else 1)


@njit(cache=True, nogil=True, error_model="numpy")
def _stride(owners, outside, out):  # type: ignore[no-untyped-def]
    # Rosenfeld & Pfaltz's two sweeps, exact for the chessboard distance, for all owners at once:
    # another's brick is at distance 0.
    depth, height, width = out.shape
    for sign in (1, -1):
        for m in range(1, depth - 1):
            z = m if sign > 0 else depth - 1 - m
            for n in range(1, height - 1):
                y = n if sign > 0 else height - 1 - n
                for o in range(1, width - 1):
                    x = o if sign > 0 else width - 1 - o
                    own = owners[z, y, x]
                    best = int(out[z, y, x])
                    if best == 0:
                        continue
                    best = _near(owners, outside, out, own, best, z, y, x - sign)
                    for j in range(-1, 2):
                        best = _near(owners, outside, out, own, best, z, y - sign, x + j)
                        for i in range(-1, 2):
                            best = _near(owners, outside, out, own, best, z - sign, y + i, x + j)
                    out[z, y, x] = min(best, 255)
