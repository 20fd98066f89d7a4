"""Label upsampling, from the working grid to full resolution: densities move the borders.

Labels of the grid are right but for the cells at their borders. There every voxel chooses among
the labels of the 27 cells around it: by how well its density suits that label's density here,
which moves the border to density steps and puts it against air at half height, and by how much
of its surroundings the label has on the grid (quadratic B-splines), which decides where densities
say nothing. The choice of a voxel depends on its surroundings alone, so that the result is the
same for all sizes of blocks. Things too thin to show on the grid, such as cables and needles, are
found among the foreground that it does not explain (`named_things`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.kernels import njit
from napari_unpack.segmentation.common.array_source import Box, Source, grown, within
from napari_unpack.segmentation.common.mask_components import mask_components
from napari_unpack.segmentation.foreground.thresholds import Levels
from napari_unpack.segmentation.working_grid import Factors
from napari_unpack.tasks import SILENT, Share

# Standard deviation of a label's density here, as a share of the contrast around a voxel.
MISFIT_DEVIATION = 0.1


@dataclass(frozen=True, eq=False)
class GridLabels:
    """What the working grid says, framed by one more cell on every side.

    Parameters
    ----------
    labels : (z + 2, y + 2, x + 2) ndarray of int32
        Objects; 0 air; the largest value, `left_out`, is foreground that is no object.
    density : (z + 2, y + 2, x + 2) ndarray of float32
        Density above air, in units of `unit`.
    factors : (int, int, int)
        Voxels to a cell, z y x.
    left_out : int
        Label of tables, shells and specks: they keep their voxels, which are 0 in the result.
    levels : Levels
        Where the foreground begins at full resolution.
    unit : float
        Density, so that numbers of any scale fit float32.
    start : (int, int, int)
        First cell, where this is a part of the grid.
    """

    labels: NDArray[np.int32]
    density: NDArray[np.float32]
    factors: Factors
    left_out: int
    levels: Levels
    unit: float
    start: Factors = (0, 0, 0)

    def around(self, cells: Box) -> GridLabels:
        """Return what labels of a block depend on: its cells and three beyond them."""
        # A voxel beyond the block has a cell beyond it, that has neighbours, and these theirs.
        a, b, c = (max(s.start - 3, 0) for s in cells)
        # Framed by one cell, which within the volume is the next.
        ends = (s.stop + 5 for s in cells)
        part = tuple(slice(first, end) for first, end in zip((a, b, c), ends, strict=True))
        return replace(self, labels=self.labels[part], density=self.density[part], start=(a, b, c))


def grid_labels(
    labels: NDArray[np.int32],
    density: NDArray[np.floating[Any]],
    left_out: NDArray[np.bool_],
    factors: Factors,
    levels: Levels,
) -> GridLabels:
    """Make the working grid's labels ready for upsampling.

    Parameters
    ----------
    labels : (z, y, x) ndarray of int32
        Objects on the grid, 0 elsewhere.
    density : (z, y, x) ndarray
        Mean densities of the cells.
    left_out : (z, y, x) ndarray of bool
        Foreground cells that are deliberately no object.
    factors : (int, int, int)
        Voxels to a cell.
    levels : Levels
        Where the foreground begins at full resolution.
    """
    name = int(labels.max()) + 1
    # In float64 volumes densities may be of any size; kernels work in float32.
    unit = max(levels.high - levels.air, 1e-30)
    # The edge repeated, so that cells at the rim have neighbours of their own kind.
    framed = np.pad(np.where(left_out & (labels == 0), np.int32(name), labels), 1, mode="edge")
    return GridLabels(
        framed,
        np.pad(lifted(density, levels.air, unit), 1, mode="edge"),
        factors,
        name,
        levels,
        unit,
    )


def lifted(density: NDArray[Any], air: float, unit: float) -> NDArray[np.float32]:
    """Return densities above air in some unit, 0 where none was measured.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
    air, unit : float
        Density.
    """
    result = np.empty(density.shape, np.float32)
    _lift(density.reshape(-1), np.float64(air), 1.0 / unit, result.reshape(-1))
    return result


def refined(
    source: Source, grid: GridLabels, box: Box, cells: Box, share: Share = SILENT
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Label one block at full resolution.

    Parameters
    ----------
    source : Source
    grid : GridLabels
        The working grid.
    box, cells : tuple of slice
        The block in the volume and on the grid, see `array_source.blocks`.
    share : Share

    Returns
    -------
    labels : (a, b, c) ndarray of int32
        Objects in the block.
    unexplained : (i, j, k) ndarray of int32
        Foreground voxels in every cell that lies in air on the grid: things that are too thin to
        show there. 0 where there are fewer than two at the upper level.
    """
    # One voxel beyond for the neighbours' labels, another for the neighbours' densities.
    outer = grown(box, 1, source.shape)
    wide = grown(outer, 1, source.shape)
    levels = grid.levels
    values = lifted(source.read(wide), levels.air, grid.unit)
    share(0.1)
    place = within(outer, wide)
    labels = np.zeros(tuple(s.stop - s.start for s in outer), np.int32)
    unexplained = np.zeros(tuple(s.stop - s.start for s in cells), np.int32)
    origin = np.array(grid.start) * np.array(grid.factors)
    given = (
        values,
        np.array([s.start for s in place]),
        np.array([s.start for s in outer]) - origin,
        grid.labels,
        grid.density,
        np.array(grid.factors),
        np.array([s.start for s in cells]) - np.array(grid.start),
        np.float32((levels.low - levels.air) / grid.unit),
        np.float32((levels.high - levels.air) / grid.unit),
        # The mean of a voxel, counted twice, and its six neighbours keeps 0.4 of white noise.
        np.float32((0.4 * levels.noise / grid.unit) ** 2),
        np.float32(MISFIT_DEVIATION**2),
    )
    # Layers of cells that begin or end within the block.
    depth = grid.factors[0]
    first = int(outer[0].start - origin[0]) // depth
    last = int(outer[0].stop - 1 - origin[0]) // depth + 1
    for a, b in share.part(0.1, 0.9).slabs((last - first, depth, *labels.shape[1:])):
        _choose(*given, (first + a, first + b), labels, unexplained)
    inner = within(box, outer)
    clean = np.empty(tuple(s.stop - s.start for s in box), np.int32)
    start = np.array([s.start for s in inner])
    for slab in share.part(0.9, 1.0).slabs(clean.shape):
        _drop_single(labels, start, slab, clean)
    # Only now: at borders it had to hold its own against the objects.
    clean[clean == grid.left_out] = 0
    return clean, unexplained


