"""Small volumes and views that the ray casting tests share."""

from __future__ import annotations

import numpy as np

from napari_unpack.geometry.rays import Rays, cast_rays, voxel_from_world
from napari_unpack.geometry.view import View


def along(direction, shape, spacing=(1.0, 1.0, 1.0), size=(12, 13), fov=0.0, step=None) -> Rays:
    camera = View(direction=direction, fov=fov).camera(shape, spacing)
    return cast_rays(camera, size, voxel_from_world(spacing), step or min(spacing))


def patches(rng: np.random.Generator, shape=(11, 18, 13), objects=5) -> np.ndarray:
    """Make overlapping boxes of labels, so that objects have extent and re-enter rays."""
    labels = np.zeros(shape, np.uint16)
    for _ in range(4 * objects):
        low = rng.integers(0, np.array(shape) - 2)
        high = low + rng.integers(1, 6, 3)
        labels[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = rng.integers(
            0, objects + 1
        )
    return labels


def visible_but(hidden, size: int) -> np.ndarray:
    table = np.ones(size, bool)
    table[[0, *hidden]] = False
    return table


def ramp() -> tuple[np.ndarray, tuple[float, float]]:
    """Return a transfer function, colours and all: (table, domain)."""
    x = np.linspace(0, 1, 64)
    table = np.stack([x, 1 - x, 0.5 + x / 2, np.interp(x, [0, 0.3, 0.5, 1], [0, 0, 0.2, 0.5])], 1)
    return table.astype(np.float32), (0.0, 4000.0)


VIEWS = [
    ((0.31, -0.52, 0.87), (1.0, 1.0, 1.0), 0.0),
    ((-0.9, 0.4, 0.23), (2.0, 1.0, 0.7), 0.0),
    ((0.2, 0.7, -0.4), (1.0, 1.5, 1.0), 35.0),
]
"""(direction, spacing, field of view) of rays clear of voxel faces."""
