"""What surrounds the packed things: field of view, pad, shell; and folds that are one bundle."""

import numpy as np
import pytest
from phantoms import ball, box

from napari_unpack.segmentation.foreground.bag_shell import drop_skin, find_shell
from napari_unpack.segmentation.foreground.scanner_table import find_supports, measured_section
from napari_unpack.segmentation.postprocessing.crumpled_cloth import bundle_folds


def test_the_rim_of_a_round_field_of_view_is_not_measured():
    rng = np.random.default_rng(0)
    volume = rng.uniform(1, 50, (4, 64, 64))
    y, x = np.indices((64, 64)) - 31.5
    radius = np.hypot(y, x)
    volume[:, radius > 32] = 0
    section = measured_section(volume)
    assert not section[radius > 28.1].any()
    assert section[radius <= 28].all()


def test_a_volume_that_is_measured_to_its_corners_has_no_round_field_of_view():
    volume = np.random.default_rng(0).uniform(0, 50, (4, 64, 64))
    assert measured_section(volume) is None
    # Matter in the middle alone is not a round field of view either.
    assert measured_section(np.pad(volume[:, 16:48, 16:48], ((0, 0), (16, 16), (16, 16)))) is None


def test_a_pad_between_table_and_bag_goes_with_the_table():
    foreground = np.zeros((80, 120, 200), bool)
    foreground[:, 100:104, 10:190] = True
    pad = np.zeros_like(foreground)
    for z in range(80):
        # The outline wanders by a voxel from slice to slice.
        pad[z, 90 + z % 2, 12:188] = True
    bag = box(foreground.shape, (15, 40, 60), (65, 86, 140))
    found = find_supports(foreground | pad | bag, (2.0, 2.0, 2.0))
    assert found[foreground].all()
    assert found[pad].mean() > 0.95
    # Two voxels of margin at most.
    assert found[bag].mean() < 2.1 / 46


def test_the_skin_around_many_things_is_a_shell_and_a_box_around_nothing_is_not():
    labels = np.zeros((60, 60, 60), np.int32)
    skin = box(labels.shape, (5, 5, 5), (55, 55, 55)) & ~box(labels.shape, (8, 8, 8), (52, 52, 52))
    labels[skin] = 1
    for name, center in enumerate([(20, 20, 20), (20, 20, 40), (20, 40, 20), (40, 40, 40)], 2):
        labels[ball(labels.shape, center, 8)] = name
    found = find_shell(labels, (1.0, 1.0, 1.0))
    assert found.tolist() == [False, True, False, False, False, False]
    labels[labels > 1] = 0
    assert not find_shell(labels, (1.0, 1.0, 1.0)).any()


@pytest.mark.parametrize(("millimetres", "skin"), [(1.0, [3]), (0.5, [3, 4]), (5.0, [])])
def test_of_what_is_doubted_only_what_is_as_thin_as_skin_goes(millimetres, skin):
    shape = (40, 40, 40)
    labels = np.zeros(shape, np.int32)
    labels[box(shape, (2, 2, 2), (5, 38, 38))] = 3
    labels[box(shape, (9, 2, 2), (21, 38, 38))] = 4
    labels[box(shape, (30, 2, 2), (33, 38, 38))] = 7
    doubted = np.array([False, False, True, True, True, False, False, False])
    kept = drop_skin(labels, doubted, (millimetres,) * 3)
    assert kept.dtype == np.int32
    np.testing.assert_array_equal(kept, np.where(np.isin(labels, skin), 0, labels))


def test_light_folds_a_voxel_apart_are_one_bundle_and_a_solid_among_them_is_not():
    parts = np.zeros((40, 40, 40), np.int32)
    for name, y in enumerate(range(4, 36, 2), 1):
        parts[4:36, y, 4:30] = name
    parts[5:35, 5:35, 32:39] = 50
    density = np.where(parts == 50, 1000, 200)
    bundled = bundle_folds(parts, density, (1.0, 1.0, 1.0), light=400)
    assert len(np.unique(bundled[(parts > 0) & (parts < 50)])) == 1
    assert (bundled[parts == 50] == 50).all()
    np.testing.assert_array_equal(bundled > 0, parts > 0)
    # Where folds are rare they are sheets, and each stays what it is.
    # Labels without a voxel between them make none more.
    for gap in (0, 30_000):
        rare = np.where(parts == 50, 50 + gap, np.where(parts > 2, 0, parts))
        found = bundle_folds(rare, density, (1.0, 1.0, 1.0), light=400)
        np.testing.assert_array_equal(found, rare)


def _wall(ends: int) -> np.ndarray:
    # A wall 4 mm thick and 240 mm wide, under a heap 100 mm deep; `ends` slices stay free.
    foreground = np.zeros((100, 80, 140), np.bool_)
    foreground[ends : 100 - ends, 60:62, 10:130] = True
    foreground[20:80, 20:58, 40:100] = True
    return foreground


def test_a_wall_that_ends_inside_the_scan_is_no_support() -> None:
    assert not find_supports(_wall(ends=6), (2.0, 2.0, 2.0)).any()


def test_the_same_wall_run_through_the_whole_scan_is_one() -> None:
    found = find_supports(_wall(ends=0), (2.0, 2.0, 2.0))
    assert found[:, 60:62, 20:120].all()
    assert not found[20:80, 20:55, 40:100].any()


@pytest.mark.parametrize("seed", [1, 5, 6])
def test_a_table_is_found_among_specks_that_reach_the_last_pixel_of_the_section(seed: int) -> None:
    # Of masks like these cc3d 4.1 labels pixels that are none, unless they are given as bytes.
    section = np.random.default_rng(seed).random((108, 83)) < 0.01
    section[-8:-4] = section[107, 82] = True
    foreground = np.repeat(section[None], 60, axis=0)
    foreground[8:52, 30:95, 10:70] = True
    found = find_supports(foreground, (3.0, 3.0, 3.0))
    assert found[:, -8:-4].all()
    assert not found[:, 40:80, 20:60].any()
