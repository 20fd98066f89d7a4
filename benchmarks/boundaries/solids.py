"""Random solids packed so that they touch: shapes no simulated bag holds."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, find_objects, label
from scipy.spatial.transform import Rotation

Points = NDArray[np.float32]
Solid = Callable[[Points], NDArray[np.float32]]
"""Signed distance, roughly, of (N, 3) points in voxels about the solid's centre."""


def box(rng: np.random.Generator, size: float) -> Solid:
    half = size * np.exp(rng.uniform(-1.0, 0.2, 3)).astype(np.float32)
    rounding = np.float32(rng.uniform(0, 0.3) * half.min())

    def distance(points: Points) -> NDArray[np.float32]:
        q = np.abs(points) - (half - rounding)
        return np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0) - rounding

    return distance


def ellipsoid(rng: np.random.Generator, size: float) -> Solid:
    radii = size * np.exp(rng.uniform(-0.6, 0.3, 3)).astype(np.float32)
    power = float(rng.choice([0.8, 1.3, 2.0, 2.0, 3.0, 6.0]))

    def distance(points: Points) -> NDArray[np.float32]:
        reach = (np.abs(points / radii) ** power).sum(axis=1) ** (1 / power)
        return (reach - 1) * radii.min()

    return distance


def cylinder(rng: np.random.Generator, size: float) -> Solid:
    radius, half = size * rng.uniform(0.3, 0.9), size * np.exp(rng.uniform(-1.5, 0.5))
    taper = rng.uniform(-0.4, 0.4) * (rng.random() < 0.4)

    def distance(points: Points) -> NDArray[np.float32]:
        here = radius * (1 + taper * points[:, 0] / half)
        return np.maximum(np.hypot(points[:, 1], points[:, 2]) - here, np.abs(points[:, 0]) - half)

    return distance


