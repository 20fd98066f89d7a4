"""Simplified surfaces have fewer triangles and stay as near as they say."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from napari_unpack.io.simplified_surfaces import simplified
from napari_unpack.io.surfaces import object_surface


def masks() -> dict[str, np.ndarray]:
    z, y, x = np.indices((26, 26, 26)) - 13
    r2 = z**2 + y**2 + x**2
    return {
        "ball": r2 < 100,
        "sheet": (z == 0) & (abs(y) < 10) & (abs(x) < 9),
        "rod": (z == 0) & (y == 0) & (abs(x) < 11),
        "voxel": r2 == 0,
        "hollow": (r2 < 144) & (r2 > 81),
    }


def spread(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return points all over a surface: 28 of each triangle."""
    shares = np.array([(i, j, 6 - i - j) for i in range(7) for j in range(7 - i)]) / 6
    return np.einsum("sk,tkd->tsd", shares, points[triangles]).reshape(-1, 3)


@pytest.mark.parametrize("cell", [1.0, 2.5])
@pytest.mark.parametrize("kind", list(masks()))
def test_no_point_of_either_surface_is_farther_from_the_other_than_is_said(
    kind: str, cell: float
) -> None:
    points, triangles = object_surface(masks()[kind])
    before = points.copy()
    fewer, left, error = simplified(points, triangles, cell)
    np.testing.assert_array_equal(points, before)
    a, b = spread(points, triangles), spread(fewer, left)
    # Between two of the points that stand for a surface: half of the widest gap of their grid.
    gaps = [
        np.linalg.norm(p[t] - p[np.roll(t, 1, 1)], axis=2).max() / 6
        for p, t in ((points, triangles), (fewer, left))
    ]
    assert cKDTree(b).query(a)[0].max() <= error + gaps[1]
    assert cKDTree(a).query(b)[0].max() <= error + gaps[0]
    # A cube's diagonal is the farthest that two of its points can be apart.
    assert 0 < error < cell * 3**0.5
    assert len(left) < len(triangles) / 2


def test_both_faces_of_a_sheet_stay() -> None:
    points, triangles = object_surface(masks()["sheet"])
    fewer, left, _ = simplified(points, triangles, 4.0)
    a, b, c = (fewer[left[:, k]] for k in range(3))
    enclosed = abs(np.einsum("ij,ij->", a, np.cross(b, c))) / 6
    # 19 x 17 voxels; with one face it would enclose nothing.
    assert enclosed == pytest.approx(19 * 17, rel=0.2)


def test_what_is_far_smaller_than_a_cell_stays() -> None:
    points, triangles = object_surface(masks()["voxel"])
    fewer, left, error = simplified(points, triangles, 100.0)
    assert len(left) >= 4
    assert cKDTree(fewer).query(points)[0].max() <= error + 1e-9
