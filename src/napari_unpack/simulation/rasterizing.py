"""Painting a modelled object into voxels, edges antialiased."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.boxes import Box, bounding_box
from napari_unpack.kernels import njit
from napari_unpack.simulation.clay import (
    CARVE,
    CLIP,
    CRUMPLED,
    CUT,
    GRAINS,
    JOIN,
    KNIT,
    LAYERS,
    PAINT,
    RINGS,
    ROLLED,
    START,
    Clay,
)  # fmt: skip
from napari_unpack.simulation.materials import MATERIALS
from napari_unpack.simulation.primitives import solid_distance
from napari_unpack.simulation.stacking import BLOCKED, Profile

VALUES = np.array([material.value for material in MATERIALS.values()])
DENSITIES = np.array([material.density for material in MATERIALS.values()])
FAR = 1e9
"""Of no lump, mm."""


@dataclass(frozen=True, eq=False)
class Raster:
    """An object in voxels, in a box of its own.

    Parameters
    ----------
    inside : (Z, Y, X) ndarray of bool
        Voxels whose centre is in the object.
    density : (Z, Y, X) ndarray of float32
        CT number + 1000 times the share of each voxel that is covered.
    grams : float
        Mass.
    origin : (3,) ndarray of float64
        Of the object's frame, in voxels of the box.
    """

    inside: NDArray[np.bool_]
    density: NDArray[np.float32]
    grams: float
    origin: NDArray[np.float64]


def _bounds(
    clay: Clay, rotation: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the box (mm) that holds an object turned about its frame's origin."""
    middle = rotation @ ((clay.lower + clay.upper) / 2)
    half = np.abs(rotation) @ ((clay.upper - clay.lower) / 2)
    return middle - half, middle + half


def rasterize(clay: Clay, rotation: NDArray[np.float64], spacing: NDArray[np.float64]) -> Raster:
    """Paint an object, turned, into voxels of a given size, cropped to a voxel around it.

    Parameters
    ----------
    clay : Clay
        The modelled object.
    rotation : (3, 3) ndarray of float64
        World from object.
    spacing : (3,) ndarray of float64, mm z y x

    Notes
    -----
    Cost is linear in the voxels of the box near the object times the rows of the program.
    """
    program = clay.program()
    low, high = _bounds(clay, rotation)
    # A voxel more on each side for antialiased edges, and one for the box that is not centred.
    size = np.maximum(np.ceil((high - low) / spacing).astype(np.int64), 1) + 3
    origin = (low + high) / 2 - (size - 1) / 2 * spacing
    levels = _fill_levels(program, low, high, rotation)
    inside = np.zeros(size, np.bool_)
    density = np.zeros(size, np.float32)
    grams = _paint(program, levels, rotation, origin, spacing, VALUES, DENSITIES, inside, density)
    box: Box = (slice(0, None), slice(0, None), slice(0, None))
    if inside.any():
        z, y, x = (slice(max(cut.start - 1, 0), cut.stop + 1) for cut in bounding_box(inside))
        box = z, y, x
    first = np.array([cut.start for cut in box])
    return Raster(
        np.ascontiguousarray(inside[box]),
        np.ascontiguousarray(density[box]),
        grams * float(np.prod(spacing)) / 1000.0,
        -origin / spacing - first,
    )


def silhouette_size(
    clay: Clay, rotation: NDArray[np.float64], spacing: NDArray[np.float64], pool: int
) -> NDArray[np.int64]:
    """Return how large a silhouette will be, before it is made: columns, rows, columns.

    Parameters
    ----------
    clay, rotation, spacing, pool
        As for `silhouette`.
    """
    low, high = _bounds(clay, rotation)
    return np.maximum(np.ceil((high - low) / (spacing * (pool, 1, pool))).astype(np.int64), 1)


def silhouette(
    clay: Clay, rotation: NDArray[np.float64], spacing: NDArray[np.float64], pool: int
) -> Profile:
    """Return what an object looks like from below and above, columns pool voxels wide, in rows.

    Parameters
    ----------
    clay, rotation, spacing
        As for `rasterize`.
    pool : int
        Columns are so many voxels wide. They are a little too full rather than too empty.
    """
    program = clay.program()
    low, high = _bounds(clay, rotation)
    step = spacing * (pool, 1, pool)
    size = silhouette_size(clay, rotation, spacing, pool)
    origin = (low + high) / 2 - (size - 1) / 2 * step
    under = np.full((size[0], size[2]), BLOCKED, np.int32)
    over = np.zeros((size[0], size[2]), np.int32)
    # Columns may not be missed between two samples: the object is grown by most of half a step.
    margin = 0.4 * max(step[0], step[2])
    _march(program, rotation, origin, step, size[1], margin, under, over)
    return Profile(under, over)


