"""Kernels that measure a region in one pass: all that the oracle's features need."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

# Of histograms for quantiles: which are exact to one bin.
BINS = 4096


@njit(cache=True, nogil=True)
def measure_region(mask, depth, field, origin, spacing, middle):  # type: ignore[no-untyped-def]
    """Measure densities, gradients, moments and the boundary of a region in one pass.

    Parameters
    ----------
    mask : (Z, Y, X) ndarray of bool
        The region in its box.
    depth : (Z, Y, X) ndarray of float32
        Distance to the outside, mm.
    field : ndarray
        Density, of the box or of the whole volume.
    origin : (3,) ndarray of int64
        First voxel of the box in `field`.
    spacing : (3,) ndarray of float64, mm z y x
    middle : float
        The region's median density, above 0.

    Returns
    -------
    values, deep, l1, l2 : (N,) ndarray of float32
        Density, depth, and the L1 and L2 norm of the density's gradient inside, a voxel; 1/mm.
    moments : (9,) ndarray of float64
        Sums of z, y, x, zz, yy, xx, zy, zx, yx, mm.
    edge : (10,) ndarray of float64
        Boundary sums, areas in mm^2: surface; curvature; |curvature|; area that has a step;
        |step|; inward steps; outward steps; |step| curvature; weak area; dense area.
    weak : (3,) ndarray of float64
        Vector area of the weak boundary, mm^2.
    steps : (F,) ndarray of float32
        Step of every face that has one.
    near : float
        Sum of |step| between the two voxels at every face, for the blur index.
    inner : float
        Sum of squared differences across faces inside.
    """
    nz, ny, nx = mask.shape
    fz, fy, fx = field.shape
    # 1. Count voxels and boundary faces, so that every array has its size from the start.
    count, faces = 0, 0
    for z in range(nz):
        for y in range(ny):
            for x in range(nx):
                if not mask[z, y, x]:
                    continue
                count += 1
                for axis in range(3):
                    for side in (-1, 1):
                        k = z + (side if axis == 0 else 0)
                        j = y + (side if axis == 1 else 0)
                        i = x + (side if axis == 2 else 0)
                        if not (0 <= k < nz and 0 <= j < ny and 0 <= i < nx) or not mask[k, j, i]:
                            faces += 1
    values = np.empty(count, np.float32)
    deep = np.empty(count, np.float32)
    l1 = np.empty(count, np.float32)
    l2 = np.empty(count, np.float32)
    steps = np.empty(faces, np.float32)
    moments = np.zeros(9)
    edge = np.zeros(10)
    weak = np.zeros(3)
    normal = np.zeros(3)
    open_faces = np.zeros(6)
    area = np.array(
        [spacing[1] * spacing[2], spacing[0] * spacing[2], spacing[0] * spacing[1]], np.float64
    )
    near, inner = 0.0, 0.0
    count, faces = 0, 0
    # 2. Every voxel: its density and depth, and what it adds to the moments of the shape.
    for z in range(nz):
        for y in range(ny):
            for x in range(nx):
                if not mask[z, y, x]:
                    continue
                value = _at(field, z + origin[0], y + origin[1], x + origin[2])
                values[count] = value
                deep[count] = depth[z, y, x]
                a, b, c = z * spacing[0], y * spacing[1], x * spacing[2]
                moments[0] += a
                moments[1] += b
                moments[2] += c
                moments[3] += a * a
                moments[4] += b * b
                moments[5] += c * c
                moments[6] += a * b
                moments[7] += a * c
                moments[8] += b * c
                # 3. The density's gradient by differences with face neighbours inside, mean of both
                # sides where there are two; faces without one are the boundary.
                sum1, sum2, border = 0.0, 0.0, 0
                for axis in range(3):
                    slope, sides = 0.0, 0
                    for side in (-1, 1):
                        dz = side if axis == 0 else 0
                        dy = side if axis == 1 else 0
                        dx = side if axis == 2 else 0
                        k, j, i = z + dz, y + dy, x + dx
                        here = 2 * axis + (side + 1) // 2
                        if 0 <= k < nz and 0 <= j < ny and 0 <= i < nx and mask[k, j, i]:
                            other = _at(field, k + origin[0], j + origin[1], i + origin[2])
                            slope += side * (other - value)
                            sides += 1
                            open_faces[here] = 0
                            if side > 0:
                                inner += (other - value) ** 2
                        else:
                            open_faces[here] = 1
                            border += 1
                    if sides:
                        slope /= sides * spacing[axis]
                    sum1 += abs(slope)
                    sum2 += slope * slope
                l1[count] = sum1
                l2[count] = np.sqrt(sum2)
                count += 1
                if border == 0:
                    continue
                # 4. Boundary voxels: of the 27 voxels around, those inside give the outward normal
                # and the mean curvature; 18 of 27 are inside at a plane.
                occupied = 0
                normal[:] = 0
                for dz in range(-1, 2):
                    for dy in range(-1, 2):
                        for dx in range(-1, 2):
                            k, j, i = z + dz, y + dy, x + dx
                            if 0 <= k < nz and 0 <= j < ny and 0 <= i < nx and mask[k, j, i]:
                                occupied += 1
                                normal[0] -= dz / spacing[0]
                                normal[1] -= dy / spacing[1]
                                normal[2] -= dx / spacing[2]
                length = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
                curvature = 1 - occupied / 18
                for axis in range(3):
                    for side in (-1, 1):
                        if open_faces[2 * axis + (side + 1) // 2] == 0:
                            continue
                        # 5. Boundary faces. Counted as they are they favour boxes along the axes:
                        # each stands for its area projected onto the surface.
                        slant = 1.0
                        if length > 1e-9:
                            slant = max(side * normal[axis] / length, 0.0)
                        size = area[axis] * slant
                        edge[0] += size
                        edge[1] += size * curvature
                        edge[2] += size * abs(curvature)
                        dz = side if axis == 0 else 0
                        dy = side if axis == 1 else 0
                        dx = side if axis == 2 else 0
                        k, j, i = z + origin[0] + dz, y + origin[1] + dy, x + origin[2] + dx
                        if not (0 <= k < fz and 0 <= j < fy and 0 <= i < fx):
                            continue
                        beyond = _at(field, k, j, i)
                        near += size * abs(value - beyond)
                        # 6. The step of density across the face, from a voxel inside to one two
                        # voxels further out: a scan blurs its edges over about one on both sides.
                        k, j, i = z + 2 * dz, y + 2 * dy, x + 2 * dx
                        free = not (0 <= k < nz and 0 <= j < ny and 0 <= i < nx)
                        if free or not mask[k, j, i]:
                            k, j, i = k + origin[0], j + origin[1], i + origin[2]
                            if 0 <= k < fz and 0 <= j < fy and 0 <= i < fx:
                                beyond = _at(field, k, j, i)
                        within = value
                        k, j, i = z - dz, y - dy, x - dx
                        if 0 <= k < nz and 0 <= j < ny and 0 <= i < nx and mask[k, j, i]:
                            within = _at(field, k + origin[0], j + origin[1], i + origin[2])
                        step = within - beyond
                        steps[faces] = step
                        faces += 1
                        edge[3] += size
                        edge[4] += size * abs(step)
                        edge[5] += size * max(-step, 0.0)
                        edge[6] += size * max(step, 0.0)
                        edge[7] += size * abs(step) * curvature
                        # 7. Where the step is weak, or the outside denser, the region may have been
                        # cut there; the vector area of a flat cut is large, of noise all round 0.
                        if step < 0.2 * middle:
                            if step > -0.2 * middle:
                                edge[8] += size
                            else:
                                edge[9] += size
                            weak[axis] += side * area[axis]
    return values, deep, l1, l2, moments, edge, weak, steps[:faces], near, inner


@njit(cache=True, nogil=True)
def _at(field, z, y, x):  # type: ignore[no-untyped-def]
    """Return a density, 0 where none was measured."""
    value = np.float64(field[z, y, x])
    return value if np.isfinite(value) else 0.0


@njit(cache=True, nogil=True)
def level_area(mask, field, origin, spacing, level):  # type: ignore[no-untyped-def]
    """Return the area, mm^2, of the faces inside between densities below and above a level.

    Parameters
    ----------
    mask, field, origin, spacing
        As for `measure_region`.
    level : float
        Density.
    """
    nz, ny, nx = mask.shape
    total = 0.0
    for z in range(nz):
        for y in range(ny):
            for x in range(nx):
                if not mask[z, y, x]:
                    continue
                high = _at(field, z + origin[0], y + origin[1], x + origin[2]) > level
                if z + 1 < nz and mask[z + 1, y, x]:
                    other = _at(field, z + 1 + origin[0], y + origin[1], x + origin[2]) > level
                    total += spacing[1] * spacing[2] if high != other else 0.0
                if y + 1 < ny and mask[z, y + 1, x]:
                    other = _at(field, z + origin[0], y + 1 + origin[1], x + origin[2]) > level
                    total += spacing[0] * spacing[2] if high != other else 0.0
                if x + 1 < nx and mask[z, y, x + 1]:
                    other = _at(field, z + origin[0], y + origin[1], x + 1 + origin[2]) > level
                    total += spacing[0] * spacing[1] if high != other else 0.0
    return total


def chamfer_depth(
    mask: NDArray[np.bool_], spacing: tuple[float, float, float]
) -> NDArray[np.float32]:
    """Return the shortest way out over the 26 neighbours, mm; at most 13 % above the Euclidean.

    Parameters
    ----------
    mask : (Z, Y, X) ndarray of bool
        What lies beyond the box is outside.
    spacing : (float, float, float) of mm, z y x
    """
    # `edt.edt` is exact and no slower, but the shipped oracle was trained on these depths: with
    # others its features, and so every confidence, would shift.
    # Half of the 26 neighbours: the second sweep looks the other way.
    steps = np.array(
        [
            (a, b, c)
            for a in (-1, 0)
            for b in (-1, 0, 1)
            for c in (-1, 0, 1)
            if (a, b, c) < (0, 0, 0)
        ]
    )
    # In float32, as the distances are: sums must compare equal in both sweeps.
    lengths = np.linalg.norm(steps * np.array(spacing), axis=1).astype(np.float32)
    out = np.zeros([n + 2 for n in mask.shape], np.float32)
    strides = np.array([out.shape[1] * out.shape[2], out.shape[2], 1])
    _chamfer(np.ascontiguousarray(mask), out.reshape(-1), strides, steps @ strides, lengths)
    return out[1:-1, 1:-1, 1:-1]


@njit(cache=True, nogil=True)
def _chamfer(mask, out, strides, jumps, lengths):  # type: ignore[no-untyped-def]
    """Sweep forward and back over the volume (Rosenfeld & Pfaltz 1966)."""
    nz, ny, nx = mask.shape
    for turn in range(2):
        for row in range(nz * ny):
            z, y = row // ny, row % ny
            if turn:
                z, y = nz - 1 - z, ny - 1 - y
            base = (z + 1) * strides[0] + (y + 1) * strides[1] + 1
            for k in range(nx):
                x = nx - 1 - k if turn else k
                if not mask[z, y, x]:
                    continue
                here = base + x
                if turn:
                    best = out[here]
                    for n in range(len(jumps)):
                        best = min(best, out[here - jumps[n]] + lengths[n])
                else:
                    best = np.float32(np.inf)
                    for n in range(len(jumps)):
                        best = min(best, out[here + jumps[n]] + lengths[n])
                out[here] = best


def quantiles(values: NDArray[np.float32], shares: list[float]) -> NDArray[np.float64]:
    """Return quantiles, to a 4096th of the range, whatever the order of the values.

    Parameters
    ----------
    values : (N,) ndarray of float32
        At least one.
    shares : list of float
        In [0, 1].
    """
    low, high = float(values.min()), float(values.max())
    if high <= low:
        return np.full(len(shares), low)
    counts = np.cumsum(_histogram(values, low, BINS / (high - low)))
    edges = np.arange(BINS + 1) * ((high - low) / BINS) + low
    return np.interp(np.array(shares) * len(values), np.concatenate([[0.0], counts]), edges)


@njit(cache=True, nogil=True)
def _histogram(values, low, scale):  # type: ignore[no-untyped-def]
    """Count values into `BINS` bins."""
    counts = np.zeros(BINS)
    for value in values:
        counts[min(int((value - low) * scale), BINS - 1)] += 1
    return counts
