"""Infinities, masks and NaN say that nothing was measured; CT numbers are densities as well."""

from __future__ import annotations

import importlib
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import napari_unpack as nu
from napari_unpack.io import Scan, load_labels, load_volume, save_scan
from napari_unpack.segmentation.common.validation import padding_of
from napari_unpack.segmentation.foreground.scanner_table import measured_section
from napari_unpack.segmentation.foreground.thresholds import find_levels
from napari_unpack.segmentation.training import oracle_examples
from napari_unpack.session.object_facts import reasons_of


@cache
def boxes() -> np.ndarray:
    volume = np.random.default_rng(0).normal(0, 5, (40, 40, 40)).astype(np.float32)
    volume[5:18, 5:18, 5:18] += 1000
    volume[20:36, 8:30, 20:34] += 1500
    volume[22:34, 32:38, 4:16] += 700
    return volume


@cache
def bag() -> nu.simulation.Bag:
    return nu.simulate_bag(shape=(56, 64, 64), count=6, seed=1)


@cache
def confidence() -> np.ndarray:
    """Return how sure the oracle is of each object of the bag as it was scanned."""
    return nu.segment(bag().volume.astype(np.float32)).objects["confidence"].to_numpy()


@pytest.mark.parametrize("method", ["learned", "cuts"])
@pytest.mark.parametrize("nothing", [np.inf, -2000.0])
def test_infinities_and_padding_are_as_much_as_nan(method: str, nothing: float) -> None:
    found = []
    for value in (np.nan, nothing):
        volume = boxes() - 1000
        volume[:, :, 38:] = value
        found.append(nu.segment(volume, method=method))
    np.testing.assert_array_equal(found[0].labels, found[1].labels)
    np.testing.assert_array_equal(
        found[0].objects["mean_density"], found[1].objects["mean_density"]
    )
    assert np.isfinite(found[1].objects["mean_density"]).all()


@pytest.mark.parametrize("nothing", [np.inf, -32768])
def test_it_is_nothing_too_where_the_volume_is_read_in_blocks(nothing: float) -> None:
    known = boxes() - 1000
    volume = np.where(np.arange(40) < 38, known, nothing)
    if np.isfinite(nothing):
        volume = volume.astype(np.int16)
    assert len(nu.segment(volume, working=8000).objects) == len(
        nu.segment(known, working=8000).objects
    )


@pytest.mark.parametrize("value", [-1500, -3024, -32768])
def test_a_single_broken_voxel_moves_no_level(value: int) -> None:
    known = np.minimum(boxes() - 1000, 0)
    broken = known.copy()
    broken[30, 3, 3] = value
    assert find_levels(broken).air == pytest.approx(find_levels(known).air, abs=2)


def test_the_smallest_value_is_air_unless_it_is_far_below_air_and_all_others() -> None:
    noise = np.random.default_rng(1).normal(0, 60, boxes().shape)
    matter = np.where(boxes() > 500, 1000.0, 0.0)
    cut_out = matter - 2000
    cut_out[24:34, 24:34, 0:20] = -500
    for given in (
        cut_out,
        matter,
        matter - 1000,
        matter - 2000,
        boxes() - 1000 + noise,
        np.clip(noise, 0, None),
    ):
        assert padding_of(given) is None
        assert padding_of(given.astype(np.int16)) is None
    padded = (boxes() - 1000).astype(np.int16)
    padded[0] = -2000
    assert padding_of(padded) == padding_of(padded.astype(float)) == -2000


def test_the_circle_that_was_measured_is_found_whatever_is_beyond_it() -> None:
    y, x = np.ogrid[:40, :40]
    inside = np.hypot(y - 19.5, x - 19.5) <= 19.5
    found = [measured_section(np.where(inside, boxes(), n)) for n in (0, -2000, np.nan)]
    assert all(section is not None and (section == found[0]).all() for section in found)


def test_the_mean_is_that_of_what_was_measured() -> None:
    volume = boxes() + 1000
    volume[8:14, 8:14, 8:14] = np.nan
    found = nu.segment(volume)
    for i, mean in found.objects["mean_density"].items():
        assert mean == pytest.approx(np.nanmean(volume[found.labels == i], dtype=float), rel=1e-5)


def test_what_is_masked_is_nothing() -> None:
    masked = np.ma.array(boxes().copy(), mask=False)
    masked[24:34, 24:34, 0:20] = 9000
    masked[24:34, 24:34, 0:20] = np.ma.masked
    found = nu.segment(masked)
    assert found.objects["mean_density"].max() < 1600
    assert not found.labels[25:33, 25:33, 1:19].any()


def blotted() -> tuple[np.ndarray, np.ma.MaskedArray]:
    """Return a volume of whole numbers with NaN in a block, and one that is masked there."""
    known = boxes().astype(np.float32).round()
    masked = np.ma.array(known.astype(np.int32), mask=False)
    masked[8:14, 8:14, 8:14] = 9000
    masked[8:14, 8:14, 8:14] = np.ma.masked
    known[8:14, 8:14, 8:14] = np.nan
    return known, masked


