"""The paper's second method, one pass with atomic counters, against the CPU ray caster."""

import numpy as np
import pytest
from crowded_bags import assert_counted_as_by_the_cpu

from napari_unpack.geometry.rays import cast_rays, voxel_from_world
from napari_unpack.geometry.view import View
from napari_unpack.rendering.gl import backend as gl_backend
from napari_unpack.rendering.gl import compute_program
from napari_unpack.rendering.gl.occlusion_atomics import RayTooCrowdedError


@pytest.mark.parametrize("seed", range(8))
def test_one_pass_counts_what_the_cpu_counts(compute, seed):
    assert_counted_as_by_the_cpu(seed, method="atomics")


def crowd():
    """120 plates of 120 objects along z, and rays through all of them."""
    labels = np.repeat(np.arange(1, 121, dtype=np.uint16), 16).reshape(120, 4, 4)
    camera = View(direction=(1, 0, 0), height=4.0).camera(labels.shape, (1, 1, 1))
    visible = np.ones(121, bool)
    visible[0] = False
    return labels, cast_rays(camera, (4, 4), voxel_from_world((1, 1, 1)), 0.5), visible


def test_a_ray_through_more_objects_than_it_remembers_goes_the_other_way(compute):
    labels, rays, visible = crowd()
    with pytest.raises(RayTooCrowdedError):
        gl_backend.occlusion_counts(labels, rays, visible, method="atomics")
    found = gl_backend.occlusion_counts(labels, rays, visible)
    assert found.hits[1:].tolist() == [16] * 120
    # Plate 1 blocks all others, the last one no object.
    assert found.blocks.sum(axis=1).tolist() == list(range(119, -1, -1))


def test_the_pass_compiles(compute):
    assert "u_objects" in compute_program.computed("count_occluded.comp")
