import numpy as np
import pytest
from scipy import ndimage

from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.segmentation.common.adjacency import find_neighbours
from napari_unpack.simulation import Bag, simulate_bag
from napari_unpack.simulation.shell import Shell

SHAPE = (80, 88, 112)
COUNT = 16


@pytest.fixture(scope="module")
def bag() -> Bag:
    return simulate_bag(seed=4, shape=SHAPE, count=COUNT)


def test_a_bag_holds_what_was_asked_for(bag):
    assert bag.volume.shape == bag.labels.shape == SHAPE
    assert bag.volume.dtype == bag.labels.dtype == np.uint16
    assert bag.spacing == (1.0, 1.0, 1.0)
    assert bag.volume.max() <= 32000
    assert list(bag.objects.index) == list(range(1, COUNT + 1))
    assert bag.objects.index.name == "id"
    assert set(np.unique(bag.labels)) == set(range(COUNT + 1))


def test_the_table_counts_the_voxels_that_are_labelled(bag):
    counted = [int((bag.labels == i).sum()) for i in bag.objects.index]
    assert bag.objects["voxels"].tolist() == counted
    assert (bag.objects["mass_g"] > 0).all()
    assert bag.objects["name"].is_unique


def test_the_same_seed_packs_the_same_bag_and_another_seed_another():
    first, again, other = (simulate_bag(s, (40, 44, 48), 6) for s in (7, 7, 8))
    assert np.array_equal(first.volume, again.volume)
    assert np.array_equal(first.labels, again.labels)
    assert first.objects.equals(again.objects)
    assert not np.array_equal(first.labels, other.labels)


def test_nothing_floats(bag):
    floor = Shell.around(SHAPE).room(SHAPE).height
    for label in bag.objects.index[bag.objects["parent"] == 0]:
        z, y, x = np.nonzero(bag.labels == label)
        below = bag.labels[z, np.minimum(y + 1, SHAPE[1] - 1), x]
        rests_on_another = ((below != label) & (below != 0)).any()
        rests_on_the_floor = (y + 1 >= floor[z, x]).any()
        assert rests_on_another or rests_on_the_floor, bag.objects.loc[label, "name"]


def test_the_bag_is_well_filled_and_its_objects_touch(bag):
    assert (bag.labels > 0).mean() > 0.24
    pairs, _ = find_neighbours(bag.labels.astype(np.int32), (1, 1, 1)).pairs()
    assert np.unique(pairs).size >= 0.9 * COUNT
    assert len(pairs) >= COUNT


def test_the_largest_object_is_about_half_as_long_as_the_bag(bag):
    boxes = label_boxes(bag.labels)
    extents = np.sort((boxes.upper - boxes.lower).max(axis=1)) / max(SHAPE)
    assert 0.4 < extents[-1] < 0.75
    assert extents[0] < 0.4


def test_what_is_dense_is_labelled(bag):
    near = ndimage.binary_dilation(bag.labels > 0, iterations=3)
    outside = bag.volume[~near]
    assert np.percentile(outside, 99) < 420
    assert bag.volume[bag.labels > 0].mean() > 8 * outside.mean()


def test_everything_stays_inside_the_shell(bag):
    faces = [bag.labels[0], bag.labels[-1], bag.labels[:, 0], bag.labels[:, -1]]
    faces += [bag.labels[..., 0], bag.labels[..., -1]]
    assert not any(face.any() for face in faces)


def test_progress_rises_from_zero_to_one_and_may_cancel():
    told = []
    simulate_bag(1, (32, 32, 32), 3, progress=lambda fraction, text: told.append((fraction, text)))
    fractions = [fraction for fraction, _ in told]
    assert fractions[0] == 0.0
    assert fractions[-1] == 1.0
    assert fractions == sorted(fractions)
    assert all(text for _, text in told)

    def cancel(fraction, text):
        raise InterruptedError

    with pytest.raises(InterruptedError):
        simulate_bag(1, (32, 32, 32), 3, progress=cancel)


@pytest.mark.parametrize(
    ("shape", "count"),
    [((24, 24, 24), 1), ((24, 24, 24), 12), ((24, 60, 33), 5), ((61, 24, 40), 9)],
)
def test_small_and_odd_bags_are_packed_too(shape, count):
    bag = simulate_bag(2, shape, count)
    assert bag.labels.shape == shape
    assert 1 <= len(bag.objects) <= count
    assert (bag.objects["voxels"] > 0).all()


def test_a_crowd_beyond_the_room_gives_fewer_objects_and_says_so():
    bag = simulate_bag(0, (24, 24, 24), 150)
    assert 20 < len(bag.objects) < 150
    assert bag.labels.max() == len(bag.objects)


def test_spacing_changes_the_voxels_and_not_the_world():
    coarse = simulate_bag(3, (40, 40, 60), 6, spacing=(2.0, 1.0, 1.0))
    assert coarse.spacing == (2.0, 1.0, 1.0)
    assert len(coarse.objects) == 6
    boxes = label_boxes(coarse.labels)
    longest = ((boxes.upper - boxes.lower) * [2.0, 1.0, 1.0]).max()
    assert 0.4 * 80 < longest < 0.75 * 80


def test_a_table_lies_below_the_bag_and_is_background():
    bag = simulate_bag(1, (40, 60, 40), 4, table=True)
    assert not bag.labels[:, -5:].any()
    assert bag.volume[:, -5:].mean() > 200


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"seed": -1}, "seed"),
        ({"seed": 1.5}, "seed"),
        ({"shape": (23, 40, 40)}, "shape"),
        ({"shape": (40, 40)}, "shape"),
        ({"shape": (40.0, 40.0, 40.0)}, "shape"),
        ({"count": 0}, "count"),
        ({"count": 2.5}, "count"),
        ({"spacing": (1, 0, 1)}, "spacing"),
        ({"spacing": (1, 1)}, "spacing"),
        ({"spacing": (1, np.nan, 1)}, "spacing"),
        ({"spacing": "fine"}, "spacing"),
        ({"spacing": (1e-300,) * 3}, "spacing"),
        ({"spacing": (1e10,) * 3}, "spacing"),
        ({"spacing": (1, 1, 1000)}, "no object found room"),
    ],
)
def test_a_bad_argument_is_named(arguments, named):
    with pytest.raises(ValueError, match=named):
        simulate_bag(**{"shape": (24, 24, 24), "count": 1, **arguments})
