"""Bags whose rays meet many short runs, and the comparison of what is counted along them."""

from __future__ import annotations

from typing import Any

import numpy as np

from napari_unpack.geometry.rays import cast_rays, voxel_from_world
from napari_unpack.geometry.view import View
from napari_unpack.rendering import cpu
from napari_unpack.rendering.gl import backend as gl_backend

COUNTERS = ("samples", "hits", "occluded_hits", "occluded_samples", "exact_samples")


def assert_counted_as_by_the_cpu(seed: int, **how: Any) -> None:
    """Compare occlusion counts of a random bag of blocks of two voxels, exactly.

    Rays meet far more runs than the six of one pass. None of the views of seeds 0 to 7 has a
    sample within float32's reach of a voxel face (test_parity.py).
    """
    rng = np.random.default_rng(seed)
    shape, spacing = (14, 17, 20), (1.3, 1.0, 0.8) if seed % 2 else (1.0, 1.0, 1.0)
    labels = rng.integers(0, 8, (7, 9, 10)).repeat(2, 0).repeat(2, 1).repeat(2, 2)
    labels = np.ascontiguousarray(labels[:14, :17, :20]).astype(np.uint16) * 30
    visible = np.zeros(211, bool)
    visible[[30, 60, 90, 150, 210]] = True
    camera = View(direction=tuple(rng.normal(size=3))).camera(shape, spacing)
    rays = cast_rays(camera, (24, 26), voxel_from_world(spacing), 0.61)
    wanted = cpu.occlusion_counts(labels, rays, visible)
    bricks = cpu.Bricks.of(labels) if seed % 3 else None
    found = gl_backend.occlusion_counts(labels, rays, visible, bricks, **how)
    np.testing.assert_array_equal(found.ids, wanted.ids)
    np.testing.assert_array_equal(found.blocks, wanted.blocks)
    for name in COUNTERS:
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name), name)
