from types import SimpleNamespace

import numpy as np
import pytest
from phantoms import packed, scanned

from napari_unpack import simulate_bag
from napari_unpack.segmentation import Oracle, train
from napari_unpack.segmentation.confidence.oracle import default_oracle
from napari_unpack.segmentation.training import merged_pairs, oracle_examples, train_on_examples
from napari_unpack.tasks import Cancelled, Share


class Labelled:
    spacing = (1.0, 1.0, 1.0)

    def __init__(self, seed):
        self.labels, densities = packed(seed, (64, 80, 90), 12, 16, press=3)
        self.volume = scanned(self.labels, densities, seed=seed)


def auroc(good, bad):
    above = (good[:, None] > bad[None, :]).mean()
    return above + (good[:, None] == bad[None, :]).mean() / 2


def test_training_twice_gives_the_same_file_to_the_bit(tmp_path):
    bags = [Labelled(seed) for seed in range(300, 302)]
    for name in ("one.npz", "two.npz"):
        fractions = []
        train(bags, progress=lambda f, _, told=fractions: told.append(f)).save(tmp_path / name)
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    # For every object, and not once for each volume: it can be cancelled there.
    assert len(fractions) > 60
    assert Oracle.load(tmp_path / "one.npz").bad is not None


@pytest.mark.parametrize("after", [1, 2, 20])
def test_training_is_cancelled_at_any_report(after):
    told = []

    def stop(fraction, _text):
        told.append(fraction)
        if len(told) == after:
            raise Cancelled

    with pytest.raises(Cancelled):
        train([Labelled(300)], progress=stop)
    # Nothing is told any more.
    assert len(told) == after


def test_pairs_and_halves_are_made_one_by_one_and_each_can_be_cancelled():
    labels = np.repeat(np.repeat(np.repeat(np.arange(1, 28).reshape(3, 3, 3), 6, 0), 6, 1), 6, 2)
    volume = np.random.default_rng(0).normal(1000, 20, labels.shape)
    told = []
    bag = SimpleNamespace(volume=volume, labels=labels, spacing=(1.0, 1.0, 1.0))
    good, bad = oracle_examples(bag, share=Share(lambda fraction, _: told.append(fraction)))
    assert (len(good), len(bad)) == (27, 54 + 27)
    assert len(set(told)) >= 27 + 54 + 27
    made = []
    for pair in merged_pairs(volume, labels, (1.0, 1.0, 1.0), Share(lambda *_: made.append(0))):
        assert pair.mask.all()
        assert pair.voxels == 2 * 6**3
        # The others are not made yet.
        assert made.count(0) == made.count(1) + 1
        made.append(1)


def test_a_volume_without_labels_is_refused():
    bag = Labelled(300)
    bag.labels = np.zeros_like(bag.labels)
    with pytest.raises(ValueError, match="labels"):
        train([bag])


@pytest.mark.parametrize(
    ("labels", "spacing", "words"),
    [
        (np.full((4, 5, 6), -1), (1.0, 1.0, 1.0), "negative labels, got -1"),
        (np.ones((4, 5, 6), np.int32), (1.0, 0.0, 1.0), "spacing"),
        (np.ones((4, 5, 6), np.int32), (1.0, np.nan, 1.0), "spacing"),
    ],
)
def test_labels_and_spacings_that_cannot_be_learned_from_are_refused(labels, spacing, words):
    bag = SimpleNamespace(volume=np.ones(labels.shape), labels=labels, spacing=spacing)
    with pytest.raises(ValueError, match=words):
        train([bag])


@pytest.mark.parametrize("seed", [None, -1, 1.5, True])
def test_a_seed_that_is_none_is_named(seed):
    with pytest.raises(ValueError, match="seed must be a whole number"):
        train([], seed)


def test_the_size_of_an_id_changes_nothing():
    bag = simulate_bag(seed=3, shape=(40, 44, 52), count=6)
    known = oracle_examples(bag)
    far = np.where(bag.labels > 0, bag.labels.astype(np.int64) + 2**36, 0)
    moved = oracle_examples(SimpleNamespace(volume=bag.volume, labels=far, spacing=bag.spacing))
    for rows, others in zip(known, moved, strict=True):
        np.testing.assert_array_equal(rows, others)
    assert len(known[0]) > 3


