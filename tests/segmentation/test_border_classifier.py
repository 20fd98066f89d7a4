from itertools import pairwise

import numpy as np
import pytest
from phantoms import box, scanned

from napari_unpack import tasks
from napari_unpack.segmentation.common.density_regions import DensityScale
from napari_unpack.segmentation.learned import border_refinement
from napari_unpack.segmentation.learned.border_classifier import (
    BORDER_FEATURES,
    HOLD,
    BorderEvidence,
    describe,
    draw_borders,
    find_rivals,
)
from napari_unpack.segmentation.learned.border_refinement import Borders, sharpen_borders
from napari_unpack.segmentation.learned.pair_classifier import PairClassifier

SHAPE = (20, 20, 40)
SCALE = DensityScale(0.0, 200.0)
TWO = {1: 500.0, 2: 1500.0}


def side_by_side(border):
    labels = np.zeros(SHAPE, np.int32)
    labels[box(SHAPE, (4, 4, 4), (16, 16, border))] = 1
    labels[box(SHAPE, (4, 4, border), (16, 16, 36))] = 2
    return labels


def said(labels, across=150, within=235):
    """Return a network that sees every border of labels a little."""
    following = np.zeros((3, *labels.shape), np.uint8)
    for axis in range(3):
        same = np.roll(labels, -1, axis) == labels
        following[axis] = np.where(same, within, across)
    return following


def scene_of(labels, density, following=None):
    unsure = np.full((3, *labels.shape), 128, np.uint8)
    return BorderEvidence.of(
        labels, density, SCALE, unsure if following is None else following, 20.0
    )


def judge_of(**gains):
    """Return a classifier that adds up features."""
    width = len(BORDER_FEATURES)
    eye = np.zeros((width, 1))
    for name, gain in gains.items():
        eye[BORDER_FEATURES.index(name)] = gain
    # Small into the hyperbolic tangents and large out of them, which leaves them straight.
    layers = (eye * 1e-3, np.ones((1, 1)) * 1e-3, np.ones((1, 1)) * 1e6)
    nothing = (np.zeros(1), np.zeros(1), np.zeros(1))
    return PairClassifier(np.zeros(width), np.ones(width), layers, nothing, BORDER_FEATURES)


def random_judge(seed):
    generator = np.random.default_rng(seed)
    widths = (len(BORDER_FEATURES), 7, 5, 1)
    layers = tuple(generator.normal(size=shape) for shape in pairwise(widths))
    layers = (*layers[:2], 4 * layers[2])
    offsets = tuple(generator.normal(size=n) for n in widths[1:])
    center = generator.normal(size=widths[0]) / 4
    return PairClassifier(center, np.ones(widths[0]) / 2, layers, offsets, BORDER_FEATURES)


def rows_at(labels, evidence, place):
    places = np.array([place])
    inside = Borders.of(labels).inside
    names, counts, _ = find_rivals(labels, places)
    if counts[0] == 1:
        return names[0, :1], np.zeros((1, len(BORDER_FEATURES)))
    rows = describe(labels, inside, evidence, places, names, counts)
    return names[0, : counts[0]], rows.astype(np.float64)


def column(rows, name):
    return rows[:, BORDER_FEATURES.index(name)]


