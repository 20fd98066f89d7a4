import numpy as np
import pytest
from benchmarks.segmentation.pair_examples import ensemble
from phantoms import ball, box, scanned

from napari_unpack.segmentation import segment
from napari_unpack.segmentation.common.density_regions import DensityScale, intersected_labels
from napari_unpack.segmentation.common.merging import absorb_small
from napari_unpack.segmentation.learned import part_splitting
from napari_unpack.segmentation.learned.boundary_network import REACHES
from napari_unpack.segmentation.learned.fragments import cells_of, measure_inner_affinities
from napari_unpack.segmentation.learned.pair_classifier import (
    PAIR_FEATURES,
    PairClassifier,
)
from napari_unpack.segmentation.learned.part_splitting import (
    PIECE_FEATURES,
    default_splitting_classifier,
    merge_pieces,
    split_and_measure,
)

SHAPE = (24, 24, 60)
SCALE = DensityScale(0.0, 200.0)


def three_in_a_row():
    """Return two objects, the first of two materials, the second like its neighbour in it."""
    truth = np.zeros(SHAPE, np.int32)
    for name, x in ((1, 4), (2, 20), (3, 36)):
        truth[box(SHAPE, (4, 4, x), (20, 20, x + 16))] = name
    objects = np.where(truth == 2, 1, truth).astype(np.int32)
    return objects, truth, scanned(truth, {1: 500.0, 2: 1500.0, 3: 1500.0})


