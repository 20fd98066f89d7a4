"""Bricks of 8 voxels: which objects and densities each holds, so that rays skip empty space.

An edit of the labels makes anew only the bricks that it touched.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.rays import Rays
from napari_unpack.kernels import njit
from napari_unpack.rendering.cpu.compressed_labels import CompressedLabels
from napari_unpack.rendering.cpu.ray_sampling import BRICK
from napari_unpack.rendering.cpu.thread_pool import over_bands

Density = NDArray[np.uint16] | NDArray[np.float32]


# Voxels that one thread looks over alone.
SMALL = 1 << 16


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
    _packed: list[CompressedLabels] = field(default_factory=list, init=False, repr=False)

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

        # Others take longer to start than a small object to look over.
        few = 1 if threads is None and labels.size <= SMALL else threads
        over_bands(grid[0], work, lambda: None, few, band=1)
        starts = np.concatenate([[0], np.cumsum(counts.ravel())])
        ids = np.concatenate([part for _, part in sorted(found, key=lambda pair: pair[0])])
        return cls(low, high, starts, ids)

    def occupied(
        self, table: NDArray[np.float32], domain: tuple[float, float], tints: NDArray[np.float32]
    ) -> NDArray[np.bool_]:
        """Tell which bricks, (Bz, By, Bx), may hold a sample that is not fully transparent.

        Parameters
        ----------
        table : (K, 4) ndarray of float32
            Transfer function: straight RGB and opacity per voxel.
        domain : (float, float)
            Densities of the table's first and last row.
        tints : (M, 4) ndarray of float32
            Tints by ID; alpha 0 hides.
        """
        opaque = np.concatenate([[0], np.cumsum(table[:, 3] > 0)])
        seen = np.ascontiguousarray(tints[:, 3] > 0)
        out = np.zeros(self.low.shape, np.bool_)
        lo, hi = float(domain[0]), float(domain[1])
        _occupied(self.low, self.high, self.starts, self.ids, opaque, lo, hi, seen, out)
        return out

    def packed(self, labels: NDArray[np.uint16]) -> CompressedLabels:
        """Return the labels of mixed bricks in few bits, packed from those the bricks are of."""
        if not self._packed:
            self._packed.append(CompressedLabels.of(labels, self.starts, self.ids))
        return self._packed[0]

    def inhabited(self, visible: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Tell which bricks hold a voxel of a visible object; (Bz, By, Bx) of bool."""
        return self.owners(visible) != 0

    def owners(self, visible: NDArray[np.bool_]) -> NDArray[np.int32]:
        """Tell which bricks show one object only, and which nothing, (Bz, By, Bx) int32.

        The ID of the one visible object, of (M,) bool by ID, that fills the brick; 0 where it
        shows nothing, -1 where it is mixed.
        """
        out = np.zeros(self.low.shape, np.int32)
        _owners(self.starts, self.ids, visible, out)
        return out


# The owner of bricks outside the volume, for `_stride`: it differs from no object.
OUTSIDE = -2


@dataclass(frozen=True, eq=False)
class Strides:
    """How many bricks ahead look alike, for every octant of directions that an image has.

    Parameters
    ----------
    grids : (n, Bz, By, Bx) ndarray of uint8
        Edge in bricks of the largest cube of one owner with the brick at the corner that a ray
        enters by: 0 where mixed, at most 255. The outside of the volume differs from no object.
    slots : (8,) ndarray of int64
        Which grid serves rays with signs (z, y, x), positive 1: slots[4 z + 2 y + x].
    """

    grids: NDArray[np.uint8]
    slots: NDArray[np.int64]

    @classmethod
    def none(cls) -> Strides:
        """Return what makes a kernel look at every sample."""
        return cls(np.zeros((0, 0, 0, 0), np.uint8), np.zeros(8, np.int64))

    @classmethod
    def of(cls, owners: NDArray[np.int32], rays: Rays) -> Strides:
        """Measure the bricks ahead.

        Parameters
        ----------
        owners : (Bz, By, Bx) ndarray of int32
            From `Bricks.owners`; -1 is mixed.
        rays : Rays
            Only the signs of their directions matter.

        Notes
        -----
        Parallel rays look into one octant, those of a perspective image into up to eight.
        """
        forward = ~np.signbit(rays.corner_ways())
        grids: list[NDArray[np.uint8]] = []
        made: dict[tuple[bool, ...], int] = {}
        slots = np.zeros(8, np.int64)
        for octant in range(8):
            wanted = bool(octant & 4), bool(octant & 2), bool(octant & 1)
            # Directions are affine in the pixel: an axis with one sign at the corners has no other.
            signs = tuple(
                w if own.any() and not own.all() else bool(own.all())
                for w, own in zip(wanted, forward.T, strict=True)
            )
            if signs not in made:
                made[signs] = len(grids)
                grids.append(strides(owners, signs))
            slots[octant] = made[signs]
        return cls(np.ascontiguousarray(np.stack(grids)), slots)


