import time

import numpy as np
import pytest
from phantoms import ball, box, two_balls

from napari_unpack.segmentation.common.region import Region
from napari_unpack.segmentation.isoperimetric.candidates import candidate_cuts

UNIT = (1.0, 1.0, 1.0)


def dice_of(parts, truth):
    """Return the lesser Dice of two true parts with the found part that overlaps each most."""
    values = []
    for name in (1, 2):
        side = truth == name
        k = np.bincount(parts[side]).argmax()
        found = parts == k
        values.append(2 * (side & found).sum() / (side.sum() + found.sum()))
    return min(values)


def by_source(truth, density=None):
    values = np.where(truth > 0, 1000.0, 0.0) if density is None else density
    region = Region(truth > 0, values, (0, 0, 0), UNIT)
    found = {}
    for candidate in candidate_cuts(region, 200.0):
        value = dice_of(candidate.parts, truth)
        found[candidate.source] = max(value, found.get(candidate.source, 0))
    return found


def partial_contact():
    shape = (40, 40, 60)
    truth = box(shape, (5, 5, 5), (25, 25, 30)).astype(np.int32)
    truth[box(shape, (13, 13, 30), (35, 35, 55))] = 2
    return truth


def full_contact():
    shape = (34, 34, 60)
    truth = box(shape, (5, 5, 5), (29, 29, 30)).astype(np.int32)
    truth[box(shape, (5, 5, 30), (29, 29, 55))] = 2
    return truth


def cylinder_on_sheet():
    shape = (50, 50, 60)
    z, y, x = np.indices(shape)
    truth = ((np.hypot(z - 22, y - 25) <= 12) & (x >= 12) & (x < 48)).astype(np.int32)
    truth[box(shape, (34, 3, 3), (38, 47, 57))] = 2
    return truth


@pytest.mark.parametrize(
    ("truth", "families", "least"),
    [
        (two_balls(), ("tree", "lattice"), 0.98),
        (partial_contact(), ("tree", "lattice"), 0.97),
        (full_contact(), ("lattice",), 0.98),
        (cylinder_on_sheet(), ("sheet", "tree"), 0.95),
    ],
    ids=["balls", "partial face", "whole face", "cylinder on sheet"],
)
def test_every_shape_of_the_notes_is_cut_well_by_the_splitter_made_for_it(truth, families, least):
    found = by_source(truth)
    best = max(found, key=found.get)
    assert found[best] >= least, found
    assert best.startswith(families), found


def test_two_materials_face_to_face_come_apart_at_their_step():
    shape = (34, 34, 60)
    truth = box(shape, (5, 5, 5), (29, 29, 22)).astype(np.int32)
    truth[box(shape, (5, 5, 22), (29, 29, 55))] = 2
    noise = np.random.default_rng(0).normal(0, 20, shape)
    density = np.where(truth == 1, 900.0, 1200.0) + noise
    found = by_source(truth, density)
    assert found["materials"] >= 0.97


def test_every_candidate_is_a_partition_into_connected_parts_of_the_least_size():
    import cc3d

    rng = np.random.default_rng(2)
    mask = ball((40, 40, 70), (20, 20, 18), 15) | box((40, 40, 70), (10, 10, 30), (32, 30, 66))
    region = Region(mask, rng.normal(1000, 60, mask.shape), (0, 0, 0), (1.0, 1.0, 2.0))
    candidates = candidate_cuts(region, 400.0)
    assert [c.ratio for c in candidates] == sorted(c.ratio for c in candidates)
    assert candidates
    for candidate in candidates:
        np.testing.assert_array_equal(candidate.parts > 0, mask)
        for name in range(1, candidate.parts.max() + 1):
            part = candidate.parts == name
            assert part.sum() * 2 >= 400
            assert cc3d.connected_components(part, connectivity=6).max() == 1


def test_the_ratio_is_the_area_between_parts_over_the_smaller_volume():
    truth = full_contact()
    spacing = (2.0, 1.0, 1.5)
    region = Region(truth > 0, np.ones(truth.shape), (0, 0, 0), spacing)
    for candidate in candidate_cuts(region, 600.0):
        area = 0.0
        for axis, face in enumerate((1.5, 3.0, 2.0)):
            parts = np.moveaxis(candidate.parts, axis, 0)
            met = (parts[1:] != parts[:-1]) & (parts[1:] > 0) & (parts[:-1] > 0)
            area += face * met.sum()
        counts = np.bincount(candidate.parts.ravel())[1:]
        assert candidate.ratio == pytest.approx(area / (3.0 * (counts.sum() - counts.max())))


def test_the_same_region_gives_the_same_candidates():
    truth = partial_contact()
    region = Region(truth > 0, np.ones(truth.shape), (0, 0, 0), UNIT)
    for one, two in zip(candidate_cuts(region, 200.0), candidate_cuts(region, 200.0), strict=True):
        np.testing.assert_array_equal(one.parts, two.parts)
        assert (one.ratio, one.source) == (two.ratio, two.source)


def test_too_little_to_cut_gives_no_candidates():
    mask = np.ones((3, 3, 3), bool)
    assert candidate_cuts(Region(mask, mask * 1.0, (0, 0, 0), UNIT), 20.0) == []
    assert candidate_cuts(Region(mask[:1, :1], mask[:1, :1] * 1.0, (0, 0, 0), UNIT), 1.0) == []


def test_a_region_of_a_million_voxels_takes_no_more_than_seconds():
    mask = np.ones((100, 100, 100), bool)
    region = Region(mask, np.ones(mask.shape, np.float32), (0, 0, 0), UNIT)
    start = time.process_time()
    candidate_cuts(region, 500.0)
    assert time.process_time() - start < 10
