import numpy as np
from phantoms import ball

from napari_unpack.segmentation.common.convex_hull import hull_volume, support_points
from napari_unpack.segmentation.common.merging import absorb_fringes
from napari_unpack.segmentation.learned.pair_classifier import measure_parts
from napari_unpack.segmentation.postprocessing.containers import join_containers


def canister():
    """Return labels of a half full canister, its wall in two pieces (1, 2) around liquid (3)."""
    grid = np.indices((60, 40, 40))
    radius = np.hypot(grid[1] - 20, grid[2] - 20)
    labels = np.zeros((60, 40, 40), np.int32)
    labels[(radius <= 15) & (grid[0] >= 5) & (grid[0] < 55)] = 1
    labels[(labels == 1) & (grid[0] >= 34)] = 2
    inside = (radius <= 12) & (grid[0] >= 8) & (grid[0] < 52)
    labels[inside] = 0
    labels[inside & (grid[1] > 16)] = 3
    return labels


def measured(labels, densities):
    table = np.array(densities, np.float32)
    return measure_parts(labels, table[labels], (1.0, 1.0, 1.0))


def test_liquid_and_the_pieces_of_the_wall_around_it_are_one_object():
    parts = measured(canister(), [0, 2.5, 2.5, 1.6])
    owner = join_containers(parts, np.arange(4))
    assert owner[1] == owner[2] == owner[3]


def test_a_wall_lighter_than_what_it_holds_is_left_to_the_judge():
    parts = measured(canister(), [0, 1.0, 1.0, 1.6])
    assert join_containers(parts, np.arange(4)).tolist() == [0, 1, 2, 3]


def test_a_ball_on_a_steel_plate_is_not_in_a_container():
    labels = np.zeros((50, 60, 60), np.int32)
    labels[ball(labels.shape, (25, 30, 30), 12)] = 1
    labels[25:28] = 2
    labels[:25] = np.where(labels[:25] == 1, 1, 0)
    labels[28:] = 0
    parts = measured(labels, [0, 1.0, 2.5])
    assert join_containers(parts, np.arange(3)).tolist() == [0, 1, 2]


def test_the_support_points_of_a_box_span_it_and_those_of_a_ball_nearly():
    corners = np.array(np.meshgrid([0, 4], [0, 5], [0, 6])).reshape(3, -1).T.astype(float)
    rng = np.random.default_rng(0)
    filling = rng.uniform(0, 4, (500, 3))
    assert hull_volume(support_points(np.concatenate([filling, corners]))) == 4 * 5 * 6
    sphere = rng.normal(size=(20000, 3))
    sphere /= np.linalg.norm(sphere, axis=1)[:, None]
    few = support_points(sphere)
    assert len(few) <= 96
    assert 0.9 < hull_volume(few) / (4 / 3 * np.pi) < 1


def test_a_lace_of_voxels_joins_what_it_lies_on_and_a_sheet_does_not():
    labels = np.zeros((12, 20, 20), np.int32)
    labels[2:8] = 1
    lace = np.indices((20, 20)).sum(axis=0) % 2 == 0
    labels[8][lace] = 2
    labels[1] = 3
    density = np.array([0, 1000, 600, 600])[labels]
    found = absorb_fringes(labels, density, (1.0, 1.0, 1.0))
    assert (found[8][lace] == 1).all()
    assert (found[1] == 3).all()
    denser = np.array([0, 1000, 1600, 600])[labels]
    np.testing.assert_array_equal(absorb_fringes(labels, denser, (1.0, 1.0, 1.0)), labels)
