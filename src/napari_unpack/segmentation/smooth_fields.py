"""The smooth fields of the Mumford-Shah energy: their solve, their energy, what they prefer."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from numpy.typing import NDArray

if TYPE_CHECKING:
    from napari_unpack.segmentation.mumford_shah import Weights

BEYOND = 0.001
"""Weight of an edge with no end in a field's own side, by which the field is extended there."""


def relax(
    data: NDArray[np.float32],
    side: NDArray[np.bool_],
    field: NDArray[np.float32],
    weights: Weights,
    active: NDArray[np.bool_],
    close: float = 0.005,
    sweeps: int = 100,
) -> int:
    """Make a field fit the data of its side and be smooth.

    Parameters
    ----------
    data : (Z, Y, X) ndarray of float32
        NaN where nothing was measured.
    side : (Z, Y, X) ndarray of bool
        Where the field answers for the data.
    field : (Z, Y, X) ndarray of float32
        Changed where `active`.
    weights : Weights
        Of the energy.
    active : (Z, Y, X) ndarray of bool
        Where the field may change.
    close : float
        Done when no value changed by more in a sweep.
    sweeps : int
        Done after so many in any case.

    Returns
    -------
    int
        Sweeps made.

    Notes
    -----
    Red-black Gauss-Seidel: every step solves one voxel's equation exactly, so that no sweep
    raises the energy.
    """
    squeeze = np.array(weights.squeeze, np.float32) * np.float32(weights.smoothness)
    where = np.flatnonzero(active)
    made, largest = 0, np.inf
    while made < sweeps and largest > close:
        largest = max(_sweep(data, side, field, squeeze, where, color) for color in (0, 1))
        made += 1
    return made


def energy(
    data: NDArray[np.float32],
    matter: NDArray[np.bool_],
    inside: NDArray[np.float32],
    outside: NDArray[np.float32],
    weights: Weights,
) -> float:
    """Return the energy of a mask and its fields; see `mumford_shah.mumford_shah`."""
    squeeze = np.array(weights.squeeze) * weights.smoothness
    faces = np.array(weights.faces) * weights.boundary
    return float(_energy(data, matter, inside, outside, squeeze, faces))


def preferences(
    data: NDArray[np.float32],
    inside: NDArray[np.float32],
    outside: NDArray[np.float32],
    weights: Weights,
) -> NDArray[np.float32]:
    """Return by how much the energy rises if a voxel is matter rather than air, boundary aside."""
    squeeze = np.array(weights.squeeze) * weights.smoothness
    return np.asarray(_preferences(data, inside, outside, squeeze))


@njit(cache=True, nogil=True)
def _sweep(data, side, field, squeeze, where, color):  # type: ignore[no-untyped-def]
    depth, height, width = data.shape
    largest = np.float32(0)
    beyond, half = np.float32(BEYOND), np.float32((1 - BEYOND) / 2)
    for n in where:
        x = n % width
        y = (n // width) % height
        z = n // (width * height)
        if (z + y + x) % 2 != color:
            continue
        here = side[z, y, x]
        value = data[z, y, x]
        total, weight = np.float32(0), np.float32(1e-9)
        if here and value == value:
            total, weight = value, np.float32(1)
        for axis in range(3):
            for way in (-1, 1):
                k, j, i = z + way * (axis == 0), y + way * (axis == 1), x + way * (axis == 2)
                if k < 0 or j < 0 or i < 0 or k == depth or j == height or i == width:
                    continue
                w = squeeze[axis] * (beyond + half * (np.float32(here) + np.float32(side[k, j, i])))
                total += w * field[k, j, i]
                weight += w
        fresh = total / weight
        largest = max(largest, abs(fresh - field[z, y, x]))
        field[z, y, x] = fresh
    return largest


@njit(cache=True, nogil=True)
def _energy(data, matter, inside, outside, squeeze, faces):  # type: ignore[no-untyped-def]
    depth, height, width = data.shape
    total, half = 0.0, (1 - BEYOND) / 2
    for z in range(depth):
        for y in range(height):
            for x in range(width):
                here, value = matter[z, y, x], data[z, y, x]
                if value == value:
                    field = inside[z, y, x] if here else outside[z, y, x]
                    total += (np.float64(value) - field) ** 2
                for axis in range(3):
                    k, j, i = z + (axis == 0), y + (axis == 1), x + (axis == 2)
                    if k == depth or j == height or i == width:
                        continue
                    there = matter[k, j, i]
                    both = np.float64(here) + np.float64(there)
                    f = np.float64(inside[z, y, x]) - inside[k, j, i]
                    g = np.float64(outside[z, y, x]) - outside[k, j, i]
                    total += squeeze[axis] * (BEYOND + half * both) * f * f
                    total += squeeze[axis] * (BEYOND + half * (2 - both)) * g * g
                    if here != there:
                        total += faces[axis]
    return total


@njit(cache=True, nogil=True)
def _preferences(data, inside, outside, squeeze):  # type: ignore[no-untyped-def]
    depth, height, width = data.shape
    result = np.zeros(data.shape, np.float32)
    half = (1 - BEYOND) / 2
    for z in range(depth):
        for y in range(height):
            for x in range(width):
                value = data[z, y, x]
                f, g = inside[z, y, x], outside[z, y, x]
                total = 0.0
                if value == value:
                    total = (value - f) ** 2 - (value - g) ** 2
                for axis in range(3):
                    for way in (-1, 1):
                        k, j, i = (
                            z + way * (axis == 0),
                            y + way * (axis == 1),
                            x + way * (axis == 2),
                        )
                        if k < 0 or j < 0 or i < 0 or k == depth or j == height or i == width:
                            continue
                        df, dg = f - inside[k, j, i], g - outside[k, j, i]
                        total += squeeze[axis] * half * (df * df - dg * dg)
                result[z, y, x] = total
    return result