def measured(objects, density, far=255):
    half = [n // 2 for n in density.shape]
    said = np.full((3 * len(REACHES), *half), far, np.uint8)
    return split_and_measure(objects, density, (1.0, 1.0, 1.0), SCALE, said)


def judge_of(feature, gain, bias=0.0):
    width = len(PIECE_FEATURES)
    weight = np.zeros((width, 1))
    weight[PIECE_FEATURES.index(feature)] = gain
    return PairClassifier(
        np.zeros(width), np.ones(width), (weight,), (np.array([bias]),), PIECE_FEATURES
    )


def names_in(labels, mask):
    return set(np.unique(labels[mask]).tolist())


def test_pieces_end_at_steps_of_density_and_at_objects():
    objects, truth, density = three_in_a_row()
    pieces, parts = measured(objects, density)
    assert pieces.max() == 3
    for name in (1, 2, 3):
        inner = np.zeros(SHAPE, bool)
        inner[6:18, 6:18, 4 + 16 * (name - 1) + 3 : 16 * name + 1] = True
        assert len(names_in(pieces, inner & (truth == name))) == 1
    one, two, three = (int(pieces[12, 12, x]) for x in (12, 28, 44))
    assert len({one, two, three}) == 3
    assert parts.host[[one, two, three]].tolist() == [1, 1, 3]
    assert parts.number[[one, two, three]].tolist() == [2, 2, 1]
    assert parts.whole[one] == parts.whole[two] == (objects == 1).sum()
    row = dict(zip(PIECE_FEATURES, parts.features(two, three, np.zeros(20)), strict=True))
    assert row["one_host"] == 0
    assert row["belonging"] == pytest.approx(1.0)
    assert (
        dict(zip(PIECE_FEATURES, parts.features(one, two, np.zeros(20)), strict=True))["one_host"]
        == 1
    )


def test_labels_are_parted_where_others_end():
    rng = np.random.default_rng(1)
    basins, hosts = rng.integers(0, 60, (2, 7, 8, 9)).astype(np.int32)
    keys = np.where(basins > 0, basins * 100 + hosts, 0)
    names = np.unique(keys, return_inverse=True)[1].reshape(keys.shape)
    np.testing.assert_array_equal(intersected_labels(basins, hosts), names)


def test_with_too_many_pieces_objects_stay_as_they_are(monkeypatch):
    monkeypatch.setattr(part_splitting, "MOST_PIECES", 2)
    objects, _, density = three_in_a_row()
    pieces, parts = measured(objects, density)
    np.testing.assert_array_equal(pieces, np.array([0, 1, 0, 2])[objects])
    assert parts.host.tolist() == [0, 1, 3]


def test_the_classifier_decides_which_pieces_are_one():
    objects, truth, density = three_in_a_row()
    whole = merge_pieces(*measured(objects, density), judge_of("one_host", 40.0, -20.0))
    assert len(names_in(whole, objects == 1)) == 1
    assert names_in(whole, objects == 1).isdisjoint(names_in(whole, objects == 3))
    parted = merge_pieces(*measured(objects, density), judge_of("one_host", 0.0, -20.0))
    assert len(names_in(parted, truth > 0)) == 3
    others = merge_pieces(*measured(objects, density), judge_of("density_gap", -40.0, 20.0))
    assert others[12, 12, 28] == others[12, 12, 44] != others[12, 12, 12]


def test_pieces_of_two_objects_are_joined_more_reluctantly_than_those_of_one():
    objects, truth, density = three_in_a_row()
    between = (part_splitting.MERGE_WITHIN + part_splitting.MERGE_ACROSS) / 2
    unsure = judge_of("one_host", 0.0, float(np.log(between / (1 - between))))
    joined = merge_pieces(*measured(objects, density), unsure)
    assert len(names_in(joined, truth < 3) - {0}) == 1
    assert names_in(joined, truth == 3).isdisjoint(names_in(joined, (truth > 0) & (truth < 3)))


def test_a_small_piece_stays_with_its_host_unless_it_is_metal():
    for value, stays in ((2500.0, False), (25000.0, True)):
        truth = np.ones(SHAPE, np.int32)
        truth[box(SHAPE, (8, 8, 20), (12, 14, 36))] = 2
        pieces, parts = measured(np.ones(SHAPE, np.int32), scanned(truth, {1: 500.0, 2: value}))
        parted = merge_pieces(pieces, parts, judge_of("one_host", 0.0, -20.0))
        assert (parted[10, 11, 28] != parted[2, 2, 2]) == stays


def test_a_piece_that_touches_nothing_is_not_lost():
    # The handles of scissors lie beside blades that they do not touch.
    objects = np.zeros(SHAPE, np.int32)
    objects[box(SHAPE, (4, 4, 4), (20, 20, 30))] = 1
    handle = box(SHAPE, (8, 8, 40), (16, 16, 50))
    objects[handle] = 1
    density = scanned((objects > 0).astype(np.int32), {1: 900.0})
    labels = merge_pieces(*measured(objects, density), judge_of("belonging", 0.0, 9.0))
    assert len(names_in(labels, handle) - {0}) == 1
    assert (labels[handle] > 0).all()


def test_a_committee_says_the_mean_of_its_members_before_the_logistic():
    rng = np.random.default_rng(3)
    width = len(PAIR_FEATURES)
    center, scale = rng.normal(size=width), rng.uniform(1, 2, width)

    def member():
        sizes = ((width, 5), (5, 4), (4, 1))
        return PairClassifier(
            center,
            scale,
            tuple(rng.normal(size=s) for s in sizes),
            tuple(rng.normal(size=s[1]) for s in sizes),
        )

    members = [member() for _ in range(3)]
    rows = rng.normal(size=(7, width))
    said = np.array([m.probability(rows) for m in members])
    mean = np.log(said / (1 - said)).mean(axis=0)
    np.testing.assert_allclose(ensemble(members).probability(rows), 1 / (1 + np.exp(-mean)))


def test_ties_within_are_those_of_all_pairs_of_cells():
    rng = np.random.default_rng(0)
    fragments = rng.integers(0, 3, (4, 5, 14)).astype(np.int32)
    far = rng.integers(0, 256, (3 * len(REACHES), 4, 5, 14)).astype(np.uint8)
    sums, counts = measure_inner_affinities(fragments, far)
    wanted, many = np.zeros_like(sums), np.zeros_like(counts)
    for at in np.ndindex(fragments.shape):
        for k, reach in enumerate(REACHES):
            for axis in range(3):
                to = list(at)
                to[axis] += reach
                inside = to[axis] < fragments.shape[axis] and fragments[at] > 0
                if inside and fragments[tuple(to)] == fragments[at]:
                    wanted[fragments[at], k] += far[(3 * k + axis, *at)] / 255
                    many[fragments[at], k] += 1
    np.testing.assert_allclose(sums, wanted)
    np.testing.assert_array_equal(counts, many)


def test_a_cell_is_called_what_most_of_its_labelled_voxels_are():
    labels = np.zeros((2, 2, 5), np.int32)
    labels[0, :, 0], labels[0, 0, 1], labels[1, :, 2:4] = 3, 5, 7
    labels[0, 0, 2] = 9
    assert cells_of(labels).tolist() == [[[3, 7]]]


def test_what_is_kept_is_not_absorbed_and_absorbs_nothing():
    labels = np.zeros((6, 6, 12), np.int32)
    labels[:, :, :8], labels[2:4, 2:4, 8:9], labels[2:4, 2:4, 9:10] = 1, 2, 3
    joined = absorb_small(labels, (1.0, 1.0, 1.0), 50.0)
    assert names_in(joined, labels > 0) == {1}
    kept = absorb_small(labels, (1.0, 1.0, 1.0), 50.0, np.array([False, False, True, False]))
    assert names_in(kept, labels == 2) == {2}
    assert names_in(kept, labels == 3) == {0}


def test_the_shipped_classifier_is_of_these_features():
    assert default_splitting_classifier().features == PIECE_FEATURES


def test_metal_on_a_block_and_small_metal_are_found():
    shape = (64, 64, 88)
    truth = np.zeros(shape, np.int32)
    truth[box(shape, (12, 12, 6), (52, 52, 66))] = 1
    truth[box(shape, (52, 20, 20), (55, 30, 46))] = 2
    for name, z in ((3, 16), (4, 40)):
        truth[box(shape, (z, 28, 74), (z + 6, 33, 80))] = name
    density = scanned(truth, {1: 600.0, 2: 25000.0, 3: 25000.0, 4: 700.0})
    found = segment(density).labels
    inner = [np.bincount(found[truth == name]).argmax() for name in (1, 2, 3, 4)]
    assert len({0, *inner[:3]}) == 4
    assert inner[3] == 0
    for name in (1, 2, 3):
        both = (found == inner[name - 1]) & (truth == name)
        either = (found == inner[name - 1]) | (truth == name)
        assert both.sum() > 0.9 * either.sum()


def test_a_cap_on_a_ball_is_another_object():
    shape = (64, 64, 80)
    truth = ball(shape, (32, 32, 40), 22).astype(np.int32)
    cap = ball(shape, (32, 32, 40), 25) & (np.indices(shape)[2] > 44)
    truth[cap & (truth == 0)] = 2
    found = segment(scanned(truth, {1: 1000.0, 2: 450.0})).labels
    for name in (1, 2):
        main = np.bincount(found[truth == name]).argmax()
        assert main > 0
        assert ((found == main) & (truth == name)).sum() > 0.9 * (found == main).sum()
        assert ((found == main) & (truth == name)).sum() > 0.9 * (truth == name).sum()