def strides(owners: NDArray[np.int32], forward: Sequence[bool]) -> NDArray[np.uint8]:
    """Measure the bricks ahead in one octant of directions; see `Strides.grids`.

    Parameters
    ----------
    owners : (Bz, By, Bx) ndarray of int32
        From `Bricks.owners`; -1 is mixed.
    forward : (3,) sequence of bool
        Whether z, y, x grow on the way.

    Notes
    -----
    A cube of edge d is alike if those of edge d - 1 at its seven neighbours ahead are.
    """
    flip = tuple(slice(None, None, 1 if f else -1) for f in forward)
    # One more brick ahead of all, so that the loop need not ask where the volume ends.
    inside = tuple(slice(0, n) for n in owners.shape)
    ahead = np.full([n + 1 for n in owners.shape], OUTSIDE, np.int32)
    ahead[inside] = owners[flip]
    out = np.full(ahead.shape, 254, np.uint8)
    _stride(ahead, out)
    return np.ascontiguousarray(out[inside][flip])


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _extremes(volume, z0, z1, y0, y1, least, most):  # type: ignore[no-untyped-def]
    # Rows are reduced along x for all bricks at once, in the order of memory.
    # Voxel by voxel: an assignment of arrays takes numba three seconds to compile.
    row = volume[z0, y0]
    for x in range(row.shape[0]):
        least[x] = row[x]
        most[x] = row[x]
    for z in range(z0, z1):
        for y in range(y0, y1):
            row = volume[z, y]
            for x in range(row.shape[0]):
                value = row[x]
                least[x] = value if value < least[x] else least[x]
                most[x] = value if value > most[x] else most[x]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _between(least, most, first, last):  # type: ignore[no-untyped-def]
    smallest, largest = least[first], most[first]
    for x in range(first + 1, last):
        smallest = min(smallest, least[x])
        largest = max(largest, most[x])
    return smallest, largest


@njit(cache=True, nogil=True, error_model="numpy")
def _ranges(volume, first, last, low, high):  # type: ignore[no-untyped-def]
    depth, height, width = volume.shape
    least = np.empty(width, volume.dtype)
    most = np.empty(width, volume.dtype)
    for bz in range(first, last):
        for by in range(low.shape[1]):
            # One voxel beyond the brick counts too: density is interpolated across its faces.
            z0, y0 = max(bz * BRICK - 1, 0), max(by * BRICK - 1, 0)
            _extremes(
                volume, z0, min(bz * BRICK + BRICK + 1, depth),
                y0, min(by * BRICK + BRICK + 1, height), least, most,
            )  # fmt: skip
            for bx in range(low.shape[2]):
                smallest, largest = _between(
                    least, most, max(bx * BRICK - 1, 0), min(bx * BRICK + BRICK + 1, width)
                )
                low[bz, by, bx] = smallest
                high[bz, by, bx] = largest


