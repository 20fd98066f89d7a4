from collections import Counter
from dataclasses import replace
from itertools import groupby

import numpy as np
import pytest
from phantoms import box, packed, scanned, two_balls
from scipy import ndimage

from napari_unpack import tasks
from napari_unpack.segmentation import pipeline, score, segment
from napari_unpack.segmentation.common.region import fewest_voxels


def sure(_region):
    return 1.0


def test_two_overlapping_balls_of_one_material_become_two_objects():
    truth = two_balls()
    found = segment(scanned(truth, {1: 1000, 2: 1000}))
    result = score(truth, found.labels)
    assert result["found_objects"] == 2
    # Dice 0.98 is IoU 0.961.
    assert result["mean_iou"] >= 0.961


def test_a_bottle_with_its_liquid_and_air_is_one_object():
    shape = (56, 40, 40)
    grid = np.indices(shape)
    radius = np.hypot(grid[1] - 20, grid[2] - 20)
    solid = (radius <= 15) & (grid[0] >= 6) & (grid[0] < 50)
    inside = (radius <= 12) & (grid[0] >= 9) & (grid[0] < 47)
    labels = np.zeros(shape, np.int32)
    labels[solid] = 1
    labels[inside] = 2
    labels[inside & (grid[0] < 20)] = 0
    found = segment(scanned(labels, {1: 1900, 2: 1000}))
    assert len(found.objects) == 1


def test_a_long_rod_and_a_hollow_box_stay_whole():
    shape = (60, 60, 120)
    truth = np.zeros(shape, np.int32)
    truth[box(shape, (5, 5, 5), (15, 15, 115))] = 1
    truth[box(shape, (25, 10, 20), (55, 55, 100))] = 2
    cavity = box(shape, (29, 14, 24), (51, 51, 96))
    # The air in a closed box belongs to the box.
    found = segment(scanned(np.where(cavity, 0, truth), {1: 1000, 2: 900}))
    assert score(truth, found.labels)["f1_75"] == 1.0


def test_cuts_find_things_apart_that_are_just_as_large_as_asked_for():
    shape = (30, 40, 50)
    truth = sum(
        (k + 1) * box(shape, (z, y, x), (z + 9, y + 9, x + 9)).astype(np.int32)
        for k, (z, y, x) in enumerate([(5, 5, 5), (5, 25, 8), (17, 8, 34)])
    )
    found = segment(scanned(truth, dict.fromkeys((1, 2, 3), 900)), method="cuts", smallest=500)
    assert score(truth, found.labels)["f1"] == 1.0


def test_the_table_of_objects_tells_what_was_put_in():
    shape = (40, 50, 60)
    spacing = (2.0, 1.0, 0.5)
    truth = box(shape, (10, 10, 10), (20, 30, 50)).astype(np.int32)
    found = segment(scanned(truth, {1: 1000}, noise=5, blur=0.01), spacing, method="cuts")
    (row,) = found.objects.itertuples()
    assert row.Index == 1
    assert row.voxels == 8000
    assert row.volume_mm3 == pytest.approx(8000.0)
    assert row.mean_density == pytest.approx(1000, abs=2)
    assert (row.z, row.y, row.x) == pytest.approx((14.5 * 2, 19.5, 29.5 * 0.5))
    # A box of 20 x 20 x 20 mm: 6 * 400 / 8000.
    assert row.isoperimetric_ratio == pytest.approx(0.3)
    assert 0 <= row.confidence <= 1
    assert found.labels.dtype == np.int32


@pytest.fixture(scope="module")
def reports():
    """Return what was told while `few` was segmented, with slabs of a sixteenth of it."""
    return []


@pytest.fixture(scope="module")
def few(reports):
    """Return a small packed volume and what is found in it."""
    truth, densities = packed(3, (64, 64, 64), 6, 12)
    volume = scanned(truth, densities)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tasks, "VOXELS_PER_CHECK", volume.size // 16)
        return volume, segment(volume, progress=lambda *told: reports.append(told))


def test_every_stage_checks_at_every_slab_and_progress_never_falls(few, reports):
    # Of 16 slabs: each of the six stages goes over the volume that often at least, or over so
    # many objects. A kernel that takes the volume whole again would be missed here.
    checks = Counter(text for _, text in reports)
    assert checks["Drawing borders"] >= 3 * 16
    assert checks["Merging parts"] >= 8 * 16
    assert checks["Drawing fine borders"] >= 2 * 16
    assert checks["Measuring objects"] >= len(few[1].objects)
    fractions = [fraction for fraction, _ in reports]
    assert (np.diff(fractions) >= 0).all()
    # Steps within steps begin and end at one fraction; a bar that stands while something goes over
    # all 16 slabs would tell one fraction as often.
    assert max(len(list(told)) for _, told in groupby(fractions)) < 8