def test_what_tells_about_the_two_labels_of_a_flat_border():
    labels = side_by_side(20)
    density = scanned(labels, TWO, blur=0.0, noise=0.0)
    names, rows = rows_at(labels, scene_of(labels, density), (10, 10, 19))
    assert names.tolist() == [1, 2]
    assert column(rows, "holds").tolist() == [1, 0]
    assert column(rows, "faces").tolist() == [5, 1]
    assert column(rows, "rival_faces").tolist() == [1, 5]
    np.testing.assert_allclose(column(rows, "said"), [5 * 128 / 255, 128 / 255], rtol=1e-6)
    # Two of five planes of 25, three of seven planes of 49, but for the voxel itself.
    np.testing.assert_allclose(column(rows, "farther"), [74 / 124, 50 / 124], rtol=1e-6)
    np.testing.assert_allclose(column(rows, "farthest"), [195 / 342, 147 / 342], rtol=1e-6)
    # One face, four edges and four corners lie beyond.
    beyond = 1 + 4 / np.sqrt(2) + 4 / np.sqrt(3)
    np.testing.assert_allclose(column(rows, "near")[1], beyond, rtol=1e-6)
    np.testing.assert_allclose(column(rows, "nearer_of_step"), [1, -1], rtol=1e-2)
    np.testing.assert_allclose(column(rows, "of_mean"), [1, 500 / 1500], rtol=1e-2)
    assert column(rows, "likelier")[0] > 3
    np.testing.assert_allclose(
        column(rows, "log_larger"), [0, 0], atol=1e-6, err_msg="both are 2304 voxels"
    )
    assert (column(rows, "air_farthest") == 0).all()


def test_what_tells_at_a_corner_of_three_labels_and_air():
    labels = np.zeros((9, 9, 9), np.int32)
    labels[:, :5, :4], labels[:, :5, 4:], labels[:, 5, :] = 1, 2, 3
    density = np.array([0.0, 100.0, 400.0, 1000.0])[labels]
    density[4, 4, 4] = 310.0
    density[3, 3, 3] = np.inf
    following = np.zeros((3, 9, 9, 9), np.uint8)
    # Along x before and after, along y after: to labels 1, 2 and 3.
    following[2, 4, 4, 3], following[2, 4, 4, 4], following[1, 4, 4, 4] = 51, 102, 204
    names, rows = rows_at(labels, scene_of(labels, density, following), (4, 4, 4))
    assert names.tolist() == [2, 1, 3]
    assert column(rows, "faces").tolist() == [4, 1, 1]
    np.testing.assert_allclose(column(rows, "said"), [0.4, 0.2, 0.8], rtol=1e-6)
    # Within two: rows 2 to 4 of label 2 and 1, row 5 of label 3, row 6 is air.
    wanted = np.array([5 * 3 * 3 - 1, 5 * 3 * 2, 5 * 5]) / 124
    np.testing.assert_allclose(column(rows, "farther"), wanted, rtol=1e-6)
    # The rival of 1 and 3 is 2, and that of 2 is 1.
    np.testing.assert_allclose(column(rows, "rival_farther"), wanted[[1, 0, 0]], rtol=1e-6)
    assert (column(rows, "air_near") == 0).all()
    np.testing.assert_allclose(column(rows, "air_farthest"), 2 * 49 / 342, rtol=1e-6)
    # Label 3 is too thin to have an inside, so its whole mean counts for it too; 2 is 400 all over.
    np.testing.assert_allclose(column(rows, "of_mean")[[0, 2]], [310 / 400, 0.31], rtol=5e-2)
    assert column(rows, "nearer")[0] > 0 > column(rows, "nearer")[1]
    assert column(rows, "step")[0] > 0 > column(rows, "step")[1]
    assert column(rows, "step")[2] > 0
    sizes = np.array([9 * 5 * 5, 9 * 5 * 4, 9 * 9])
    larger = np.log(sizes / sizes[[1, 0, 0]])
    np.testing.assert_allclose(column(rows, "log_larger"), larger, rtol=1e-5)


@pytest.mark.parametrize("border", [16, 24])
def test_a_border_moves_to_the_step_of_density_and_a_voxel_a_round(border):
    truth, found = side_by_side(20), side_by_side(border)
    given = found.copy()
    evidence = scene_of(found, scanned(truth, TWO, blur=0.0, noise=0.0))
    likelier = judge_of(likelier=1.0)
    one = draw_borders(found, evidence, likelier, rounds=1)
    np.testing.assert_array_equal(one, side_by_side(border + (1 if border < 20 else -1)))
    np.testing.assert_array_equal(draw_borders(found, evidence, likelier), truth)
    np.testing.assert_array_equal(found, given)


