import numpy as np
import pytest

from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.simulation.catalogue import KINDS
from napari_unpack.simulation.draping import drape, tailor
from napari_unpack.simulation.packing import Packing
from napari_unpack.simulation.planning import Order
from napari_unpack.simulation.scanner import Scanner
from napari_unpack.simulation.stacking import BLOCKED, Profile, Rest, Stack

BY_NAME = {kind.name: kind for kind in KINDS}


def room(z, rows, x):
    return Stack(np.full((z, x), rows, np.int32), np.zeros((z, x), np.int32))


def packing(shape=(70, 60, 90)):
    return Packing.empty(shape, room(shape[0], shape[1], shape[2]), np.ones(3))


def test_a_profile_is_what_is_seen_from_below_and_above():
    inside = np.zeros((1, 4, 3), bool)
    inside[0, 1:3, 0] = True
    inside[0, 0, 1] = inside[0, 3, 1] = True
    profile = Profile.of(inside)
    assert profile.under.tolist() == [[3, 4, BLOCKED]]
    assert profile.over.tolist() == [[1, 0, 0]]


def test_a_block_falls_to_the_floor_beside_what_stands_there():
    # Floor at row 10; the left half is taken from row 6 down. A 1 x 2 x 2 block belongs at
    # rows 8 and 9, in the right half, against the step.
    stack = room(1, 10, 6)
    stack.height[0, :3] = 6
    rest = stack.best(Profile.of(np.ones((1, 2, 2), bool)))
    assert (rest.z, rest.y) == (0, 8)
    assert rest.x in (3, 4)


def test_a_block_that_spans_a_step_rests_on_the_upper_side():
    stack = room(1, 10, 4)
    stack.height[0, :2] = 6
    rest = stack.best(Profile.of(np.ones((1, 2, 4), bool)))
    assert (rest.y, rest.x) == (4, 0)


def test_what_would_pass_through_the_lid_fits_nowhere():
    stack = room(2, 3, 2)
    assert stack.best(Profile.of(np.ones((2, 3, 2), bool))) is not None
    assert stack.best(Profile.of(np.ones((2, 4, 2), bool))) is None


def test_blocked_columns_are_never_entered():
    stack = room(1, 10, 4)
    stack.height[0, 1] = BLOCKED
    rest = stack.best(Profile.of(np.ones((1, 1, 2), bool)))
    assert rest.x == 2
    assert stack.best(Profile.of(np.ones((1, 1, 3), bool))) is None


def test_a_load_raises_only_the_columns_it_covers():
    stack = room(1, 10, 3)
    shape = np.zeros((1, 2, 2), bool)
    shape[0, :, 0] = True
    stack.load(Profile.of(shape), Rest(0, 8, 1, 0.0))
    assert stack.height.tolist() == [[10, 8, 10]]


def test_the_coarse_room_is_never_larger_than_the_room():
    stack = room(3, 10, 4)
    stack.height[2, 3] = 4
    stack.ceiling[0, 0] = 2
    coarse = stack.coarse(2)
    assert coarse.height.tolist() == [[10, 10], [BLOCKED, BLOCKED]]
    assert coarse.ceiling[0].tolist() == [2, 0]


@pytest.mark.parametrize("name", ["carton", "pouch"])
def test_what_a_container_holds_lies_inside_it_and_names_it_as_parent(name):
    bag = packing()
    seed = _roomy(BY_NAME[name])
    assert bag.add(Order(BY_NAME[name], seed, 56.0, 2), np.random.default_rng(0))
    assert [record.parent for record in bag.records] == [0, 1, 1]
    boxes = label_boxes(bag.labels)
    for child in (1, 2):
        assert (boxes.lower[child] > boxes.lower[0]).all()
        assert (boxes.upper[child] < boxes.upper[0]).all()


def test_what_a_carton_holds_does_not_touch_the_air_outside():
    bag = packing()
    bag.add(Order(BY_NAME["carton"], _roomy(BY_NAME["carton"]), 56.0, 2), np.random.default_rng(0))
    padded = np.pad(bag.labels, 1)
    held = padded >= 2
    for axis in range(3):
        for step in (1, -1):
            beside = np.roll(padded, step, axis)[held]
            assert (beside != 0).all()


def test_a_thing_too_large_is_packed_smaller():
    bag = packing((40, 40, 40))
    assert bag.add(Order(BY_NAME["bottle"], 3, 60.0), np.random.default_rng(0))
    assert label_boxes(bag.labels).upper.max() <= 40


def test_a_thing_for_which_there_is_no_room_is_left_out():
    bag = packing((30, 30, 30))
    bag.stack.height[:] = 2
    assert not bag.add(Order(BY_NAME["ball"], 0, 25.0), np.random.default_rng(0))
    assert not bag.labels.any()
    assert bag.records == []


def test_water_in_a_scanned_bottle_measures_a_thousand():
    bag = packing((60, 50, 110))
    seed = next(s for s in range(50) if _built(BY_NAME["bottle"], s).name == "water bottle")
    bag.add(Order(BY_NAME["bottle"], seed, 100.0), np.random.default_rng(0))
    water = np.abs(bag.density - 1000) < 0.5
    deep = water & np.roll(water, 2, 1) & np.roll(water, -2, 1) & np.roll(water, 2, 0)
    volume = Scanner(noise=16.0).scan(bag.density, np.random.default_rng(1))
    measured = volume[deep].astype(float)
    assert len(measured) > 2000
    assert abs(measured.mean() - 1000) < 12
    assert 8 < measured.std() < 40


@pytest.mark.parametrize("kind", ["sweater", "trousers", "scarf"])
def test_cloth_follows_what_it_lies_on_without_entering_it(kind):
    stack = room(80, 50, 80)
    stack.height[30:50, 30:50] = 35
    rng = np.random.default_rng(2)
    laid = drape(rng, tailor(rng, kind, 60.0, 1.6), stack, np.ones(3))
    z, y, x = np.nonzero(laid.inside)
    ground = stack.height[z + laid.corner[0], x + laid.corner[2]]
    assert (y + laid.corner[1] < ground).all()
    assert (y + laid.corner[1] == ground - 1).any()
    assert 100 < laid.density[laid.inside].mean() < 700


def test_cloth_finds_no_place_under_a_low_lid():
    stack = room(40, 4, 40)
    rng = np.random.default_rng(0)
    assert drape(rng, tailor(rng, "sweater", 30.0, 1.6), stack, np.ones(3)) is None


def _built(kind, seed):
    return kind.build(np.random.default_rng(seed), 56.0, 1.6)


def _roomy(kind):
    return next(seed for seed in range(50) if _built(kind, seed).room is not None)