def test_what_was_found_is_told_in_a_line(few):
    found = few[1]
    count = len(found.objects)
    assert repr(found) == f"Segmentation({count} objects in (64, 64, 64) voxels)"
    assert repr(replace(found, objects=found.objects[:1])).startswith("Segmentation(1 object in")


def test_ids_run_from_the_largest_object_to_the_smallest_without_gaps(few):
    _, found = few
    counts = np.bincount(found.labels.reshape(-1))[1:]
    assert (counts > 0).all()
    assert (np.diff(counts) <= 0).all()
    assert found.objects.index.tolist() == list(range(1, len(counts) + 1))


def test_the_same_volume_gives_the_same_labels(few):
    volume, found = few
    np.testing.assert_array_equal(segment(volume).labels, found.labels)


@pytest.mark.parametrize(
    "otherwise",
    [
        lambda v: v * 1e-30,
        lambda v: v * 1e300,
        lambda v: v + 1e9,
        lambda v: v.astype(np.int64) << 46,
        lambda v: (v * 1e-35).astype(np.float32),
    ],
    ids=["tiny", "huge", "far from zero", "long integers", "tiny float32"],
)
def test_scale_and_offset_of_the_values_do_not_matter(few, otherwise):
    volume, found = few
    np.testing.assert_array_equal(
        segment(otherwise(np.rint(volume).astype(np.float64))).labels, found.labels
    )


@pytest.mark.parametrize(
    "wrong",
    [
        {"smallest": np.nan},
        {"smallest": -1.0},
        {"smallest": "x"},
        {"step": 0.0},
        {"step": np.inf},
        {"working": 0},
        {"working": -3},
    ],
)
def test_sizes_that_mean_nothing_are_refused(few, wrong):
    (name,) = wrong
    with pytest.raises((ValueError, TypeError), match=f"{name} must be a .*, got"):
        segment(few[0], **wrong)