@njit(cache=True, nogil=True, error_model="numpy")
def _objects(labels, first, last, counts):  # type: ignore[no-untyped-def]
    depth, height, width = labels.shape
    ids = np.empty(4096, np.uint16)
    used = 0
    least = np.empty(width, labels.dtype)
    most = np.empty(width, labels.dtype)
    for bz in range(first, last):
        for by in range(counts.shape[1]):
            _extremes(
                labels, bz * BRICK, min(bz * BRICK + BRICK, depth),
                by * BRICK, min(by * BRICK + BRICK, height), least, most,
            )  # fmt: skip
            for bx in range(counts.shape[2]):
                # A brick holds as many objects as voxels at most.
                if used + BRICK**3 > ids.shape[0]:
                    larger = np.empty(2 * ids.shape[0], np.uint16)
                    for i in range(used):
                        larger[i] = ids[i]
                    ids = larger
                start = used
                # Most bricks hold one object, which the rows tell in a quarter of the time.
                smallest, largest = _between(
                    least, most, bx * BRICK, min(bx * BRICK + BRICK, width)
                )
                if smallest == largest:
                    ids[used] = smallest
                    used += 1
                    counts[bz, by, bx] = 1
                    continue
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
        # Cumulated counts: equal ends mean that no entry between them is opaque.
        if opaque[last] == opaque[first]:
            continue
        for i in range(starts[b], starts[b + 1]):
            if seen[ids[i]]:
                grid[b] = True
                break


@njit(cache=True, nogil=True, error_model="numpy")
def _owners(starts, ids, visible, out):  # type: ignore[no-untyped-def]
    grid = out.reshape(-1)
    for b in range(grid.shape[0]):
        for i in range(starts[b], starts[b + 1]):
            if visible[ids[i]]:
                # Hidden matter in it makes a brick mixed too, for it is read as another label.
                grid[b] = ids[i] if starts[b + 1] - starts[b] == 1 else -1
                break


@njit(cache=True, nogil=True, error_model="numpy")
def _stride(owners, out):  # type: ignore[no-untyped-def]
    depth, height, width = owners.shape
    for z in range(depth - 2, -1, -1):
        for y in range(height - 2, -1, -1):
            for x in range(width - 2, -1, -1):
                own = owners[z, y, x]
                if own < 0:
                    out[z, y, x] = 0
                    continue
                # Values are uint8, and 255 would overflow by the brick itself.
                least = 254
                for corner in range(1, 8):
                    a, b, c = z + (corner >> 2), y + (corner >> 1 & 1), x + (corner & 1)
                    # The cube ahead is alike if the cubes of all seven neighbours ahead are.
                    other = owners[a, b, c]
                    alike = (other == own) | (other == OUTSIDE)
                    least = min(least, int(out[a, b, c]) if alike else 0)
                out[z, y, x] = least + 1


def relabelled(
    bricks: Bricks, labels: NDArray[np.uint16], box: tuple[slice, slice, slice]
) -> Bricks:
    """Return the bricks of other labels of the same volume, whose ranges of density are shared.

    Parameters
    ----------
    bricks : Bricks
        Of the volume and the labels before.
    labels : (Z, Y, X) ndarray of uint16
        Object IDs now.
    box : (slice, slice, slice)
        Voxels outside which they are as before.
    """
    touched = tuple(slice(s.start // BRICK, -(-s.stop // BRICK)) for s in box)
    voxels = tuple(slice(s.start * BRICK, s.stop * BRICK) for s in touched)
    # Densities have not changed, so only the lists of objects are made anew.
    part = Bricks.of(np.ascontiguousarray(labels[voxels]))
    grid = bricks.low.shape
    begin = bricks.starts[:-1].reshape(grid).copy()
    counts = np.diff(bricks.starts).reshape(grid)
    begin[touched] = part.starts[:-1].reshape(part.low.shape) + len(bricks.ids)
    counts[touched] = np.diff(part.starts).reshape(part.low.shape)
    starts = np.concatenate([[0], np.cumsum(counts.ravel())])
    places = np.repeat(begin.ravel() - starts[:-1], counts.ravel()) + np.arange(starts[-1])
    ids = np.concatenate([bricks.ids, part.ids])[places]
    return Bricks(bricks.low, bricks.high, starts, ids)