def test_who_holds_a_voxel_keeps_it_in_doubt():
    found = side_by_side(20)
    evidence = scene_of(found, scanned(found, {1: 800.0, 2: 800.0}, noise=0.0))
    against = judge_of(holds=-0.9 * HOLD)
    np.testing.assert_array_equal(draw_borders(found, evidence, against), found)
    assert (draw_borders(found, evidence, judge_of(holds=-1.1 * HOLD), rounds=1) != found).any()


@pytest.mark.parametrize("seed", range(4))
def test_every_voxel_goes_to_the_label_that_the_classifier_takes_for_likeliest(seed):
    generator = np.random.default_rng(seed)
    coarse = generator.integers(0, 4, (4, 4, 5)).astype(np.int32)
    labels = np.kron(coarse, np.ones((3, 3, 3), np.int32))
    density = scanned(labels, {1: 400.0, 2: 900.0, 3: 6000.0}).astype(np.float32)
    density[1, 2, 3], density[7, 7, 7] = np.nan, np.inf
    following = generator.integers(0, 256, (3, *labels.shape)).astype(np.uint8)
    evidence, classifier = scene_of(labels, density, following), random_judge(seed)

    wanted = labels.copy()
    for place in np.argwhere(labels > 0).tolist():
        names, rows = rows_at(labels, evidence, place)
        if len(names) > 1:
            chance = classifier.probability(rows)
            logits = np.log(chance / (1 - chance))
            logits[0] += HOLD
            # Only across a face may a voxel change hands.
            logits[1:][column(rows, "faces")[1:] == 0] = -np.inf
            wanted[tuple(place)] = names[logits.argmax()]

    drawn = draw_borders(labels, evidence, classifier, rounds=1)
    assert (wanted != labels).sum() > 20
    np.testing.assert_array_equal(drawn, wanted)
    np.testing.assert_array_equal(drawn > 0, labels > 0)


def test_looking_again_only_near_what_changed_gives_the_same():
    generator = np.random.default_rng(5)
    coarse = generator.integers(0, 5, (4, 4, 8)).astype(np.int32)
    labels = np.kron(coarse, np.ones((5, 5, 5), np.int32))
    density = scanned(labels, {1: 400.0, 2: 900.0, 3: 6000.0, 4: 950.0})
    evidence, classifier = scene_of(labels, density), random_judge(2)
    step = labels
    for _ in range(5):
        step = draw_borders(step, evidence, classifier, rounds=1)
    np.testing.assert_array_equal(draw_borders(labels, evidence, classifier, rounds=5), step)


def test_a_thin_plate_gets_back_what_the_box_below_it_took():
    shape = (40, 40, 40)
    truth = np.zeros(shape, np.int32)
    truth[box(shape, (18, 6, 6), (34, 34, 34))] = 1
    truth[box(shape, (14, 4, 4), (18, 36, 36))] = 2
    density = scanned(truth, {1: 480.0, 2: 1000.0}, blur=0.7)
    found = truth.copy()
    found[14:18, 20:28, 8:24] = 1
    mended = draw_borders(found, scene_of(found, density, said(truth)))
    assert (mended != truth).sum() < 0.15 * (found != truth).sum()


@pytest.mark.parametrize("bump", [True, False])
def test_the_network_decides_on_a_bump_between_two_of_one_density(bump):
    flat = side_by_side(20)
    bumped = flat.copy()
    bumped[8:12, 8:12, 18:20] = 2
    density = scanned(flat, {1: 800.0, 2: 800.0})
    network = said(bumped if bump else flat, across=60)
    drawn = draw_borders(bumped, scene_of(bumped, density, network))
    assert (drawn[8:12, 8:12, 18:20] == (2 if bump else 1)).mean() > 0.9