def beads(shape: tuple[int, int, int], radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Return labels and densities of beads that touch, piled up almost like cannon balls."""
    rng, side = np.random.default_rng(1), 2 * radius
    labels, densities = np.zeros(shape, np.int32), [20.0]
    grid = np.indices(shape)
    first, ends = radius + 3, np.array(shape) - radius - 2
    for i, z in enumerate(np.arange(first, ends[0], 0.82 * side)):
        for j, y in enumerate(np.arange(first + i % 2 * radius, ends[1], 0.87 * side)):
            for x in np.arange(first + (i + j) % 2 * radius, ends[2], side):
                center = np.array([z, y, x]) + rng.normal(0, 0.08 * radius, 3)
                near = ((grid - center.reshape(3, 1, 1, 1)) ** 2).sum(0)
                inside = near < (radius * rng.uniform(0.85, 1.0)) ** 2
                labels[inside & (labels == 0)] = len(densities)
                densities.append(1500.0 + rng.normal(0, 60))
    return labels, np.array(densities)


def jar(shape: tuple[int, int, int], radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Return what a scanner makes of beads, and their labels."""
    truth, densities = beads(shape, radius)
    density = ndimage.gaussian_filter(densities[truth].astype(np.float32), 0.7)
    density += np.random.default_rng(2).normal(0, 30, density.shape)
    return np.clip(density, 0, None).astype(np.uint16), truth


def test_beads_that_touch_are_found_one_by_one_though_no_bag_has_so_many_small_things():
    volume, truth = jar((60, 60, 60), 6.5)
    # Merging parts, as in a bag, left less than 0.6 of it.
    found = segment(volume, oracle=sure, working=volume.size)
    assert score(truth, found.labels)["f1"] > 0.97


def test_beads_too_small_for_their_voxels_are_looked_for_between_these():
    volume, truth = jar((24, 40, 40), 4.2)
    found = segment(volume, oracle=sure)
    assert score(truth, found.labels)["f1"] > 0.9
    assert found.evidence is not None
    assert found.evidence.pieces.shape == volume.shape
    as_it_is = segment(volume, oracle=sure, working=volume.size)
    assert score(truth, as_it_is.labels)["f1"] < 0.2


def test_beads_in_thick_slices_are_looked_for_between_these():
    volume, truth = jar((42, 34, 34), 6.5)
    thick = volume.reshape(14, 3, 34, 34).mean(axis=1).astype(np.uint16)
    found = segment(thick, (3.0, 1.0, 1.0), oracle=sure)
    assert score(truth[1::3], found.labels)["f1"] > 0.9
    as_it_is = segment(thick, (3.0, 1.0, 1.0), oracle=sure, working=volume.size)
    assert score(truth[1::3], as_it_is.labels)["f1"] < 0.2


def test_beads_too_small_for_the_reduced_volume_are_looked_for_on_a_finer_one(monkeypatch):
    volume, truth = jar((60, 60, 60), 6.5)
    monkeypatch.setattr(pipeline, "WORKING_VOXELS", 30**3)
    # On the reduced one F1 is below 0.1.
    assert score(truth, segment(volume, oracle=sure).labels)["f1"] > 0.97
    few = segment(volume, oracle=sure, working=30**3)
    assert score(truth, few.labels)["f1"] < 0.5


def test_beads_below_the_size_of_the_least_object_of_a_bag_stay_apart_unless_it_is_asked_for():
    # Of up to 460 voxels.
    volume, truth = jar((48, 48, 48), 4.8)
    by_default, asked = (
        segment(volume, oracle=sure, smallest=s, working=volume.size) for s in (None, 500.0)
    )
    assert len(by_default.objects) > 1.5 * len(asked.objects)
    # The network sees little in so few voxels.
    assert score(truth, by_default.labels)["f1"] > 2 * score(truth, asked.labels)["f1"]


@pytest.mark.parametrize(("side", "fewest"), [(7, 100), (9, 500)])
def test_a_size_that_much_of_the_matter_is_below_is_no_measure_of_it(side, fewest):
    labels = np.zeros((40, 60, 60), np.int32)
    labels[box(labels.shape, (2, 2, 2), (18, 18, 18))] = 1
    for k in range(5):
        labels[box(labels.shape, (25, 2, 2 + 11 * k), (25 + side, 2 + side, 2 + 11 * k + side))] = (
            k + 2
        )
    assert fewest_voxels(labels, 500.0) == fewest


def test_specks_are_dropped_and_ten_thousand_of_them_do_not_hang():
    volume = np.random.default_rng(0).normal(0, 10, (64, 64, 64))
    volume[::3, ::3, ::3] = 1000
    volume[24:48, 24:48, 24:48] = 1000
    # So many specks are taken for noise, unless it is said that there is none.
    assert len(segment(volume).objects) == 1
    found = segment(volume, grainy=False)
    assert len(found.objects) == 1
    # On three of its faces the cube touches eight by eight specks, which are part of it.
    assert found.objects.voxels[1] == pytest.approx(24**3 + 3 * 8**2, rel=0.02)


def test_one_object_that_fills_all_but_a_corner_is_one_object():
    volume = np.full((24, 24, 24), 1000.0)
    volume[:2, :2, :2] = 0
    assert len(segment(volume).objects) == 1


def test_a_volume_with_only_specks_says_what_to_do():
    volume = np.zeros((20, 20, 20))
    volume[10, 10, 10] = 1000
    with pytest.raises(ValueError, match="smallest="):
        segment(volume)


def test_progress_rises_to_one_and_raising_in_it_cancels():
    truth = two_balls()
    volume = scanned(truth, {1: 1000, 2: 1000})
    heard = []
    segment(volume, progress=lambda fraction, text: heard.append((fraction, text)))
    fractions = [fraction for fraction, _ in heard]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    assert all(text for _, text in heard)

    def cancel(fraction, text):
        if text.startswith("Merging"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        segment(volume, progress=cancel)


def test_an_oracle_decides_about_cuts_and_gives_the_confidence():
    volume = scanned(two_balls(), {1: 1000, 2: 1000})
    asked = []

    def likes_them_large(region):
        asked.append(region.voxels)
        return min(region.voxels / 50_000, 1.0)

    whole = segment(volume, oracle=likes_them_large, method="cuts")
    assert len(whole.objects) == 1
    assert len(asked) > 2
    assert whole.objects.confidence[1] == pytest.approx(min(max(asked) / 50_000, 1.0), rel=0.01)
    apart = segment(
        volume, oracle=lambda region: 1.0 if region.voxels < 25_000 else 0.0, method="cuts"
    )
    assert len(apart.objects) == 2


def test_without_cuts_an_oracle_gives_the_confidence_and_changes_no_object():
    volume = scanned(two_balls(), {1: 1000, 2: 1400})
    alone = segment(volume)
    judged = segment(volume, oracle=lambda region: 0.25 if region.values.mean() < 1200 else 7)
    np.testing.assert_array_equal(judged.labels, alone.labels)
    assert sorted(judged.objects.confidence) == [0.25, 1.0]
    with pytest.raises(TypeError, match=r"function of a region, as Oracle\.load gives, got 5"):
        segment(volume, oracle=5)


@pytest.mark.parametrize(
    "volume", [np.zeros((3, 3)), np.zeros((3, 3, 3)), np.full((3, 3, 3), np.nan)]
)
def test_bad_volumes_are_refused(volume):
    with pytest.raises(ValueError, match="volume"):
        segment(volume)


def test_bad_spacing_is_refused():
    with pytest.raises(ValueError, match="spacing"):
        segment(np.arange(27.0).reshape(3, 3, 3), (1, 0, 1))


def test_what_is_too_small_is_refused_with_both_limits():
    volume = np.random.default_rng(0).normal(0, 5, (24, 24, 24)).astype(np.float32)
    volume[10:14, 10:14, 10:14] += 1000
    # Of 64 voxels.
    with pytest.raises(ValueError, match=r"has 0 mm\^3 and 100 voxels; .*shell=False") as told:
        segment(volume, smallest=0)
    assert "supports=False" in str(told.value)