def tube(rng: np.random.Generator, size: float) -> Solid:
    """Return a bent rod, or a pipe."""
    knots = np.cumsum(rng.normal(size=(4, 3)), axis=0)
    t = np.linspace(0, 1, 24)[:, None]
    line = sum(
        c * k
        for c, k in zip(
            ((1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t * t * (1 - t), t**3), knots, strict=True
        )
    )
    line = line - (line.max(axis=0) + line.min(axis=0)) / 2
    line = (line * (1.5 * size / np.abs(line).max())).astype(np.float32)
    radius = max(size * rng.uniform(0.12, 0.35), 1.6)

    def distance(points: Points) -> NDArray[np.float32]:
        from scipy.spatial import cKDTree

        fine = np.concatenate([np.linspace(a, b, 6) for a, b in itertools.pairwise(line)])
        return (cKDTree(fine).query(points)[0] - radius).astype(np.float32)

    return distance


def sheet(rng: np.random.Generator, size: float) -> Solid:
    """Return a thin, wavy plate."""
    half = size * rng.uniform(0.8, 1.6, 2)
    thick = rng.uniform(0.9, 3.0)
    wave = rng.uniform(0, 0.35) * size * np.array([1.0, rng.random()])
    phase, pace = rng.uniform(0, 6, 2), rng.uniform(1, 3.5, 2) / size

    def distance(points: Points) -> NDArray[np.float32]:
        lift = (wave * np.sin(points[:, 1:] * pace + phase)).sum(axis=1)
        q = np.abs(points[:, 1:]) - half
        return np.maximum(np.abs(points[:, 0] - lift) - thick, q.max(axis=1)).astype(np.float32)

    return distance


def polyhedron(rng: np.random.Generator, size: float) -> Solid:
    normals = rng.normal(size=(int(rng.integers(5, 14)), 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    reach = size * rng.uniform(0.5, 1.0, len(normals))
    # Six more keep it bounded.
    normals = np.concatenate([normals, np.eye(3), -np.eye(3)]).astype(np.float32)
    reach = np.concatenate([reach, np.full(6, 1.2 * size)]).astype(np.float32)

    def distance(points: Points) -> NDArray[np.float32]:
        return (points @ normals.T - reach).max(axis=1)

    return distance


# Seldom: two that touch shall rather be two.
def union(rng: np.random.Generator, size: float) -> Solid:
    one, two = (any_solid(rng, 0.7 * size) for _ in range(2))
    shift = (rng.normal(size=3) * 0.5 * size).astype(np.float32)
    return lambda points: np.minimum(one(points - shift), two(points + shift))


PLAIN = (box, box, ellipsoid, ellipsoid, cylinder, polyhedron, polyhedron)


def any_solid(rng: np.random.Generator, size: float) -> Solid:
    return PLAIN[int(rng.integers(len(PLAIN)))](rng, size)


Place = tuple[tuple[slice, ...], NDArray[np.float32]]
"""Where a solid goes, and its distances there."""


@dataclass
class _Packing:
    """Solids packed so far; where two overlap the voxel is the one's it is deeper in.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of uint16
    density, depths : (Z, Y, X) ndarray of float32
        Depths are distances to the surface of the deepest solid there, negative inside.
    count : int
    """

    labels: NDArray[np.uint16]
    density: NDArray[np.float32]
    depths: NDArray[np.float32]
    count: int = 0

    @classmethod
    def empty(cls, shape: tuple[int, int, int]) -> _Packing:
        far = np.full(shape, 1e9, np.float32)
        return cls(np.zeros(shape, np.uint16), np.zeros(shape, np.float32), far)

    def place_for(
        self, rng: np.random.Generator, solid: Solid, turn: NDArray[np.float32], size: float
    ) -> Place | None:
        """Return a place where a solid touches another: it may flatten itself a little."""
        reach = int(np.ceil(2.6 * size)) + 2
        axis = np.arange(-reach, reach + 1, 2, dtype=np.float32)
        grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
        cloud = grid[solid(grid @ turn) < 0]
        if len(cloud) < 12:
            return None
        lowest, highest = cloud.min(axis=0), cloud.max(axis=0)
        limit = np.array(self.labels.shape)
        if len(cloud) > 600:
            cloud = cloud[rng.choice(len(cloud), 600, replace=False)]
        for _ in range(80):
            center = rng.uniform(0, limit).astype(np.float32)
            cells = np.rint(cloud + center).astype(int)
            kept = ((cells >= 0) & (cells < limit)).all(axis=1)
            if kept.mean() < 0.5:
                continue
            taken = (self.labels[tuple(cells[kept].T)] > 0).mean()
            if taken < 0.16 and (taken > 0.002 or not self.count):
                break
        else:
            return None
        low = np.maximum(np.floor(center + lowest).astype(int) - 3, 0)
        high = np.minimum(np.ceil(center + highest).astype(int) + 4, limit)
        region = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
        axes = [
            np.arange(a, b, dtype=np.float32) - c for a, b, c in zip(low, high, center, strict=True)
        ]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        return region, solid(points @ turn).reshape([len(a) for a in axes]).astype(np.float32)

    def fill(self, place: Place, value: float, wall: float, filling: float) -> int:
        """Put a solid there, its wall and what is in it of such densities; return how many are."""
        region, reach = place
        self.count += 1
        inside = reach < np.minimum(self.depths[region], 0)
        self.labels[region][inside] = self.count
        self.density[region][inside] = np.where(reach > -wall, value, filling)[inside]
        self.depths[region] = np.minimum(self.depths[region], reach)
        return self.count


def packed_solids(
    seed: int, shape: tuple[int, int, int] = (104, 104, 104)
) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Return the sharp density and the labels of touching solids.

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
        Where two overlap the voxel is the one's it is deeper in, so that they meet flat.
        A shell and what it is filled with are one.
    """
    rng = np.random.default_rng(seed)
    packing = _Packing.empty(shape)
    few = np.exp(rng.uniform(np.log(150), np.log(4000), int(rng.integers(1, 6))))
    wanted = int(rng.integers(10, 50))
    for attempt in range(2 * wanted):
        size = float(np.exp(rng.uniform(np.log(7), np.log(32)))) * (1 if attempt < wanted else 0.6)
        kind = rng.random()
        make = tube if kind < 0.15 else sheet if kind < 0.3 else union if kind < 0.32 else any_solid
        solid, turn = make(rng, size), Rotation.random(random_state=rng).as_matrix()
        if rng.random() < 0.4:
            turn = np.eye(3)
        place = packing.place_for(rng, solid, turn.astype(np.float32), size)
        if place is None:
            continue
        value = rng.choice(few) * (1 if rng.random() < 0.6 else np.exp(rng.normal(0, 0.3)))
        wall = rng.uniform(1.5, 4)
        filling = value
        if rng.random() < 0.3 and make is not sheet:
            filling = 0.0 if rng.random() < 0.4 else rng.choice(few)
        if packing.fill(place, value, wall, filling) == wanted:
            break
    return packing.density.astype(np.uint16), packing.labels


def alike_solids(
    seed: int, shape: tuple[int, int, int] = (72, 72, 72)
) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Return the sharp density and the labels of a few solids that touch, alone in air.

    Parameters
    ----------
    seed : int
        Of everything random.
    shape : (int, int, int)
        Of the volume, z y x.

    Notes
    -----
    Most have one density, and half are of one shape and size, so that only how they meet tells
    that they are several.
    """
    rng = np.random.default_rng([seed, 9])
    packing = _Packing.empty(shape)
    few = np.exp(rng.uniform(np.log(200), np.log(3500), 1 if rng.random() < 0.75 else 2))
    wanted = int(rng.integers(2, 6))
    usual = float(np.exp(rng.uniform(np.log(8), np.log(22))))
    empty = rng.random() < 0.25
    alike, shape_seed = rng.random() < 0.5, int(rng.integers(1 << 30))
    for _ in range(3 * wanted):
        size = usual * float(np.exp(rng.normal(0, 0.1 if alike else 0.35)))
        same = alike and rng.random() < 0.7
        solid = any_solid(np.random.default_rng(shape_seed) if same else rng, size)
        turn = Rotation.random(random_state=rng).as_matrix() if rng.random() < 0.5 else np.eye(3)
        place = packing.place_for(rng, solid, turn.astype(np.float32), size)
        if place is None:
            continue
        value = rng.choice(few)
        if packing.fill(place, value, 3, 0 if empty else value) == wanted:
            break
    return packing.density.astype(np.uint16), packing.labels


def coat(
    seed: int,
    density: NDArray[np.uint16],
    labels: NDArray[np.uint16],
    share: float = 0.25,
    alike: float = 0.0,
) -> None:
    """Cover parts of some solids by thin things of their own: caps, bands, sleeves; in place.

    Parameters
    ----------
    seed : int
        Of everything random.
    density, labels : (Z, Y, X) ndarray of uint16
        See `packed_solids`.
    share : float
        Of the solids, about, that get one.
    alike : float
        Of the coats, about, that are nearly as dense as what they cover.
    """
    rng = np.random.default_rng([seed, 1])
    for name, box in _some(rng, labels, share):
        window = tuple(slice(max(s.start - 6, 0), s.stop + 6) for s in box)
        around = labels[window]
        own = around == name
        way = rng.normal(size=3)
        along = np.tensordot(way / np.linalg.norm(way), np.indices(around.shape), 1)
        low, high = np.quantile(along[own], np.sort(rng.uniform(0, 1, 2)))
        if rng.random() < 0.6:
            high = np.inf
        near = distance_transform_edt(~own) <= rng.uniform(1.5, 4.5)
        piece = _largest(near & (around == 0) & (along > low) & (along < high), 300)
        if piece is not None:
            around[piece] = labels.max() + 1
            density[window][piece] = _value(rng, density[window][own], alike)


def lay_flat(
    seed: int, density: NDArray[np.uint16], labels: NDArray[np.uint16], share: float = 0.4
) -> None:
    """Lay plates, slats, rods and small stacks on the flattest sides of some solids; in place.

    Parameters
    ----------
    seed : int
        Of everything random.
    density, labels : (Z, Y, X) ndarray of uint16
        See `packed_solids`.
    share : float
        Of the solids, about, that get one.

    Notes
    -----
    Half of them are nearly as dense as what they lie on, so that their shape alone tells.
    """
    rng = np.random.default_rng([seed, 2])
    for name, box in _some(rng, labels, share):
        points = np.argwhere(labels[box] == name) + [s.start for s in box]
        ways = np.concatenate([np.eye(3), -np.eye(3), rng.normal(size=(12, 3))])
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        heights = points @ ways.T
        tops = heights.max(axis=0)
        side = int((heights > tops - 2).sum(axis=0).argmax())
        touched = points[heights[:, side] > tops[side] - 2]
        value = _value(rng, density[tuple(touched.T)], 0.5)
        center = touched[rng.integers(len(touched))]
        frame = np.linalg.qr(np.stack([ways[side], *rng.normal(size=(2, 3))], axis=1))[0][:, 1:]
        layers = 1 if rng.random() < 0.75 else int(rng.integers(2, 5))
        thick = np.exp(rng.uniform(np.log(1.5), np.log(10 if layers == 1 else 4)))
        half = np.exp(rng.uniform(np.log(3), np.log(28), 2))
        # The lowest fills the gap that a rounded side leaves.
        floor = tops[side] - 1
        for layer in range(layers):
            ceiling = tops[side] + 0.5 + (layer + 1) * thick
            _lay(labels, density, ways[side], frame, center, (floor, ceiling), half, value)
            floor = ceiling


def _lay(
    labels: NDArray[np.uint16],
    density: NDArray[np.uint16],
    up: NDArray[np.float64],
    frame: NDArray[np.float64],
    center: NDArray[np.int64],
    heights: tuple[float, float],
    half: NDArray[np.float64],
    value: float,
) -> None:
    """Fill what is free of a slab by a new object, unless that is very little."""
    reach = int(np.ceil(np.hypot(*half) + heights[1] - heights[0])) + 12
    low, high = np.maximum(center - reach, 0), np.minimum(center + reach + 1, labels.shape)
    region = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    grid = np.moveaxis(np.indices(labels[region].shape), 0, -1) + low
    along, across = grid @ up, np.abs((grid - center) @ frame)
    free = (along > heights[0]) & (along <= heights[1]) & (across <= half).all(axis=-1)
    piece = _largest(free & (labels[region] == 0), 150)
    if piece is not None:
        labels[region][piece] = labels.max() + 1
        density[region][piece] = value


def _some(
    rng: np.random.Generator, labels: NDArray[np.uint16], share: float
) -> Iterator[tuple[int, tuple[slice, ...]]]:
    """Yield about so many of the objects, each with its box."""
    boxes = find_objects(labels)
    for i in np.flatnonzero(rng.random(len(boxes)) < share):
        if boxes[i] is not None:
            yield int(i) + 1, boxes[i]


def _largest(free: NDArray[np.bool_], least: int) -> NDArray[np.bool_] | None:
    """Return the largest connected piece, None where it has fewer voxels than that."""
    pieces, _ = label(free)
    sizes = np.bincount(pieces.reshape(-1))[1:]
    return pieces == 1 + sizes.argmax() if sizes.max(initial=0) >= least else None


def _value(rng: np.random.Generator, under: NDArray[np.uint16], alike: float) -> float:
    """Return a density for what lies on others, at times nearly that of what is under it."""
    value = float(np.exp(rng.uniform(np.log(200), np.log(3000))))
    if alike and rng.random() < alike:
        value = max(float(np.median(under)), 150.0) * float(np.exp(rng.normal(0, 0.12)))
    return value
