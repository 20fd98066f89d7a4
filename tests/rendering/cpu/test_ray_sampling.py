"""Where a tile's rays enter and leave, together, against each alone."""

from __future__ import annotations

import numpy as np
import pytest
from ray_scenes import VIEWS, along

from napari_unpack.rendering.casting import off_faces
from napari_unpack.rendering.cpu.ray_sampling import (
    clipping_planes,
    enter_tile,
    ray_numbers,
    ray_of,
    sample_range,
)

SHAPE = (21, 30, 17)


@pytest.mark.parametrize(
    ("direction", "spacing", "fov"),
    [*VIEWS, ((0, 0, 1), (1, 1, 1), 0), ((0, -1, 0), (1, 1, 1), 0), ((1, 1, 0), (1, 1, 1), 0)],
)
@pytest.mark.parametrize("cut", [False, True])
@pytest.mark.parametrize("low", [(0, 0, 0), (4, 3, 5)])
def test_each_has_the_samples_it_has_alone(direction, spacing, fov, cut, low) -> None:
    planes = clipping_planes([[[8, 9, 7], [1, 0.5, 0.2]]] if cut else None)
    box = np.array([low, SHAPE])
    plain = along(direction, SHAPE, spacing, (40, 45), fov, step=0.7)
    for rays in (plain, off_faces(plain)):
        numbers = ray_numbers(rays)
        expected = []
        for left, right in ((0, 32), (32, 45)):
            for row, col in np.ndindex(40, right - left):
                ray = ray_of(numbers[0], float(row), float(left + col))
                k, end = sample_range(box, planes, *numbers[1:], 0.5, *ray)
                if k < end:
                    expected.append((row, left + col, k, end))
        found = []
        for left, right in ((0, 32), (32, 45)):
            out = np.zeros((40 * 32, 4), np.int64)
            many = enter_tile(box, planes, *numbers, 0, 40, left, right, out)
            found += [tuple(ray) for ray in out[:many].tolist()]
        assert found == expected
        assert len(found) > 100
