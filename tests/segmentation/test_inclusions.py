"""What is dense in something soft is an object; the same in something rigid is a part of it."""

import numpy as np
import pytest
from phantoms import ball, box, scanned
from real_scans import real_scan

from napari_unpack.segmentation.postprocessing.inclusions import separate_inclusions

SHAPE = (48, 56, 64)
AIR, CLOTH, PLASTIC, METAL = 0, 1, 2, 3
DENSITIES = {CLOTH: 200.0, PLASTIC: 1050.0, METAL: 3900.0}
SPACING = (1.0, 1.0, 1.0)
MIDDLE = (24, 28, 32)


def taken(materials, labels, smallest=100.0):
    present = {name: DENSITIES[name] for name in DENSITIES if name <= materials.max()}
    volume = scanned(materials, present, noise=12)
    return separate_inclusions(labels.astype(np.int32), volume, SPACING, smallest)


def block(of):
    return np.where(box(SHAPE, (8, 8, 8), (40, 48, 56)), of, AIR)


def overlap(one, two):
    return np.count_nonzero(one & two) / np.count_nonzero(one | two)


def test_a_bead_in_cloth_is_an_object_of_its_own():
    bead = ball(SHAPE, MIDDLE, 3.2)
    result = taken(np.where(bead, METAL, block(CLOTH)), block(1))
    assert result.max() == 2
    assert overlap(result == 2, bead) > 0.6
    assert (result[block(1) > 0] > 0).all()


def test_a_bead_between_two_cloths_is_one_object():
    bead = ball(SHAPE, MIDDLE, 3.2)
    halves = block(1) + (block(1) & (np.arange(64) >= 32))
    result = taken(np.where(bead, METAL, block(CLOTH)), halves)
    assert result.max() == 3
    assert overlap(result == 3, bead) > 0.6


@pytest.mark.parametrize("host", ["plastic", "radio in cloth"])
def test_the_same_bead_in_something_rigid_is_a_part_of_it(host):
    bead = ball(SHAPE, MIDDLE, 3.2)
    around = block(PLASTIC)
    if host == "radio in cloth":
        around = np.where(box(SHAPE, (16, 20, 20), (32, 36, 44)), PLASTIC, block(CLOTH))
    labels = np.where(around == PLASTIC, 1, 2) * (around > 0)
    result = taken(np.where(bead, METAL, around), labels)
    np.testing.assert_array_equal(result, labels)


def test_the_rim_of_a_can_stays_with_the_can():
    z, y, x = np.indices(SHAPE)
    radius = np.hypot(y - 28, x - 32)
    inside = (z >= 12) & (z <= 36)
    can = inside & (radius <= 14) & (radius >= 12)
    rim = (np.hypot(radius - 13, z - 12) <= 2) | (np.hypot(radius - 13, z - 36) <= 2)
    materials = np.where(rim, METAL, np.where(can, PLASTIC, block(CLOTH)))
    labels = np.where(rim | can | (inside & (radius < 12)), 1, 2) * (materials > 0)
    np.testing.assert_array_equal(taken(materials, labels), labels)


def test_a_tray_of_metal_takes_with_it_what_lies_in_it():
    outer = box(SHAPE, (12, 16, 16), (36, 40, 40))
    cavity = box(SHAPE, (12, 19, 19), (33, 37, 37))
    wall = outer & ~cavity
    result = taken(np.where(wall, METAL, block(CLOTH)), block(1))
    assert result.max() == 2
    assert overlap(result == 2, outer) > 0.8


def test_what_is_left_in_two_places_becomes_two_objects():
    slab = box(SHAPE, (21, 8, 8), (27, 48, 56))
    tray = slab & ~box(SHAPE, (23, 12, 12), (25, 44, 52))
    result = taken(np.where(tray, METAL, block(CLOTH)), block(1))
    names = [np.unique(result[part][result[part] > 0]) for part in (np.s_[9:18], np.s_[30:39])]
    assert [len(n) for n in names] == [1, 1]
    assert names[0][0] != names[1][0]


@pytest.mark.parametrize("thing", ["bead", "frame"])
def test_a_compact_thing_that_nobody_has_is_found_but_no_frame(thing):
    cloth = box(SHAPE, (8, 8, 8), (40, 48, 24))
    lost = ball(SHAPE, (24, 28, 34), 3.2)
    if thing == "frame":
        outer, hole = ((8, 10, 40), (40, 46, 44)), ((11, 13, 40), (37, 43, 44))
        lost = box(SHAPE, *outer) & ~box(SHAPE, *hole)
    around = box(SHAPE, (4, 4, 24), (44, 52, 52)) & (np.indices(SHAPE).sum(axis=0) % 3 == 0)
    materials = np.where(lost, METAL, np.where(cloth | around, CLOTH, AIR))
    result = taken(materials, cloth)
    assert result.max() == (2 if thing == "bead" else 1)
    assert thing == "frame" or overlap(result == 2, lost) > 0.5


def test_the_unit_of_densities_changes_nothing(pocket):
    volume, spacing = pocket
    cloth = (volume > 90).astype(np.int32)
    known = separate_inclusions(cloth, volume, spacing, 500.0)
    volume = volume * np.float32(16)
    np.testing.assert_array_equal(separate_inclusions(cloth, volume, spacing, 500.0), known)
    assert known.max() > 4


def test_noise_cloth_alone_and_nothing_stay_as_they_are():
    np.testing.assert_array_equal(taken(block(CLOTH), block(1)), block(1))
    empty = np.zeros(SHAPE, np.int32)
    np.testing.assert_array_equal(separate_inclusions(empty, empty, SPACING, 100.0), empty)


def test_where_everything_is_metal_nothing_is_taken():
    metal = block(METAL)
    np.testing.assert_array_equal(taken(metal, block(1)), block(1))


@pytest.fixture
def pocket():
    """A part of the backpack with three of its buttons, in cloth."""
    scan = real_scan("backpack")
    return scan["volume"][:70, 60:120, 80:180], tuple(scan["spacing"].tolist())


def test_the_backpacks_buttons_are_objects(pocket):
    volume, spacing = pocket
    cloth = (volume > 90).astype(np.int32)
    result = separate_inclusions(cloth, volume, spacing, 500.0)
    for place in ((29, 20, 30), (31, 31, 79), (50, 15, 24), (57, 20, 17)):
        window = tuple(slice(c - 1, c + 2) for c in place)
        name = int(np.bincount(result[window].reshape(-1)).argmax())
        assert name > 1
        assert 60 < np.count_nonzero(result == name) < 250


def test_half_the_density_of_a_piece_counts_and_not_of_its_brightest_layer_alone():
    # Three layers of one plate: 3000, 1600 and 1300. The core is the first, of which 1300 is less
    # than half; of both first layers together it is more. Two layers alone are as flat as a streak.
    volume = np.where(block(1) > 0, 100.0, 0.0)
    # So much of the host is denser that nothing of less than 2750 begins a core.
    volume[box(SHAPE, (28, 8, 8), (40, 48, 56))] = 700.0
    plate = box(SHAPE, (14, 20, 20), (17, 36, 36))
    volume[14, 20:36, 20:36] = 1600.0
    volume[15, 21:35, 21:35] = 3000.0
    volume[16, 20:36, 20:36] = 1300.0
    volume[15][plate[15] & (volume[15] < 3000)] = 1600.0
    result = separate_inclusions(block(1).astype(np.int32), volume, SPACING, 100.0)
    assert result.max() == 2
    # Growth leaves out corners.
    assert overlap(result == 2, plate) > 0.98