def test_a_session_a_picture_a_score_and_an_oracle_see_nothing_of_what_is_masked() -> None:
    known, masked = blotted()
    objects = (boxes() > 500).astype(np.int32)
    hole = np.isnan(known)
    given = np.ma.array(np.where(hole, 7, objects), mask=hole)
    left = np.where(hole, 0, objects)
    session = nu.Session(masked, given)
    np.testing.assert_array_equal(session.volume, known)
    np.testing.assert_array_equal(session.labels, left)
    assert session.transfer_function == nu.Session(known, left).transfer_function
    pictures = [nu.render(v, ids, size=(24, 32), backend="cpu") for v, ids in (
        (masked, given), (known, left),
    )]  # fmt: skip
    np.testing.assert_array_equal(*pictures)
    assert nu.score(given, left) == nu.score(left, left)
    plain, hidden = (
        oracle_examples(SimpleNamespace(volume=v, labels=ids, spacing=(1.0, 1.0, 1.0)))
        for v, ids in ((known, left), (masked, given))
    )
    np.testing.assert_array_equal(plain[0], hidden[0])
    # Where nothing is masked, nothing becomes another type.
    assert nu.Session(masked.filled(0).view(np.ma.MaskedArray), left).volume.dtype == np.int32


@pytest.mark.parametrize("name", ["scan.npz", "scan.nii.gz", "scan.mha", "scan.tif"])
def test_files_hold_nothing_of_what_is_masked(tmp_path: Path, name: str) -> None:
    known, masked = blotted()
    hole = np.isnan(known)
    labels = np.ma.array(np.where(hole, 7, 1), mask=hole)
    files = save_scan(Scan(masked, (1.0, 1.0, 1.0), labels), tmp_path / name)
    np.testing.assert_array_equal(load_volume(files[0]).volume, known)
    np.testing.assert_array_equal(load_labels(files[-1])[0], ~hole)


def test_labels_do_not_go_into_the_volume_nor_into_what_is_read_only() -> None:
    volume = boxes().astype(np.int16)
    with pytest.raises(ValueError, match="another array than the volume"):
        nu.segment(volume, out=volume)
    locked = np.zeros(volume.shape, np.int32)
    locked.flags.writeable = False
    with pytest.raises(TypeError, match="read-only"):
        nu.segment(volume, out=locked)


def test_labels_do_not_go_into_the_file_that_the_volume_is_read_from(tmp_path: Path) -> None:
    zarr, dask = importlib.import_module("zarr"), importlib.import_module("dask.array")
    volume = boxes().astype(np.int32)
    stored = zarr.create_group(tmp_path / "scan.zarr").create_array("0", data=volume)
    again = zarr.open_array(tmp_path / "scan.zarr" / "0")
    memory = zarr.create_array({}, data=volume)
    np.save(tmp_path / "scan.npy", volume)
    mapped = np.load(tmp_path / "scan.npy", mmap_mode="r")[:]
    written = np.asarray(np.load(tmp_path / "scan.npy", mmap_mode="r+"))
    pairs = [(stored, stored), (stored, again), (dask.from_array(stored) + 1, stored)]
    pairs.append((dask.from_zarr(str(tmp_path / "scan.zarr"), component="0"), stored))
    for scan, out in [*pairs, (memory, memory), (mapped, written)]:
        with pytest.raises(ValueError, match="another array than the volume"):
            nu.segment(scan, out=out)
        assert (np.asarray(scan) - volume).std() == 0
    locked = zarr.open_array(tmp_path / "scan.zarr" / "0", mode="r")
    with pytest.raises(TypeError, match="read-only"):
        nu.segment(volume, out=locked)


def test_small_numbers_hold_the_same_objects() -> None:
    given, span = bag().volume, 1e-5
    found, known = nu.segment(given * (span / np.ptp(given))), nu.segment(given)
    # Rounding moves few voxels.
    assert np.count_nonzero(found.labels != known.labels) < 1e-3 * given.size
    # In the scan's own unit.
    share = found.objects["mean_density"] / known.objects["mean_density"]
    np.testing.assert_allclose(share, span / np.ptp(given), rtol=0.01)


@pytest.mark.parametrize("offset", [-1000.0, 10_000.0])
def test_confidence_depends_on_no_offset(offset: float) -> None:
    volume = bag().volume.astype(np.float32)
    known = confidence()
    moved = nu.segment(volume + offset).objects["confidence"].to_numpy()
    # Air is some CT numbers above 0 as it is, and at 0 once it is moved there.
    np.testing.assert_allclose(moved, known, atol=0.03)
    assert known.max() > 0.9


def test_the_method_of_the_paper_finds_the_same_in_ct_numbers() -> None:
    one = nu.simulate_bag(shape=(60, 64, 72), count=8, seed=3).volume.astype(np.float32)
    known, moved = (nu.segment(v, method="cuts").labels for v in (one, one - 1000))
    assert (known != moved).mean() < 0.001


def test_learning_and_reasons_know_no_offset_either() -> None:
    there = replace(bag(), volume=bag().volume.astype(np.float32) - 1000)
    for rows, moved in zip(oracle_examples(bag()), oracle_examples(there), strict=True):
        np.testing.assert_allclose(moved, rows, atol=0.05, rtol=0.05)
    names = []
    for one in (bag(), there):
        session = nu.Session(one.volume, one.labels, one.spacing)
        # The first: what is hardly unusual may be named or not, as air is some CT numbers above 0.
        names.append([reasons_of(session, i)[:1] for i in session.ids])
    assert names[0] == names[1]


def test_repairs_rate_by_no_offset_either() -> None:
    rated = []
    for offset in (0.0, -1000.0):
        volume = bag().volume.astype(np.float32) + offset
        session = nu.Session(volume, bag().labels, bag().spacing)
        session.merge(session.ids[:2])
        rated.append(session.objects["confidence"].to_numpy(float))
    np.testing.assert_allclose(rated[1], rated[0], atol=0.03)
