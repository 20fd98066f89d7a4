"""Opacities of a step against the power itself, for every ray of an image."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unpack.geometry.rays import cast_rays, voxel_from_world
from napari_unpack.geometry.view import View
from napari_unpack.rendering.cpu.compositing import MOST_LENGTHS, correction, family_of

SPACING = (1.0, 0.5, 2.0)


@pytest.mark.parametrize("fov", [0.0, 20.0, 60.0, 120.0])
@pytest.mark.parametrize("longest", [1.0, 3.0, 10.0])
@pytest.mark.parametrize("size", [(1, 1), (33, 5), (1, 40), (24, 31)])
def test_every_ray_has_a_table_for_the_length_of_its_steps(fov, longest, size) -> None:
    rng = np.random.default_rng(4)
    for _ in range(4):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        stretch = turn @ np.diag([longest**0.5, 1, longest**-0.5]) @ turn.T
        camera = View(tuple(rng.normal(size=3)), fov=fov).camera((50, 50, 50), SPACING, stretch)
        rays = cast_rays(camera, size, voxel_from_world(SPACING), 0.7)
        # Of the left half, as where a window is cast.
        rays = rays.window(0, 0, (size[0], -(-size[1] // 2)))
        exponents, table = correction(rays, SPACING)
        assert 1 <= len(exponents) <= MOST_LENGTHS
        assert len(table) == len(exponents)
        pixels = np.moveaxis(np.indices(rays.size), 0, -1).reshape(-1, 2)
        steps = np.insert(pixels, 0, 1, axis=1) @ rays.table[3:] * SPACING * rays.step
        lengths = np.linalg.norm(steps, axis=1) / min(SPACING)
        # Half as far as the tables are apart, which is a thousandth where they suffice.
        apart = max(1e-3, np.log(lengths.max() / lengths.min()) / (MOST_LENGTHS - 1)) / 2
        mine = np.array([int(family_of(length, exponents)) for length in lengths])
        np.testing.assert_allclose(exponents[mine], lengths, rtol=1.02 * apart)
        np.testing.assert_allclose(table[mine, 512], 1 - 0.75**lengths, rtol=2 * apart)
