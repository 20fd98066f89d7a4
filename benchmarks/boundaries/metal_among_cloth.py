"""Cloth folded around metal boxes, cans and coiled cables, as in a packed rucksack."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from benchmarks.boundaries.solids import Points, Solid, any_solid

Field = NDArray[np.float32]

SATURATED = 4095.0
"""No density of a scan of twelve bits lies above; half the volumes are cut there."""

TRIES = 60
"""Places that are tried for a thing before it is left out."""

MOST_SHARED = 0.05
"""Of a thing's voxels that may be another's already; cloth gives way to all."""


@dataclass(frozen=True)
class Thing:
    """A solid of one label.

    Parameters
    ----------
    solid : callable
        Signed distance in voxels, of points about its centre.
    reach : float
        How far from its centre it goes, voxels.
    wall : float
        How thick its wall is, voxels.
    value, filling : float
        Densities of the wall and of what is in it.
    """

    solid: Solid
    reach: float
    wall: float
    value: float
    filling: float


def metal_among_cloth(
    seed: int, shape: tuple[int, int, int] = (112, 112, 112)
) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Return the sharp density and the labels of things that cloth is folded around.

    Parameters
    ----------
    seed : int
        Of everything random.
    shape : (int, int, int)
        Of the volume, z y x.

    Returns
    -------
    density : (Z, Y, X) ndarray of uint16
    labels : (Z, Y, X) ndarray of uint16
        A box and what it is filled with are one.
    """
    rng = np.random.default_rng([seed, 3])
    density, labels = _cloth(rng, shape)
    cloths = int(labels.max())
    kinds: list[tuple[Callable[[np.random.Generator], list[Thing]], int]] = [
        (_metal_box, int(rng.integers(2, 5))),
        (_can, int(rng.integers(1, 4))),
        (_cable, int(rng.integers(1, 4))),
        (_block_and_plate, int(rng.integers(0, 3))),
        (_lump, int(rng.integers(3, 8))),
    ]
    for make, count in kinds:
        for _ in range(count):
            _put(rng, density, labels, cloths, make(rng))
    if rng.random() < 0.5:
        np.minimum(density, SATURATED, out=density)
    return density.astype(np.uint16), labels


def _cloth(
    rng: np.random.Generator, shape: tuple[int, int, int]
) -> tuple[Field, NDArray[np.uint16]]:
    """Fill the volume with folded cloths: layers of a few voxels with air between."""
    z, y, x = np.indices(shape, np.float32)
    height = z + _waves(rng, y, x) + _waves(rng, z, x) * 0.5
    side = x + _waves(rng, z, y)
    density, labels = np.zeros(shape, np.float32), np.zeros(shape, np.uint16)
    floor = float(height.min())
    top = float(height.max()) * rng.uniform(0.75, 1.0)
    name = 0
    while floor < top:
        rise = rng.uniform(12, 36)
        seam = rng.uniform(-0.2, 1.2) * shape[2]
        for left in (True, False):
            name += 1
            layer, gap = rng.uniform(3.0, 7.0), rng.uniform(0.4, 1.3)
            here = (height >= floor + 0.7) & (height < floor + rise - 0.7)
            here &= (side < seam - 0.7) if left else (side > seam + 0.7)
            fold = np.mod(height - floor + _waves(rng, y, x) * 0.3, layer)
            weave = gaussian_filter(rng.normal(size=shape).astype(np.float32), 1.2) * 2.5
            value = np.exp(rng.uniform(np.log(90), np.log(420)))
            labels[here] = name
            cloth = value * np.clip(1 + 0.25 * weave, 0.3, 2) * (fold > gap)
            density[here] = cloth[here]
        floor += rise
    # What cannot be seen is no object's.
    labels[density < 40] = 0
    return density, labels


def _waves(rng: np.random.Generator, a: Field, b: Field) -> Field:
    total = np.zeros_like(a)
    for _ in range(3):
        length, phase = rng.uniform(35, 110), rng.uniform(0, 2 * np.pi)
        way = rng.uniform(0, 2 * np.pi)
        along = np.cos(way) * a + np.sin(way) * b
        total += rng.uniform(1, 6) * np.sin(2 * np.pi * along / length + phase)
    return total.astype(np.float32)


def _metal_box(rng: np.random.Generator) -> list[Thing]:
    """Return a hollow box of metal: empty, or with something in it."""
    half = np.exp(rng.uniform(np.log(5), np.log(22), 3)).astype(np.float32)
    rounding = np.float32(rng.uniform(0, 0.5) * half.min())
    wall = rng.uniform(1.0, 3.0)
    metal = rng.uniform(1800, 8000)
    kind = rng.random()
    filling = metal if kind < 0.15 else 0.0 if kind < 0.55 else rng.uniform(150, 1400)
    return [Thing(_slab(half, rounding), float(half.max()) * 1.8, wall, metal, filling)]


def _slab(half: NDArray[np.float32], rounding: float = 0.0, lift: float = 0.0) -> Solid:
    """Return a box of such half sides, its centre so far along the first axis."""

    def distance(points: Points) -> NDArray[np.float32]:
        q = np.abs(points - np.array([lift, 0, 0], np.float32)) - (half - rounding)
        return np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0) - rounding

    return distance