def _fill_levels(
    program: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    rotation: NDArray[np.float64],
) -> NDArray[np.float64]:
    # The world height above which each partly filled paint leaves its hollow, mm.
    levels = np.full(len(program), -FAR)
    partial = np.flatnonzero((program[:, 0] == PAINT) & (program[:, 3] < 1.0))
    if len(partial) == 0:
        return levels
    # 32 samples an edge place a liquid's level to 3 % of the height.
    axes = [np.linspace(a, b, 32) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    for row in partial:
        depth = _lump_distances(program[: row + 1], points @ rotation)
        # World heights, as y grows down: the level stays horizontal however the thing lies.
        heights = points[depth + program[row, 2] < 0, 1]
        if len(heights):
            levels[row] = np.quantile(heights, 1.0 - program[row, 3])
    return levels


@njit(cache=True, nogil=True)
def _lump(program, row, lump, spare, z, y, x):  # type: ignore[no-untyped-def]
    # The distance from the lump after one shaping row.
    # A solid too far to change it is told by the ball around it alone.
    r = program[row]
    dz, dy, dx = z - r[3], y - r[4], x - r[5]
    verb, soft = int(r[0]), r[2]
    if verb != CLIP:
        apart = math.sqrt(dz * dz + dy * dy + dx * dx) - r[21]
        if verb == START and apart > r[22] + spare:
            return apart
        if verb == JOIN and apart > lump + soft:
            return lump
        if verb == CUT and apart > soft - lump:
            return lump
    d = solid_distance(
        int(r[1]), r[15:21],
        r[6] * dz + r[7] * dy + r[8] * dx,
        r[9] * dz + r[10] * dy + r[11] * dx,
        r[12] * dz + r[13] * dy + r[14] * dx,
    )  # fmt: skip
    if verb == START:
        return d
    if verb == JOIN:
        return min(lump, d) - _fillet(abs(lump - d), soft)
    if verb == CUT:
        d = -d
    return max(lump, d) + _fillet(abs(lump - d), soft)


@njit(cache=True, nogil=True)
def _fillet(gap, soft):  # type: ignore[no-untyped-def]
    if gap >= soft:
        return 0.0
    share = 1.0 - gap / soft
    return share * share * soft * 0.25


@njit(cache=True, nogil=True)
def _envelope(program, spare, z, y, x):  # type: ignore[no-untyped-def]
    lump = FAR
    whole = FAR
    for row in range(program.shape[0]):
        verb = int(program[row, 0])
        if verb == PAINT:
            whole = min(whole, lump + program[row, 2])
        elif verb == CARVE:
            whole = max(whole, -(lump + program[row, 2]))
        else:
            lump = _lump(program, row, lump, spare, z, y, x)
    return whole


@njit(cache=True, nogil=True)
def _lump_distances(program, points):  # type: ignore[no-untyped-def]
    result = np.empty(points.shape[0])
    for i in range(points.shape[0]):
        lump = FAR
        for row in range(program.shape[0]):
            if program[row, 0] <= CLIP:
                lump = _lump(program, row, lump, FAR, points[i, 0], points[i, 1], points[i, 2])
        result[i] = lump
    return result


@njit(cache=True, nogil=True)
def _noise(z, y, x):  # type: ignore[no-untyped-def]
    # Value noise in -1..1 on a unit lattice, trilinear.
    a, b, c = math.floor(z), math.floor(y), math.floor(x)
    total = 0.0
    for i in range(2):
        for j in range(2):
            for k in range(2):
                # Primes of Teschner's spatial hash: noise without a table, alike everywhere.
                h = int(a + i) * 73856093 ^ int(b + j) * 19349663 ^ int(c + k) * 83492791
                h = (h ^ (h >> 13)) * 1274126177 & 0x7FFFFFFF
                w = abs(1 - i - (z - a)) * abs(1 - j - (y - b)) * abs(1 - k - (x - c))
                total += w * (h % 2001 - 1000) / 1000.0
    return total


@njit(cache=True, nogil=True)
def _texture(kind, grain, z, y, x):  # type: ignore[no-untyped-def]
    """Return a texture's relief at a point of the object's frame (mm), about -1..1."""
    turn = 2.0 * math.pi / grain
    if kind == KNIT:
        rib = math.sin(turn * x) * math.sin(turn * z + 1.5 * math.sin(turn * 0.5 * x))
        return 0.6 * rib + 0.6 * _noise(z / grain, y / grain, x / grain)
    if kind == LAYERS:
        warp = 0.9 * _noise(z / (6 * grain), 0.3, x / (6 * grain))
        return math.cos(turn * y + 2.0 * warp)
    if kind == CRUMPLED:
        return 0.7 * _noise(z / grain, y / grain, x / grain) + 0.5 * _noise(
            2.3 * z / grain, 2.3 * y / grain, 2.3 * x / grain
        )
    if kind == RINGS:
        return math.cos(turn * (math.hypot(z, y) + 0.02 * x))
    if kind == ROLLED:
        return math.cos(turn * math.hypot(z, y) + math.atan2(z, y))
    if kind == GRAINS:
        return 1.2 * _noise(z / grain, y / grain, x / grain)
    return 0.0


@njit(cache=True, nogil=True)
def _paint(program, levels, rotation, origin, spacing, values, densities, inside, density):  # type: ignore[no-untyped-def]
    edge = (spacing[0] * spacing[1] * spacing[2]) ** (1.0 / 3.0)
    # Blocks of 4 voxels far outside are skipped by one distance: most of a box is empty.
    block = 4
    clear = block * math.sqrt(spacing[0] ** 2 + spacing[1] ** 2 + spacing[2] ** 2)
    depth, height, width = inside.shape
    grams = 0.0
    for bz in range(0, depth, block):
        for by in range(0, height, block):
            for bx in range(0, width, block):
                wz = origin[0] + (bz + 1.5) * spacing[0]
                wy = origin[1] + (by + 1.5) * spacing[1]
                wx = origin[2] + (bx + 1.5) * spacing[2]
                oz = rotation[0, 0] * wz + rotation[1, 0] * wy + rotation[2, 0] * wx
                oy = rotation[0, 1] * wz + rotation[1, 1] * wy + rotation[2, 1] * wx
                ox = rotation[0, 2] * wz + rotation[1, 2] * wy + rotation[2, 2] * wx
                if _envelope(program, clear, oz, oy, ox) > clear:
                    continue
                for z in range(bz, min(bz + block, depth)):
                    for y in range(by, min(by + block, height)):
                        for x in range(bx, min(bx + block, width)):
                            wz = origin[0] + z * spacing[0]
                            wy = origin[1] + y * spacing[1]
                            wx = origin[2] + x * spacing[2]
                            whole, value, weight = _voxel(
                                program, levels, edge, values, densities, wy,
                                rotation[0, 0] * wz + rotation[1, 0] * wy + rotation[2, 0] * wx,
                                rotation[0, 1] * wz + rotation[1, 1] * wy + rotation[2, 1] * wx,
                                rotation[0, 2] * wz + rotation[1, 2] * wy + rotation[2, 2] * wx,
                            )  # fmt: skip
                            inside[z, y, x] = whole <= 0.0
                            density[z, y, x] = value
                            grams += weight
    return grams


@njit(cache=True, nogil=True)
def _voxel(program, levels, edge, values, densities, height, z, y, x):  # type: ignore[no-untyped-def]
    spare = edge
    lump = FAR
    whole = FAR
    value = 0.0
    weight = 0.0
    for row in range(program.shape[0]):
        r = program[row]
        verb = int(r[0])
        if verb < PAINT:
            lump = _lump(program, row, lump, spare, z, y, x)
            continue
        d = lump + r[2]
        # Paint adds to the object, carving takes away from it, in the order of the program.
        whole = min(whole, d) if verb == PAINT else max(whole, -d)
        # A voxel's share, from the distance of its centre: exact for a face along the grid.
        cover = min(max(0.5 - d / edge, 0.0), 1.0)
        if levels[row] > -FAR:
            cover *= min(max(0.5 + (height - levels[row]) / edge, 0.0), 1.0)
        if cover <= 0.0:
            continue
        new = values[int(r[1])]
        if verb == PAINT and r[4] > 0.0:
            new *= 1.0 + r[6] * _texture(int(r[4]), r[5], z, y, x)
        # Mixed, not added: later paint covers what was there.
        value += cover * (new - value)
        weight += cover * (densities[int(r[1])] - weight)
    return whole, value, weight


@njit(cache=True, nogil=True)
def _march(program, rotation, origin, step, rows, margin, under, over):  # type: ignore[no-untyped-def]
    # Every column is walked from both ends, as far at a time as the distance allows.
    for z in range(under.shape[0]):
        wz = origin[0] + z * step[0]
        for x in range(under.shape[1]):
            wx = origin[2] + x * step[2]
            found = 0
            for end in range(2):
                row = 0.0
                while row < rows:
                    at = row if end == 0 else rows - 1 - row
                    wy = origin[1] + at * step[1]
                    d = _envelope(
                        program, margin,
                        rotation[0, 0] * wz + rotation[1, 0] * wy + rotation[2, 0] * wx,
                        rotation[0, 1] * wz + rotation[1, 1] * wy + rotation[2, 1] * wx,
                        rotation[0, 2] * wz + rotation[1, 2] * wy + rotation[2, 2] * wx,
                    ) - margin  # fmt: skip
                    if d <= 0.0:
                        found += 1
                        break
                    # Fillets and some solids overstate distances: steps stay short.
                    row += max(0.8 * d / step[1], 1.0)
                if found == 0:
                    break
                if end == 0:
                    over[z, x] = int(row)
                else:
                    under[z, x] = max(rows - int(row), over[z, x] + 1)
