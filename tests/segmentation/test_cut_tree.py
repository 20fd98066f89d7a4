import numpy as np
import pytest
from phantoms import ball, box, scanned, two_balls

from napari_unpack.segmentation import score, segment
from napari_unpack.segmentation.common.region import Region
from napari_unpack.segmentation.isoperimetric.cut_tree import (
    CutRule,
    Node,
    best_rule,
    grow_cut_tree,
    selected,
    split_recursively,
)
from napari_unpack.segmentation.isoperimetric.oracle_refinement import join_touching
from napari_unpack.tasks import Share

UNIT = (1.0, 1.0, 1.0)


def region_of(mask):
    return Region(mask, np.where(mask, 1000.0, 0.0), (0, 0, 0), UNIT)


def node(confidence, voxels, parts=(), compactness=0.5):
    return Node(region_of(np.ones((1, 1, voxels), bool)), confidence, parts, compactness)


def chain():
    """Return three balls in a row, touching, and their labels."""
    shape = (30, 30, 80)
    labels = np.zeros(shape, np.int32)
    for name, x in ((1, 15), (2, 39), (3, 63)):
        labels[ball(shape, (15, 15, x), 13) & (labels == 0)] = name
    return labels


def sizes_near(target):
    """Return an oracle that likes regions of a size, and is indifferent to all larger ones."""
    return lambda region: float(np.exp(-abs(np.log(region.voxels / target)) * 3))


def test_a_rule_keeps_the_cuts_that_gain_enough_from_the_leaves_up():
    # The first cut gains nothing by itself; the second, inside it, makes it worth while.
    deep = node(0.1, 60, (node(0.9, 30), node(0.8, 30)))
    tree = node(0.3, 90, (deep, node(0.9, 30)))
    assert [n.confidence for n in selected(tree, CutRule(0.1))] == [0.9, 0.8, 0.9]
    assert [n.confidence for n in selected(tree, CutRule(0.6))] == [0.3]
    assert selected(tree, CutRule(0.1, compactness=0.4)) == [tree]
    bad = node(0.7, 60, (node(0.95, 50), node(0.1, 10)))
    assert len(selected(bad, CutRule(0.05))) == 2
    assert len(selected(bad, CutRule(0.05, least=True))) == 1


def test_the_rule_with_the_most_liked_segmentation_is_chosen_and_the_first_of_equals():
    tree = node(0.5, 60, (node(0.7, 30), node(0.7, 30)))
    cautious, eager = CutRule(0.3), CutRule(0.1)
    assert best_rule([tree], (cautious, eager)) == eager
    assert best_rule([node(0.5, 9)], (cautious, eager)) == cautious


def test_three_touching_balls_come_apart_though_the_first_cut_gains_little():
    truth = chain()
    count = np.bincount(truth.ravel())[1]
    found = split_recursively([region_of(truth > 0)], sizes_near(count), 500.0)
    labels = np.zeros(truth.shape, np.int32)
    for name, region in enumerate(found, 1):
        labels[region.box][region.mask] = name
    result = score(truth, labels)
    assert result["found_objects"] == 3
    assert result["f1_75"] == 1


def test_a_sure_region_is_not_cut_and_every_split_can_be_cancelled():
    region = region_of(chain() > 0)
    assert grow_cut_tree(region, lambda r: 0.99, 500.0).parts == ()

    def cancel(fraction, text):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        split_recursively([region], lambda r: 0.1, 500.0, Share(cancel))


def test_what_was_cut_too_soon_is_joined():
    truth = chain()
    density = np.where(truth > 0, 1000.0, 0.0)
    oracle = sizes_near(np.bincount(truth.ravel())[1])
    wrong = truth.copy()
    wrong[(truth == 3) & (np.arange(80) > 63)] = 9
    result = score(truth, join_touching(wrong, density, UNIT, oracle, 0.2))
    assert result["found_objects"] == 3
    assert result["f1_75"] == 1
    alike = join_touching(truth, density, UNIT, oracle, 0.2)
    assert score(truth, alike)["mean_iou"] == 1


def test_pieces_of_which_no_two_look_better_than_one_come_together():
    shape = (20, 20, 70)
    labels = np.zeros(shape, np.int32)
    for name in range(1, 6):
        labels[box(shape, (5, 5, 12 * name - 7), (15, 15, 12 * name + 5))] = name
    density = np.where(labels > 0, 1000.0, 0.0)

    def likes_the_whole(region):
        return 0.9 if region.voxels == 6000 else 0.2

    assert join_touching(labels, density, UNIT, likes_the_whole, 0.2).max() == 1
    # Where the whole is no better than its pieces, they stay as they were.
    alike = join_touching(labels, density, UNIT, lambda region: 0.6, 0.2)
    assert score(labels, alike)["mean_iou"] == 1


def test_shell_and_content_become_one_where_the_oracle_prefers_it():
    shape = (30, 30, 30)
    labels = box(shape, (3, 3, 3), (27, 27, 27)).astype(np.int32)
    labels[box(shape, (8, 8, 8), (22, 22, 22))] = 2
    density = np.where(labels == 1, 400.0, np.where(labels == 2, 1000.0, 0))
    full = sizes_near(24**3)
    assert join_touching(labels, density, UNIT, full, 0.2).max() == 1
    assert len(np.unique(join_touching(labels, density, UNIT, lambda r: 0.6, 0.2))) == 3


def test_the_method_of_the_paper_finds_two_touching_balls_with_the_oracle_that_ships():
    truth = two_balls()
    volume = scanned(truth, {1: 1000, 2: 1000})
    found = segment(volume, method="cuts")
    assert score(truth, found.labels)["f1_75"] == 1
    np.testing.assert_array_equal(found.labels, segment(volume, method="cuts").labels)


def test_ten_thousand_specks_do_not_hang():
    volume = np.random.default_rng(0).normal(0, 10, (80, 80, 80))
    volume[::4, ::4, ::4] = 1000
    volume[30:60, 30:60, 30:60] = 1000
    assert len(segment(volume, method="cuts").objects) == 1


@pytest.mark.parametrize(
    ("wrong", "kind", "words"),
    [
        ({"method": "magic"}, ValueError, "method must be one of learned, cuts, got 'magic'"),
        ({"method": "affinity"}, ValueError, 'use method="learned" or method="cuts"'),
        ({"judge": len}, TypeError, 'pass oracle= with method="cuts"'),
    ],
)
def test_unknown_and_retired_methods_are_refused_in_one_sentence(wrong, kind, words):
    with pytest.raises(kind, match=words) as refused:
        segment(np.arange(27.0).reshape(3, 3, 3), **wrong)
    assert "\n" not in str(refused.value)
