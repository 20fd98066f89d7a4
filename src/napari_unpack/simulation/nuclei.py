"""Nuclei of an embryo under a confocal microscope, made by code, with their truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from napari_unpack.tasks import Progress, Share, no_progress

RADIUS = 4.0
"""Of a nucleus, µm: mean of its three half axes."""

TRIES = 400
"""Places tried for each nucleus before the embryo counts as full."""

MOST_NUCLEI = 2**16 - 1
"""IDs that the labels have room for."""

CLOSEST = 0.95
"""Distance of two centres, in sums of their radii: below 1 nuclei flatten where they touch."""

HAZE, BRIGHT = 90.0, 700.0
"""Counts of the background inside the embryo, and of a bright nucleus."""

BLUR = (0.9, 0.35, 0.35)
"""Deviation of the microscope's point spread, µm, z y x: worse along its axis."""

DIMMING = 0.4
"""Share of the light that is lost on the way from the deepest slice."""


@dataclass(frozen=True, eq=False)
class Nuclei:
    """A stained embryo and what is known to be in it.

    Parameters
    ----------
    volume : (Z, Y, X) ndarray of uint16
        Counts of light.
    labels : (Z, Y, X) ndarray of uint16
        Nuclei from 1, 0 background.
    spacing : (float, float, float) of µm, z y x
    """

    volume: NDArray[np.uint16]
    labels: NDArray[np.uint16]
    spacing: tuple[float, float, float]


def simulate_nuclei(
    seed: int = 0,
    shape: Sequence[int] = (64, 128, 128),
    count: int = 60,
    spacing: Sequence[float] = (1.0, 0.5, 0.5),
    progress: Progress | None = None,
) -> Nuclei:
    """Fill an embryo with nuclei and image it.

    Parameters
    ----------
    seed : int
        The same seed gives the same embryo.
    shape : (int, int, int)
        Of the volume, z y x.
    count : int
        At most so many nuclei, from 1 to 65,535; fewer where no more find a place.
    spacing : (float, float, float) of µm, z y x
    progress : callable, optional
        Takes (fraction in [0, 1], text); raises to cancel.

    Raises
    ------
    ValueError
        If there is no room for a nucleus, or `count` or `spacing` is not as described.
    """
    if not 1 <= count <= MOST_NUCLEI:
        raise ValueError(f"count must be from 1 to {MOST_NUCLEI}, got {count!r}")
    share = Share(progress or no_progress)
    rng = np.random.default_rng(seed)
    edges = np.asarray(spacing, np.float64)
    if edges.shape != (3,) or not (np.isfinite(edges) & (edges > 0)).all():
        raise ValueError(f"spacing must be three positive numbers of µm (z, y, x), got {spacing!r}")
    size = np.asarray(shape) * edges
    centers, radii = _placed(rng, size, count)
    labels = np.zeros(tuple(shape), np.uint16)
    depth = np.full(labels.shape, 1.0, np.float32)
    light = np.zeros(labels.shape, np.float32)
    grain = gaussian_filter(rng.normal(size=labels.shape).astype(np.float32), 0.6 / edges)
    grain /= grain.std()
    growing = share.part(0.0, 0.8, "Growing nuclei")
    for k, (center, radius) in growing.over(list(enumerate(zip(centers, radii, strict=True), 1))):
        reach = 1.4 * radius
        low = np.maximum(((center - reach) / edges).astype(int), 0)
        high = np.minimum(((center + reach) / edges).astype(int) + 2, shape)
        box = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
        grid = np.moveaxis(np.mgrid[box], 0, -1) * edges - center
        axes = radius * rng.uniform(0.75, 1.25, 3)
        turned = grid @ Rotation.random(random_state=rng).as_matrix()
        far = np.linalg.norm(turned / axes, axis=-1)
        # Of two nuclei that overlap each keeps what is deeper in itself: they touch in a face.
        mine = far < depth[box]
        depth[box][mine] = far[mine]
        labels[box][mine] = k
        texture = 1.0 + 0.15 * grain[box][mine]
        light[box][mine] = rng.uniform(0.5, 1.0) * BRIGHT * texture
    share(0.85, "Imaging nuclei")
    return Nuclei(_imaged(rng, light, labels, edges), labels, tuple(edges.tolist()))


def _placed(
    rng: np.random.Generator, size: NDArray[np.float64], count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Throw centres into an ellipsoid, keep those that are far enough from all others."""
    half = size / 2.0 - 1.3 * RADIUS
    if half.min() <= 0:
        raise ValueError(f"a volume of {size.round(1).tolist()} µm holds no nucleus")
    centers, radii = np.empty((0, 3)), np.empty(0)
    for _ in range(count * TRIES):
        if len(centers) == count:
            break
        way = rng.normal(size=3)
        way *= rng.uniform() ** (1 / 3) / np.linalg.norm(way)
        center, radius = size / 2.0 + way * half, RADIUS * rng.uniform(0.85, 1.15)
        gaps = np.linalg.norm(centers - center, axis=1) - CLOSEST * (radii + radius)
        if gaps.min(initial=np.inf) > 0:
            centers, radii = np.vstack([centers, center]), np.append(radii, radius)
    return centers, radii


def _imaged(
    rng: np.random.Generator,
    light: NDArray[np.float32],
    labels: NDArray[np.uint16],
    edges: NDArray[np.float64],
) -> NDArray[np.uint16]:
    """Blur, dim and count the light as a confocal microscope does."""
    # What is not in focus: a haze around all nuclei.
    haze = HAZE * gaussian_filter((labels > 0).astype(np.float32), 3.0 * RADIUS / edges / 2.0)
    seen = gaussian_filter(light, np.asarray(BLUR) / edges) + haze + 8.0
    deep = np.linspace(1.0, 1.0 - DIMMING, len(light), dtype=np.float32)[:, None, None]
    counts = rng.poisson(seen * deep / 4.0) * 4.0 + rng.normal(20.0, 3.0, light.shape)
    return counts.clip(0, 65535).astype(np.uint16)
