"""Plain solids pressed together: what simulated bags are too lifelike to teach by themselves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter


def touching_solids(
    seed: int, shape: tuple[int, int, int] = (64, 72, 88)
) -> tuple[NDArray[np.uint16], NDArray[np.int32]]:
    """Return a volume of superellipsoids flattened where they meet, and their labels.

    Parameters
    ----------
    seed : int
        Of everything random.
    shape : (int, int, int)
        Of the volume, z y x, voxels of 1 mm.

    Returns
    -------
    volume : (Z, Y, X) ndarray of uint16
        Blurred, noisy density.
    labels : (Z, Y, X) ndarray of int32
        The solid each voxel is deepest in.
    """
    rng = np.random.default_rng(seed)
    grid = np.indices(shape, dtype=np.float32)
    best = np.full(shape, 1.0, np.float32)
    labels = np.zeros(shape, np.int32)
    count = int(rng.integers(2, 9))
    few = np.exp(rng.uniform(np.log(250), np.log(3500), 4))
    table = np.concatenate([[0.0], rng.choice(few, count)])
    for name in range(1, count + 1):
        radii = rng.uniform(9, 18) * rng.uniform(0.6, 1.4, 3)
        center = rng.uniform(14, np.array(shape) - 14)
        power = float(rng.choice([2.0, 2.0, 4.0, 10.0]))
        scaled = (np.abs(g - c) / r for g, c, r in zip(grid, center, radii, strict=True))
        reach = sum(s**power for s in scaled) ** (1 / power)
        nearer = reach < best
        labels[nearer], best[nearer] = name, reach[nearer]
    clean = gaussian_filter(table[labels], 0.7)
    noisy = clean + rng.normal(0, 25, shape)
    return np.clip(noisy, 0, 32000).astype(np.uint16), labels
