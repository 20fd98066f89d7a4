"""The paper's second method, one pass with atomic counters, against the CPU ray caster."""

import numpy as np
import pytest

from napari_unpack.geometry.rays import cast_rays, voxel_from_world
from napari_unpack.geometry.view import View
from napari_unpack.rendering import cpu
from napari_unpack.rendering.gl import backend as gl_backend
from napari_unpack.rendering.gl import compute_program
from napari_unpack.rendering.gl.occlusion_atomics import RayTooCrowdedError

COUNTERS = ("samples", "hits", "occluded_hits", "occluded_samples", "exact_samples")


@pytest.mark.parametrize("seed", range(8))
def test_one_pass_counts_what_the_cpu_counts(compute, seed):
    # None of these views has a sample within float32's reach of a voxel face (test_parity.py).
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
    found = gl_backend.counts_by_atomics(labels, rays, visible, bricks)
    np.testing.assert_array_equal(found.ids, wanted.ids)
    np.testing.assert_array_equal(found.blocks, wanted.blocks)
    for name in COUNTERS:
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name), name)


def crowd():
    """120 plates of 120 objects along z, and rays through all of them."""
    labels = np.repeat(np.arange(1, 121, dtype=np.uint16), 16).reshape(120, 4, 4)
    camera = View(direction=(1, 0, 0), height=4.0).camera(labels.shape, (1, 1, 1))
    visible = np.ones(121, bool)
    visible[0] = False
    return labels, cast_rays(camera, (4, 4), voxel_from_world((1, 1, 1)), 0.5), visible


def test_where_a_ray_meets_more_objects_than_it_remembers_the_cpu_counts(compute):
    labels, rays, visible = crowd()
    with pytest.raises(RayTooCrowdedError):
        gl_backend.counts_by_atomics(labels, rays, visible)
    found = gl_backend.occlusion_counts(labels, rays, visible)
    assert found.hits[1:].tolist() == [16] * 120
    # Plate 1 blocks all others, the last one no object.
    assert found.blocks.sum(axis=1).tolist() == list(range(119, -1, -1))


def test_the_pass_compiles(compute):
    assert "u_objects" in compute_program.computed("count_occluded.comp")
