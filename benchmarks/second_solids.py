"""Bodies of the second generator: superquadrics, bent tubes, polyhedra, shells and plates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Field = NDArray[np.float32]
RANGES = {
    "soft": (180.0, 700.0),
    "plastic": (620.0, 1400.0),
    "liquid": (760.0, 1250.0),
    "mineral": (1100.0, 3000.0),
    "metal": (2600.0, 9000.0),
}
"""CT numbers + 1000; neighbouring ranges overlap, and no two bodies share a value."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A body in its window.

    Parameters
    ----------
    mask : (z, y, x) ndarray of bool
        The body, hollow included.
    filling : (z, y, x) ndarray of float32
        CT number + 1000 inside the mask.
    kind, group : str
        Family, and bulk, sheet, liquid or metal.
    density : float
        Of what it is made of.
    soft : bool
        Whether others may dent it.
    """

    mask: NDArray[np.bool_]
    filling: Field
    kind: str
    group: str
    density: float
    soft: bool


def draw_solid(rng: np.random.Generator, scale: float) -> Solid:
    """Draw a body.

    Parameters
    ----------
    rng : numpy.random.Generator
    scale : float
        1 for radii of 9 to 20 voxels.
    """
    kinds = ("superquadric", "tube", "polyhedron", "shell", "plate")
    kind = str(rng.choice(kinds, p=(0.3, 0.16, 0.24, 0.18, 0.12)))
    if kind == "shell":
        return _shell(rng, scale)
    mask = _cropped(_MAKERS[kind](rng, scale) <= 1)
    share = {"superquadric": 0.06, "tube": 0.3, "polyhedron": 0.15, "plate": 0.1}[kind]
    metal = bool(rng.random() < share)
    names = ("metal",) if metal else ("soft", "plastic", "mineral")
    value = float(rng.uniform(*RANGES[str(rng.choice(names))]))
    group = "sheet" if kind == "plate" else "metal" if metal else "bulk"
    soft = kind != "plate" and value < 1500
    return Solid(mask, _textured(mask.shape, value, rng), kind, group, value, soft)


def _shell(rng: np.random.Generator, scale: float) -> Solid:
    maker = _superquadric if rng.random() < 0.6 else _polyhedron
    mask = _cropped(maker(rng, 1.15 * scale) <= 1)
    depth = ndimage.distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1, 1:-1]
    wall = rng.uniform(2.0, 4.0)
    value = float(rng.uniform(*RANGES[str(rng.choice(["plastic", "mineral"]))]))
    filling = np.full(mask.shape, value, np.float32)
    hollow = mask & (depth > wall)
    filling[hollow] = 0
    content = str(rng.choice(["air", "liquid", "piece", "grain"]))
    if content in ("liquid", "grain") and hollow.any():
        heights = np.nonzero(hollow)[1]
        full = np.indices(mask.shape)[1] >= np.quantile(heights, rng.uniform(0.1, 0.6))
        inside = float(rng.uniform(*RANGES["liquid" if content == "liquid" else "soft"]))
        rough = 0.02 if content == "liquid" else 0.12
        stuff = _textured(mask.shape, inside, rng, rough)
        filling[hollow & full] = stuff[hollow & full]
    elif content == "piece":
        filling[depth > max(0.55 * depth.max(), wall + 1)] = rng.uniform(500, 3000)
    group = "liquid" if content == "liquid" else "bulk"
    return Solid(mask, filling, "shell", group, value, False)


def _turned(rng: np.random.Generator, half: float) -> Field:
    """Return the coordinates of a cube's voxels in a randomly turned frame, (3, n, n, n)."""
    n = int(np.ceil(half))
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    if rng.random() < 0.35:
        turn = np.eye(3)[rng.permutation(3)]
    grid = np.indices((2 * n + 1,) * 3, dtype=np.float32) - n
    return np.asarray(np.tensordot(turn.astype(np.float32), grid, 1))


def _superquadric(rng: np.random.Generator, scale: float) -> Field:
    radii = rng.uniform(8, 20, 3) * scale
    round_along, round_across = rng.choice([0.25, 0.5, 0.8, 1.0, 1.3], 2)
    w, v, u = np.abs(_turned(rng, 1.05 * np.linalg.norm(radii))) / radii[:, None, None, None]
    across = (u ** (2 / round_across) + v ** (2 / round_across)) ** (round_across / round_along)
    return np.asarray(across + w ** (2 / round_along))


def _polyhedron(rng: np.random.Generator, scale: float) -> Field:
    radius = rng.uniform(10, 18) * scale
    grid = _turned(rng, 1.9 * radius) * rng.uniform(0.8, 1.4, 3)[:, None, None, None]
    normals = rng.normal(size=(int(rng.integers(7, 14)), 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # Three pairs of faces keep it bounded whatever the others are.
    normals = np.concatenate([normals, np.eye(3), -np.eye(3)])
    distances = rng.uniform(0.65, 1.0, len(normals)) * radius
    values = (np.tensordot(n, grid, 1) / d for n, d in zip(normals, distances, strict=True))
    return np.asarray(np.maximum.reduce(list(values)))


def _tube(rng: np.random.Generator, scale: float) -> Field:
    """Sweep a disc along a bent curve: distances to a quadratic Bezier's points."""
    radius = rng.uniform(2.6, 6.5) * scale
    length = rng.uniform(30, 70) * scale
    bend = rng.uniform(-0.8, 0.8, 2) * length
    ends = np.array([[-length / 2, 0, 0], [0, *bend], [length / 2, 0, 0]])
    t = np.linspace(0, 1, int(length / 1.5))[:, None]
    curve = (1 - t) ** 2 * ends[0] + 2 * t * (1 - t) * ends[1] + t**2 * ends[2]
    curve -= (curve.max(axis=0) + curve.min(axis=0)) / 2
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    curve = curve @ turn
    low = np.floor(curve.min(axis=0) - radius - 1)
    size = np.ceil(curve.max(axis=0) + radius + 1) - low
    away = np.ones(tuple(size.astype(int) + 1), np.bool_)
    away[tuple(np.rint(curve - low).astype(int).T)] = False
    return np.asarray(ndimage.distance_transform_edt(away) / radius)


def _plate(rng: np.random.Generator, scale: float) -> Field:
    wide, long = rng.uniform(14, 30, 2) * scale
    thick = rng.uniform(2.2, 4.5)
    w, v, u = _turned(rng, 1.05 * np.hypot(wide, long))
    a, b = rng.uniform(-0.01, 0.01, 2)
    bent = w - a * u**2 - b * v**2
    return np.maximum.reduce([np.abs(u) / long, np.abs(v) / wide, 2 * np.abs(bent) / thick])


def _textured(
    shape: tuple[int, ...], value: float, rng: np.random.Generator, rough: float | None = None
) -> Field:
    """Return a value that wanders a little from place to place."""
    share = rng.choice([0.0, 0.03, 0.08]) if rough is None else rough
    field = ndimage.gaussian_filter(rng.standard_normal(shape, dtype=np.float32), 2.5)
    return np.asarray(value * (1 + share * field / max(field.std(), 1e-6)), np.float32)


def _cropped(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    keep = np.ix_(*(mask.any(axis=tuple({0, 1, 2} - {a})) for a in range(3)))
    return mask[keep]


_MAKERS = {
    "superquadric": _superquadric,
    "tube": _tube,
    "polyhedron": _polyhedron,
    "plate": _plate,
}
