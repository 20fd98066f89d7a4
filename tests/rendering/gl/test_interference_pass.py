"""Interference by scatter on the graphics card, against the CPU, exactly."""

import numpy as np
import pytest

from napari_unpack.appearance import interference
from napari_unpack.rendering import interference_in
from napari_unpack.rendering.gl import backend as gl_backend


def blots(seed, layers, height=37, width=52, objects=12):
    """Layers of discs that overlap, some of one pixel, with gaps of nothing."""
    rng = np.random.default_rng(seed)
    ids = np.zeros((layers, height, width), np.int32)
    rows, cols = np.indices((height, width))
    for layer in range(layers):
        for i in rng.permutation(objects) + 1:
            row, col, radius = rng.integers(height), rng.integers(width), rng.integers(0, 9)
            ids[layer][(rows - row) ** 2 + (cols - col) ** 2 <= radius**2] = 7 * i
    return ids


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("layers", "distance"), [(1, 5), (2, 5), (3, 2.5), (2, 0), (2, 1)])
def test_scatter_finds_the_pairs_and_contact_lengths_of_the_cpu(compute, seed, layers, distance):
    ids = blots(seed, layers)
    wanted = interference(ids, distance)
    found = interference_in(ids, distance, backend="gl")
    assert list(found) == list(wanted)
    assert dict(found.edges) == {tuple(sorted(e)): d for e, d in wanted.edges.items()}


def test_it_did_run_on_gl_and_large_ids_come_back(compute):
    ids = np.array([[[0, 70_001, 70_001, 0, 5]]])
    passes = gl_backend.workspace_here().interference.passes
    graph = interference_in(ids, 2, backend="gl")
    assert gl_backend.workspace_here().interference.passes == passes + 1
    assert list(graph.edges(data="weight")) == [(5, 70_001, 2)]


def test_beyond_4096_objects_the_cpu_answers(compute):
    ids = np.arange(1, 4098).reshape(1, 17, 241)
    assert len(interference_in(ids, 1, backend="gl").edges) == 17 * 240 + 16 * 241


def test_nothing_in_view_is_an_empty_graph(compute):
    assert len(interference_in(np.zeros((1, 8, 8), int), 5, backend="gl")) == 0


def test_ids_beyond_the_whole_numbers_of_floats_stay_apart(compute):
    ids = np.zeros((1, 8, 8), np.uint64)
    ids[0, :, :3], ids[0, :, 3:6] = 2**53, 2**53 + 1
    found = interference_in(ids, 2, backend="gl")
    assert dict(found.edges) == dict(interference(ids, 2).edges)
    assert len(found.edges) == 1
