"""Containers: a wall and what fills it are one thing to a hand."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError

from napari_unpack.segmentation.common.convex_hull import hull_volume, support_points
from napari_unpack.segmentation.learned.pair_classifier import Parts


def join_containers(
    parts: Parts,
    owner: NDArray[np.int64],
    walled: float = 0.45,
    patch: float = 0.04,
    thinner: float = 0.75,
    denser: float = 0.12,
    room: float = 3.0,
) -> NDArray[np.int64]:
    """Join walls with their filling.

    Parameters
    ----------
    parts : Parts
        Measurements; changed by the joins.
    owner : (M,) ndarray of int64
        For every label the label it belongs to.
    walled : float
        A filling has at least this share of its surface on walls; the rest may be air.
    patch : float
        A piece of wall covers at least this share of the filling.
    thinner : float
        A wall is at most this much as thick as its filling.
    denser : float
        Its log density lies above the filling's by this.
    room : float
        Walls and filling have a convex hull of at most so many times the filling's: a half full
        bottle, but not a table with a soap on it.

    Returns
    -------
    (M,) ndarray of int64
        New owners.

    Notes
    -----
    Noise and streaks leave a wall in several pieces. Those that touch the filling are found by
    their contact, the others, around the air above a liquid, by lying within the hull of the
    container. Quadratic in the parts.
    """
    owner = owner.copy()
    voxels = np.maximum(parts.sums[:, 0], 1)
    thickness = 4 * parts.sums[:, 3] / voxels
    density = parts.sums[:, 1] / voxels
    for filling in np.argsort(-parts.sums[:, 0], kind="stable").tolist():
        if parts.sums[filling, 0] == 0:
            continue
        touched = parts.area[filling] / (parts.area[filling].sum() + parts.sums[filling, 4])
        wall = (touched >= patch) & (thickness <= thinner * thickness[filling])
        wall &= (density >= density[filling] + denser) & (parts.sums[:, 0] > 0)
        names = np.flatnonzero(wall)
        if touched[names].sum() < walled:
            continue
        corners = support_points(np.concatenate([parts.hulls[k] for k in (filling, *names)]))
        if hull_volume(corners) > room * parts.hull_volumes[filling]:
            continue
        inside = _inside(parts, corners, filling, thickness <= thinner * thickness[filling])
        level = float(density[names].min())
        for name in sorted({*names.tolist(), *inside}):
            parts.join(filling, name)
            owner[owner == name] = filling
        for name in _continuations(parts, filling, density >= level - denser):
            parts.join(filling, name)
            owner[owner == name] = filling
    return owner


def _continuations(
    parts: Parts, container: int, dense: NDArray[np.bool_], touch: float = 0.08, growth: float = 1.2
) -> list[int]:
    """Return the pieces that touch a container's walls and hardly enlarge its hull."""
    found = []
    limit = growth * parts.hull_volumes[container]
    for name in np.flatnonzero((parts.area[container] > 0) & dense).tolist():
        surface = parts.area[name].sum() + parts.sums[name, 4]
        if parts.area[container, name] < touch * surface:
            continue
        if parts.sums[name, 0] > 0.5 * parts.sums[container, 0]:
            continue
        corners = support_points(np.concatenate([parts.hulls[container], parts.hulls[name]]))
        if hull_volume(corners) <= limit:
            found.append(name)
    return found


def _inside(
    parts: Parts, corners: NDArray[np.float64], filling: int, thin: NDArray[np.bool_]
) -> list[int]:
    """Return the thin parts that lie within a hull, but for a tenth of their corners."""
    try:
        hull = Delaunay(corners)
    except QhullError:
        return []
    low, high = corners.min(axis=0), corners.max(axis=0)
    found = []
    for name in np.flatnonzero((parts.sums[:, 0] > 0) & thin).tolist():
        points = parts.hulls[name]
        if name == filling or (points.mean(axis=0) < low).any() or (points.mean(0) > high).any():
            continue
        if (hull.find_simplex(points) >= 0).mean() >= 0.9:
            found.append(name)
    return found