def test_specks_of_a_brush_are_no_examples():
    labels = np.zeros((20, 24, 36), np.int32)
    for i in range(3):
        labels[4:12, 6:18, 12 * i + 2 : 12 * i + 12] = i + 1
    volume = np.random.default_rng(2).normal(1000.0, 10.0, labels.shape) * (labels > 0)
    touched = labels.copy()
    # Four voxels each upon an object, with a name of their own.
    touched[12:14, 8:10, 4:29:12] = [4, 5, 6]
    clean, specked = (
        oracle_examples(SimpleNamespace(volume=volume, labels=one, spacing=(1.0, 1.0, 1.0)))
        for one in (labels, touched)
    )
    assert [len(rows) for rows in specked] == [len(rows) for rows in clean] == [3, 3]


def test_the_oracle_that_ships_tells_objects_of_an_unseen_bag_from_pairs_and_halves():
    bag = simulate_bag(seed=61, shape=(96, 112, 144), count=14)
    good, bad = (default_oracle().scores(np.array(rows)) for rows in oracle_examples(bag, 1))
    assert len(good) > 8
    assert auroc(good, bad) >= 0.9
    assert ((good >= 0) & (good <= 1)).all()


def cubes(side, count, density):
    """Return cubes in a row: densities and labels."""
    labels = np.zeros((side + 4, side + 4, count * (side + 2) + 2), np.uint16)
    volume = np.full(labels.shape, 20, np.uint16)
    for k in range(count):
        here = (slice(2, 2 + side),) * 2 + (slice(2 + k * (side + 2), (k + 1) * (side + 2)),)
        labels[here], volume[here] = k + 1, density(k)
    return volume, labels


def test_only_examples_that_are_large_enough_count_and_the_limit_is_named():
    volume, labels = cubes(3, 12, lambda k: 600 + 50 * k)
    with pytest.raises(ValueError, match=r"64 voxels or more.* of 12 marked, 0 are that large"):
        train_on_examples(volume, labels, (1.0, 1.0, 1.0), range(1, 13))
    bag = SimpleNamespace(volume=volume, labels=labels, spacing=(1.0, 1.0, 1.0))
    with pytest.raises(ValueError, match="8 objects of 64 voxels or more to learn from, got 0"):
        train([bag])


def test_examples_that_are_all_alike_are_learned_without_a_warning(recwarn):
    volume, labels = cubes(6, 8, lambda k: 1000)
    oracle = train_on_examples(volume, labels, (1.0, 1.0, 1.0), range(1, 9))
    assert [str(one.message) for one in recwarn if one.category is RuntimeWarning] == []
    good, _ = oracle_examples(
        SimpleNamespace(volume=volume, labels=labels, spacing=(1.0, 1.0, 1.0))
    )
    assert np.isfinite(oracle.scores(np.array(good))).all()


def test_nested_lists_are_learned_from():
    labels = np.zeros((6, 6, 12), int)
    labels[1:5, 1:5, 1:6], labels[1:5, 1:5, 6:11] = 1, 2
    known = SimpleNamespace(volume=labels * 500.0, labels=labels, spacing=(1, 1, 1))
    lists = SimpleNamespace(volume=known.volume.tolist(), labels=labels.tolist(), spacing=[1, 1, 1])
    for one, other in zip(oracle_examples(known), oracle_examples(lists), strict=True):
        np.testing.assert_array_equal(one, other)
    with pytest.raises(TypeError, match="volume must hold real numbers"):
        oracle_examples(SimpleNamespace(volume=labels * 1j, labels=labels, spacing=(1, 1, 1)))


@pytest.mark.parametrize("bags", [SimpleNamespace(labels=None, volume=None), 5], ids=repr)
def test_a_single_volume_is_told_how_it_is_given(bags):
    with pytest.raises(TypeError, match="bags must be volumes with labels, one after another"):
        train(bags)
    with pytest.raises(TypeError, match=r"must have volume, labels and spacing.*got ndarray"):
        train([np.zeros((4, 4, 4), int)])