def _block_and_plate(rng: np.random.Generator) -> list[Thing]:
    """Return a block and a plate of metal that lies flat on it."""
    half = np.exp(rng.uniform(np.log(6), np.log(18), 3)).astype(np.float32)
    thick = np.float32(rng.uniform(0.8, 2.5))
    plate = np.array([thick, *(half[1:] * rng.uniform(0.3, 1.1, 2))], np.float32)
    value, metal = rng.uniform(300, 1500), rng.uniform(2000, 8000)
    reach = 2.5 * float(half.max())
    block = Thing(_slab(half), reach, 99.0, value, value)
    return [block, Thing(_slab(plate, 0.0, half[0] + thick), reach, 99.0, metal, metal)]


def _can(rng: np.random.Generator) -> list[Thing]:
    """Return a can or a bottle: a thin wall around a liquid, a powder, or air."""
    radius, half = rng.uniform(5, 14), rng.uniform(8, 26)

    def distance(points: Points) -> NDArray[np.float32]:
        return np.maximum(
            np.hypot(points[:, 1], points[:, 2]) - radius, np.abs(points[:, 0]) - half
        )

    filling = 0.0 if rng.random() < 0.25 else rng.uniform(400, 1300)
    wall, value = rng.uniform(1.0, 2.0), np.exp(rng.uniform(np.log(500), np.log(4000)))
    return [Thing(distance, half + radius, wall, float(value), filling)]


def _cable(rng: np.random.Generator) -> list[Thing]:
    """Return a coil of cable with a loose end."""
    across, turns = rng.uniform(7, 22), rng.uniform(1.5, 4.5)
    radius, t = rng.uniform(1.4, 2.6), np.linspace(0, 1, int(40 * turns) + 40)
    angle = 2 * np.pi * turns * np.minimum(t * 1.15, 1)
    wide = across * (1 + 0.15 * np.sin(3 * angle + rng.uniform(0, 6)))
    wide = wide * rng.uniform(0.9, 1.1)
    squeeze = rng.uniform(0.35, 1.0)
    loose = np.maximum(t - 0.87, 0) / 0.13
    rise = rng.uniform(1.0, 3.0) * radius * turns
    line = np.stack(
        [
            rise * t + rng.normal(0, 0.3) + loose * rng.uniform(-8, 8),
            wide * np.sin(angle) * squeeze,
            wide * np.cos(angle) + loose * across * rng.uniform(0.5, 1.5),
        ],
        axis=1,
    )
    steps = np.concatenate([[0], np.linalg.norm(np.diff(line, axis=0), axis=1).cumsum()])
    fine = np.arange(0, steps[-1], 0.5)
    line = np.stack([np.interp(fine, steps, c) for c in line.T], axis=1)
    line -= (line.max(axis=0) + line.min(axis=0)) / 2
    tree = cKDTree(line)

    def distance(points: Points) -> NDArray[np.float32]:
        return (tree.query(points)[0] - radius).astype(np.float32)

    value, reach = rng.uniform(900, 2600), float(np.abs(line).max()) + radius
    return [Thing(distance, reach, 99.0, value, value)]


def _lump(rng: np.random.Generator) -> list[Thing]:
    """Return a thing of one material, or of two."""
    size = float(np.exp(rng.uniform(np.log(4), np.log(18))))
    value = float(np.exp(rng.uniform(np.log(250), np.log(2500))))
    filling = value if rng.random() < 0.7 else rng.uniform(0, 1200)
    solid = any_solid(rng, size)
    return [Thing(solid, 2.2 * size, rng.uniform(1.5, 4), value, filling)]


def _put(
    rng: np.random.Generator,
    density: Field,
    labels: NDArray[np.uint16],
    cloths: int,
    things: list[Thing],
) -> None:
    """Press things that belong together into the cloth, where nothing else is."""
    turn = Rotation.random(random_state=rng).as_matrix().astype(np.float32)
    if rng.random() < 0.4:
        turn = np.eye(3, dtype=np.float32)[rng.permutation(3)]
    limit = np.array(labels.shape)
    reach = max(thing.reach for thing in things)
    for _ in range(TRIES):
        center = rng.uniform(0.1, 0.9, 3) * limit
        low = np.maximum(np.floor(center - reach).astype(int), 0)
        high = np.minimum(np.ceil(center + reach).astype(int) + 1, limit)
        region = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
        points = np.moveaxis(np.indices(labels[region].shape), 0, -1) + low - center
        turned = points.reshape(-1, 3).astype(np.float32) @ turn
        far = [thing.solid(turned).reshape(labels[region].shape) for thing in things]
        inside = np.min(far, axis=0) < 0
        if not inside.any() or (labels[region][inside] > cloths).mean() > MOST_SHARED:
            continue
        free = labels[region] <= cloths
        for thing, distance in zip(things, far, strict=True):
            own = (distance < 0) & free
            labels[region][own] = labels.max() + 1
            density[region][own] = np.where(distance > -thing.wall, thing.value, thing.filling)[own]
        return