@pytest.mark.parametrize("other", [500.0, 550.0, 900.0, 4000.0])
def test_a_border_that_lies_right_stays(other):
    truth = side_by_side(20)
    truth[box(SHAPE, (8, 8, 8), (14, 14, 16))] = 3
    density = scanned(truth, {1: 500.0, 2: other, 3: 1200.0})
    kept = draw_borders(truth, scene_of(truth, density, said(truth)))
    assert (kept != truth).sum() < 0.03 * (6 * 8 * 8)


def test_where_nothing_touches_nothing_moves():
    alone = np.where(side_by_side(20) == 1, 1, 0).astype(np.int32)
    evidence = scene_of(alone, scanned(alone, {1: 800.0}))
    np.testing.assert_array_equal(draw_borders(alone, evidence), alone)
    empty = np.zeros_like(alone)
    nothing = scene_of(empty, np.zeros(SHAPE))
    np.testing.assert_array_equal(draw_borders(empty, nothing), empty)


def packed_cells(seed, shape=(24, 22, 20)):
    """Return cells that fill a volume but for some air, and noisy densities of them."""
    rng = np.random.default_rng(seed)
    middles = rng.uniform(0, shape, (12, 3))
    grid = np.stack(np.indices(shape), axis=-1)
    labels = np.linalg.norm(grid[..., None, :] - middles, axis=-1).argmin(axis=-1)
    labels = labels.astype(np.int32)
    density = rng.integers(200, 1200, 12)[labels] * (labels > 0) + rng.normal(0, 200, shape)
    following = rng.integers(0, 256, (3, *shape)).astype(np.uint8)
    return labels, density.astype(np.float32), following


@pytest.mark.parametrize("seed", range(2))
def test_borders_are_those_of_voxels_looked_at_one_by_one(seed, monkeypatch):
    # Slabs of three slices: their seams must not show.
    monkeypatch.setattr(tasks, "VOXELS_PER_CHECK", 3 * 22 * 20)
    labels, _, _ = packed_cells(seed)
    found = Borders.of(labels)
    for place in np.ndindex(labels.shape):
        here, others = labels[place], []
        for axis in range(3):
            for step in (-1, 1):
                beside = list(place)
                beside[axis] += step
                if 0 <= beside[axis] < labels.shape[axis]:
                    others.append(labels[tuple(beside)])
        assert found.inside[place] == (here > 0 and all(o == here for o in others))
        assert found.touching[place] == (here > 0 and any(o not in (0, here) for o in others))


@pytest.mark.parametrize("seed", range(4))
def test_what_is_looked_at_again_is_all_that_can_move(seed, monkeypatch):
    # One round at a time looks at every voxel; several in a row only near what has moved.
    labels, density, following = packed_cells(seed)
    evidence = BorderEvidence.of(labels, density, DensityScale(0.0, 200.0), following, 40.0)
    judge = random_judge(seed)
    apart, moved = labels, []
    for _ in range(3):
        before, apart = apart, draw_borders(apart, evidence, judge, rounds=1)
        moved.append(np.count_nonzero(apart != before))
    monkeypatch.setattr(tasks, "VOXELS_PER_CHECK", 3 * 22 * 20)
    monkeypatch.setattr(border_refinement, "AT_ONCE", 50)
    np.testing.assert_array_equal(draw_borders(labels, evidence, judge, rounds=3), apart)
    assert moved[2] > 0

    sharp, moved = labels, []
    for _ in range(3):
        before = sharp
        sharp = sharpen_borders(sharp, density, 0.0, following, 40.0, rounds=1, smoothing=0)
        moved.append(np.count_nonzero(sharp != before))
    again = sharpen_borders(labels, density, 0.0, following, 40.0, rounds=3, smoothing=0)
    np.testing.assert_array_equal(again, sharp)
    assert moved[2] > 0