@njit(cache=True, nogil=True)
def _lift(density, air, scale, result):  # type: ignore[no-untyped-def]
    """Write densities above air, NaN and -inf as 0."""
    for k in range(len(density)):
        value = (np.float64(density[k]) - air) * scale
        result[k] = min(value, 1e30) if value == value and value > -1e30 else 0.0


@njit(cache=True, nogil=True, fastmath={"contract", "arcp", "nsz"})
def _choose(  # type: ignore[no-untyped-def]
    values, place, first, coarse, density, factors, cells, low, high, noise, tolerance, layers,
    labels, unexplained,
):  # fmt: skip
    """Choose the labels in some layers of cells; see `refined` for what the arguments are."""
    fz, fy, fx = factors[0], factors[1], factors[2]
    spline_z, spline_y, spline_x = _splines(fz), _splines(fy), _splines(fx)
    depth, height, width = labels.shape
    names = np.zeros(27, np.int32)
    means = np.zeros(27, np.float32)
    weights = np.zeros(27, np.float32)
    shares = np.zeros(27, np.float32)
    who = np.zeros(27, np.int64)
    for k in range(layers[0], layers[1]):
        for j in range(first[1] // fy, (first[1] + height - 1) // fy + 1):
            for i in range(first[2] // fx, (first[2] + width - 1) // fx + 1):
                z0, z1 = max(k * fz - first[0], 0), min((k + 1) * fz - first[0], depth)
                y0, y1 = max(j * fy - first[1], 0), min((j + 1) * fy - first[1], height)
                x0, x1 = max(i * fx - first[2], 0), min((i + 1) * fx - first[2], width)
                count = _candidates(
                    coarse, density, k + 1, j + 1, i + 1, names, means, weights, who
                )
                # 1. Cells deep inside a label are filled; in air, what is dense is counted.
                if count == 1:
                    if names[0]:
                        labels[z0:z1, y0:y1, x0:x1] = names[0]
                        continue
                    a, b, c = k - cells[0], j - cells[1], i - cells[2]
                    if (
                        0 <= a < unexplained.shape[0]
                        and 0 <= b < unexplained.shape[1]
                        and 0 <= c < unexplained.shape[2]
                    ):
                        strong, weak = 0, 0
                        for z in range(z0, z1):
                            for y in range(y0, y1):
                                for x in range(x0, x1):
                                    value = values[z + place[0], y + place[1], x + place[2]]
                                    weak += value >= low
                                    strong += value >= high
                        if strong >= 2:
                            unexplained[a, b, c] = weak
                    continue
                # 2. How well a density suits a label is counted in the contrast here and noise.
                least, most, air = means[0], means[0], -1
                for n in range(count):
                    least, most = min(least, means[n]), max(most, means[n])
                    if names[n] == 0:
                        air = n
                contrast = max((most - least) ** 2, np.float32(1e-12))
                scale = 0.5 / (tolerance * contrast + noise)
                for z in range(z0, z1):
                    wz = spline_z[(z + first[0]) % fz]
                    for y in range(y0, y1):
                        wy = spline_y[(y + first[1]) % fy]
                        for x in range(x0, x1):
                            wx = spline_x[(x + first[2]) % fx]
                            # 3. The share of each label around the voxel, by B-splines.
                            shares[:count] = 1e-4
                            n = 0
                            for dz in range(3):
                                for dy in range(3):
                                    w = wz[dz] * wy[dy]
                                    shares[who[n]] += w * wx[0]
                                    shares[who[n + 1]] += w * wx[1]
                                    shares[who[n + 2]] += w * wx[2]
                                    n += 3
                            value = _smooth(values, z + place[0], y + place[1], x + place[2])
                            if air >= 0 and value < low and shares[air] > 0.05:
                                continue
                            # 4. The least of misfit less log share: the likeliest label.
                            best = 0
                            worth = scale * (value - means[0]) ** 2 - np.log(shares[0])
                            for n in range(1, count):
                                misfit = scale * (value - means[n]) ** 2
                                # No share is above 1: its logarithm cannot help any more.
                                if misfit >= worth:
                                    continue
                                misfit -= np.log(shares[n])
                                if misfit < worth:
                                    best, worth = n, misfit
                            labels[z, y, x] = names[best]


@njit(cache=True, nogil=True)
def _splines(factor):  # type: ignore[no-untyped-def]
    """Return the quadratic B-spline weights of three cells for every place in the middle one."""
    weights = np.zeros((factor, 3), np.float32)
    for p in range(factor):
        t = (p + 0.5) / factor - 0.5
        weights[p] = 0.5 * (0.5 - t) ** 2, 0.75 - t * t, 0.5 * (0.5 + t) ** 2
    return weights


@njit(cache=True, nogil=True)
def _candidates(coarse, density, k, j, i, names, means, weights, who):  # type: ignore[no-untyped-def]
    """List the labels around a cell with the density each has here; return how many."""
    # Means are weighted by the square of how many of a cell's six neighbours are of its label:
    # cells at a border hold a little of both sides.
    here = coarse[k, j, i]
    same = True
    for c in range(k - 1, k + 2):
        for b in range(j - 1, j + 2):
            for a in range(i - 1, i + 2):
                same &= coarse[c, b, a] == here
    names[0] = here
    if same:
        return 1
    count, n = 0, 0
    depth, height, width = coarse.shape
    for c in range(k - 1, k + 2):
        for b in range(j - 1, j + 2):
            for a in range(i - 1, i + 2):
                name = coarse[c, b, a]
                m = 0
                while m < count and names[m] != name:
                    m += 1
                if m == count:
                    names[m], means[m], weights[m] = name, 0, 0
                    count += 1
                who[n] = m
                n += 1
                inner = np.float32(0.3)
                if c > 0:
                    inner += coarse[c - 1, b, a] == name
                if b > 0:
                    inner += coarse[c, b - 1, a] == name
                if a > 0:
                    inner += coarse[c, b, a - 1] == name
                if c + 1 < depth:
                    inner += coarse[c + 1, b, a] == name
                if b + 1 < height:
                    inner += coarse[c, b + 1, a] == name
                if a + 1 < width:
                    inner += coarse[c, b, a + 1] == name
                means[m] += inner * inner * density[c, b, a]
                weights[m] += inner * inner
    for m in range(count):
        means[m] = means[m] / weights[m] if names[m] else np.float32(0)
    return count


@njit(cache=True, nogil=True, inline="always")
def _smooth(values, z, y, x):  # type: ignore[no-untyped-def]
    """Return the mean of a voxel, counted twice, and its six neighbours."""
    here = values[z, y, x]
    total = 2 * here
    total += values[z - 1, y, x] if z > 0 else here
    total += values[z, y - 1, x] if y > 0 else here
    total += values[z, y, x - 1] if x > 0 else here
    total += values[z + 1, y, x] if z + 1 < values.shape[0] else here
    total += values[z, y + 1, x] if y + 1 < values.shape[1] else here
    total += values[z, y, x + 1] if x + 1 < values.shape[2] else here
    return total * np.float32(0.125)


@njit(cache=True, nogil=True)
def _drop_single(labels, first, slab, clean):  # type: ignore[no-untyped-def]
    """Copy the inner labels; a voxel that none of its neighbours equals takes their commonest."""
    depth, height, width = labels.shape
    near = np.zeros(6, np.int32)
    for k in range(slab[0], slab[1]):
        for j in range(clean.shape[1]):
            for i in range(clean.shape[2]):
                z, y, x = k + first[0], j + first[1], i + first[2]
                here = labels[z, y, x]
                near[0] = labels[z - 1, y, x] if z > 0 else here
                near[1] = labels[z, y - 1, x] if y > 0 else here
                near[2] = labels[z, y, x - 1] if x > 0 else here
                near[3] = labels[z + 1, y, x] if z + 1 < depth else here
                near[4] = labels[z, y + 1, x] if y + 1 < height else here
                near[5] = labels[z, y, x + 1] if x + 1 < width else here
                clean[k, j, i] = here
                most = 0
                for a in range(6):
                    most = max(most, 6 * (near[a] == here))
                for a in range(6):
                    times = 0
                    for b in range(6):
                        times += near[a] == near[b]
                    if times > most:
                        most, clean[k, j, i] = times, near[a]


def named_things(
    unexplained: NDArray[np.int32], labels: NDArray[np.int32], fewest: int
) -> NDArray[np.int32]:
    """Decide what becomes of foreground that the grid did not show.

    Parameters
    ----------
    unexplained : (z, y, x) ndarray of int32
        Voxels of it in every cell.
    labels : (z, y, x) ndarray of int32
        Objects on the grid.
    fewest : int
        Voxels of an object.

    Returns
    -------
    (z, y, x) ndarray of int32
        The label of such voxels in a cell: of a new object, above all labels, where connected
        cells (26 neighbours) hold enough voxels; else of the object they touch most; else 0.
    """
    # Two thin things that pass through neighbouring cells are one here.
    pieces, count = mask_components(unexplained > 0)
    owner = np.zeros(count + 1, np.int32)
    if not count:
        return pieces
    voxels = np.bincount(pieces.reshape(-1), unexplained.reshape(-1), count + 1)
    large = voxels >= fewest
    large[0] = False
    owner[large] = int(labels.max()) + np.arange(1, int(large.sum()) + 1)
    pairs = _touched(pieces, labels, ~large)
    if len(pairs):
        touched, times = np.unique(pairs, axis=0, return_counts=True)
        # Rising, so that the label touched most is written last; of equals the lowest.
        order = np.lexsort((-touched[:, 1], times))
        owner[touched[order, 0]] = touched[order, 1]
    return owner[pieces]


def write_things(
    source: Source,
    grid: GridLabels,
    things: NDArray[np.int32],
    block: NDArray[np.int32],
    box: Box,
    cells: Box,
) -> None:
    """Give the thin things of one block their labels.

    Parameters
    ----------
    source : Source
    grid : GridLabels
        The working grid.
    things : (z, y, x) ndarray of int32
        See `named_things`.
    block : (a, b, c) ndarray of int32
        Labels of the block; changed where they are 0.
    box, cells : tuple of slice
        The block in the volume and on the grid.
    """
    values = lifted(source.read(box), grid.levels.air, grid.unit)
    low = np.float32((grid.levels.low - grid.levels.air) / grid.unit)
    _write(values, low, np.array(grid.factors), np.ascontiguousarray(things[cells]), block)


@njit(cache=True, nogil=True)
def _touched(pieces, labels, small):  # type: ignore[no-untyped-def]
    """Return (piece, label) for every cell of a small piece and every label beside it."""
    depth, height, width = pieces.shape
    pairs = []
    for z, y, x in np.argwhere(pieces):
        if not small[pieces[z, y, x]]:
            continue
        for k in range(max(z - 1, 0), min(z + 2, depth)):
            for j in range(max(y - 1, 0), min(y + 2, height)):
                for i in range(max(x - 1, 0), min(x + 2, width)):
                    if labels[k, j, i]:
                        pairs.append((pieces[z, y, x], labels[k, j, i]))
    found = np.zeros((len(pairs), 2), np.int64)
    for n, pair in enumerate(pairs):
        found[n, 0], found[n, 1] = pair
    return found


@njit(cache=True, nogil=True)
def _write(values, low, factors, things, block):  # type: ignore[no-untyped-def]
    """Label what is dense in cells of thin things and has no label."""
    fz, fy, fx = factors
    for k, j, i in np.argwhere(things):
        for z in range(k * fz, min((k + 1) * fz, block.shape[0])):
            for y in range(j * fy, min((j + 1) * fy, block.shape[1])):
                for x in range(i * fx, min((i + 1) * fx, block.shape[2])):
                    if block[z, y, x] == 0 and values[z, y, x] >= low:
                        block[z, y, x] = things[k, j, i]
