"""Volumes worked on by way of a reduced grid: nearly the same labels, for any size of blocks."""

import importlib
import shutil
import tempfile
from collections import Counter
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import zarr
from phantoms import ball, box, scanned

from napari_unpack.segmentation import large_volumes, pipeline, segment
from napari_unpack.segmentation.common.array_source import blocks, source_of
from napari_unpack.segmentation.common.remote_volumes import read_once
from napari_unpack.segmentation.working_grid import reduced, reduction
from napari_unpack.tasks import Share

MM = (1.0, 1.0, 1.0)


class Stored:
    """A volume that can only be read in small pieces, and counts how often."""

    def __init__(self, array, most):
        self.array, self.most, self.read = array, most, 0
        self.shape, self.dtype = array.shape, array.dtype

    def __getitem__(self, box):
        block = self.array[box]
        assert block.size <= self.most, f"{block.size} voxels read at once"
        self.read += block.size
        return block

    def __array__(self, *_, **__):
        raise AssertionError("read as a whole")


def packed_shapes(scale=1):
    """Return truth and densities: a ball on a box, a box of another density beside that, a rod."""
    shape = tuple(n * scale for n in (48, 56, 80))
    truth = np.zeros(shape, np.int32)
    truth[box(shape, *(np.array(c) * scale for c in ((8, 28, 8), (40, 48, 40))))] = 1
    truth[box(shape, *(np.array(c) * scale for c in ((8, 28, 40), (40, 48, 72))))] = 2
    truth[ball(shape, np.array((24, 16.5, 24)) * scale, 12 * scale) & (truth == 0)] = 3
    truth[box(shape, *(np.array(c) * scale for c in ((20, 6, 44), (28, 14, 76))))] = 4
    return truth, {1: 900, 2: 1300, 3: 1500, 4: 2200}


def ious(truth, found):
    for name in range(1, truth.max() + 1):
        here = truth == name
        best = np.bincount(found[here])[1:].argmax() + 1
        yield (here & (found == best)).sum() / (here | (found == best)).sum()


class Far(zarr.storage.WrapperStore):
    """A store of which nobody knows where it is; it counts the chunks that are asked for."""

    def __init__(self, store):
        super().__init__(store)
        self.asked = Counter()

    async def get(self, key, prototype, byte_range=None):
        if "/c/" in f"/{key}":
            self.asked[key] += 1
        return await super().get(key, prototype, byte_range)


@pytest.mark.parametrize("block", [4000, 10**6])
def test_a_volume_far_away_is_read_once_and_leaves_nothing_behind(tmp_path, monkeypatch, block):
    truth, densities = packed_shapes()
    volume = scanned(truth, densities)
    monkeypatch.setattr(large_volumes, "BLOCK", block)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    wanted = segment(volume, MM, working=60_000)
    store = Far(zarr.storage.MemoryStore())
    # Chunks that fall on no face of a block, the last of them cut short.
    far = zarr.create_array(store, data=volume, chunks=(10, 15, 17))
    found = segment(far, MM, working=60_000)
    np.testing.assert_array_equal(found.labels, wanted.labels)
    pd.testing.assert_frame_equal(found.objects, wanted.objects)
    assert set(store.asked.values()) == {1}
    assert len(store.asked) == 5 * 4 * 5
    assert list(tmp_path.iterdir()) == []
    # One that is here is read where it is, by each who needs it.
    near = zarr.create_array(zarr.storage.MemoryStore(), data=volume, chunks=(10, 15, 17))
    with read_once(source_of(near)) as source:
        assert source.array is near


def test_a_volume_far_away_for_which_there_is_no_room_is_refused(monkeypatch):
    far = zarr.create_array(Far(zarr.storage.MemoryStore()), shape=(64,) * 3, dtype="u2")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=1000))
    with pytest.raises(OSError, match=r"needs about 524 kB, but \S+ has 1 kB free"):
        segment(far, MM, working=1000)


def test_the_finer_axes_are_reduced_first_and_no_more_than_needed():
    assert reduction((512, 512, 1024), MM, 12_000_000) == (3, 3, 3)
    assert reduction((100, 100, 100), MM, 10**6) == (1, 1, 1)
    assert reduction((40, 400, 400), (5.0, 1.0, 1.0), 40 * 80 * 80) == (1, 5, 5)
    assert reduction((1, 10, 10**6), MM, 1000)[0] == 1
    for most in (1, 17, 4000):
        factors = reduction((30, 50, 70), (1.0, 2.0, 0.5), most)
        assert np.prod([-(-n // f) for n, f in zip((30, 50, 70), factors, strict=True)]) <= most


@pytest.mark.parametrize("most", [1, 60, 1000, 10**6])
def test_blocks_cover_every_voxel_once_and_are_no_larger_than_asked(most):
    shape, factors = (11, 13, 17), (2, 3, 4)
    seen = np.zeros(shape, int)
    grid = np.zeros((6, 5, 5), int)
    for place, cells in blocks(shape, factors, most):
        seen[place] += 1
        grid[cells] += 1
        assert seen[place].size <= max(most, 24)
        assert all(s.start == c.start * f for s, c, f in zip(place, cells, factors, strict=True))
    assert (seen == 1).all()
    assert (grid == 1).all()


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.float16, np.float64, ">u2", bool])
def test_cells_are_means_of_what_was_measured(dtype):
    rng = np.random.default_rng(0)
    volume = rng.integers(0, 200, (5, 7, 9)).astype(dtype)
    expected = np.zeros((3, 3, 3))
    kept = volume.astype(np.float64)
    if volume.dtype.kind == "f":
        volume[0, 0, :] = np.nan
        volume[1, 1, 0] = np.inf
        kept = np.where(np.isfinite(volume), volume.astype(np.float64), np.nan)
    for k, j, i in np.ndindex(3, 3, 3):
        expected[k, j, i] = np.nanmean(
            kept[2 * k : 2 * k + 2, 3 * j : 3 * j + 3, 3 * i : 3 * i + 3]
        )
    for most in (1, 10**6):
        grid = reduced(source_of(volume), (1.0, 2.0, 3.0), (2, 3, 3), most)
        np.testing.assert_allclose(grid.density, expected, rtol=1e-6)
        assert grid.spacing == (2.0, 6.0, 9.0)
        # Infinities say as well that nothing was measured.
        np.testing.assert_array_equal(grid.sample, kept)


@pytest.mark.parametrize(("factor", "least"), [(2, 0.96), (3, 0.93)])
def test_labels_refined_from_a_reduced_grid_are_nearly_the_truth(factor, least):
    truth, densities = packed_shapes(2)
    # So that faces fall between the grid's cells.
    truth = np.roll(truth, (1, 1, 1), axis=(0, 1, 2))
    volume = scanned(truth, densities)
    cells = np.prod([-(-n // factor) for n in truth.shape])
    found = segment(volume, MM, working=int(cells), method="cuts")
    assert len(found.objects) == 4
    assert min(ious(truth, found.labels)) >= least
    # Far better than the grid's own labels are when they are merely enlarged.
    coarse = segment(reduced(source_of(volume), MM, (factor,) * 3).density, (factor,) * 3).labels
    for axis in range(3):
        coarse = np.repeat(coarse, factor, axis)
    plain = coarse[tuple(slice(n) for n in truth.shape)]
    assert np.mean(list(ious(truth, found.labels))) > np.mean(list(ious(truth, plain))) + 0.02


def test_the_table_tells_what_the_labels_hold():
    truth, densities = packed_shapes(2)
    spacing = (0.5, 1.0, 2.0)
    found = segment(scanned(truth, densities), spacing, working=60_000)
    names, counts = np.unique(found.labels[found.labels > 0], return_counts=True)
    assert found.objects.index.tolist() == names.tolist() == list(range(1, len(names) + 1))
    assert found.objects.voxels.tolist() == counts.tolist()
    assert (np.diff(counts) <= 0).all()
    for name, row in found.objects.iterrows():
        center = np.argwhere(found.labels == name).mean(axis=0) * spacing
        assert (row.z, row.y, row.x) == pytest.approx(tuple(center))
        padded = np.pad(found.labels == name, 1)
        faces = [np.count_nonzero(np.diff(padded, axis=a)) for a in range(3)]
        area = np.dot(faces, (2.0, 1.0, 0.5))
        assert row.isoperimetric_ratio == pytest.approx(area / row.volume_mm3)
        assert 0 <= row.confidence <= 1


def test_the_result_does_not_depend_on_the_size_of_blocks(monkeypatch):
    truth, densities = packed_shapes()
    volume = scanned(truth, densities)
    whole = segment(volume, MM, working=20_000)
    for most in (500, 7_000):
        monkeypatch.setattr(large_volumes, "BLOCK", most)
        pieces = segment(volume, MM, working=20_000)
        np.testing.assert_array_equal(pieces.labels, whole.labels)
        np.testing.assert_allclose(pieces.objects, whole.objects, rtol=1e-9)


def test_a_stored_volume_is_never_read_whole_and_labels_go_where_they_should(monkeypatch, tmp_path):
    truth, densities = packed_shapes()
    volume = scanned(truth, densities)
    most = 20_000
    monkeypatch.setattr(large_volumes, "BLOCK", most)
    # A block is read with two voxels around it.
    stored = Stored(volume, 2 * most)
    out = np.lib.format.open_memmap(tmp_path / "labels.npy", "w+", np.uint16, volume.shape)
    found = segment(stored, MM, working=20_000, out=out)
    assert found.labels is out
    assert stored.read < 5 * volume.size
    np.testing.assert_array_equal(out, segment(volume, MM, working=20_000).labels)


@pytest.mark.parametrize("kind", ["zarr", "dask"])
def test_zarr_and_dask_arrays_are_taken(kind):
    library = importlib.import_module(kind if kind == "zarr" else "dask.array")
    truth, densities = packed_shapes()
    volume = scanned(truth, densities)
    if kind == "zarr":
        stored = library.create_array({}, data=volume, chunks=(16, 32, 32))
        out = library.create_array({}, shape=volume.shape, dtype="int32", chunks=(16, 32, 32))
    else:
        stored, out = library.from_array(volume, chunks=(16, 32, 32)), None
    for working in (20_000, 10**7):
        found = segment(stored, MM, working=working, out=out)
        expected = segment(volume, MM, working=working).labels
        np.testing.assert_array_equal(np.asarray(found.labels[:]), expected)


def test_a_wire_that_the_grid_does_not_show_is_found_and_noise_is_not():
    truth, densities = packed_shapes(2)
    truth[86:88, 20:22, 8:152] = 5
    truth[3, 3, ::3] = 6
    volume = scanned(truth, {**densities, 5: 700, 6: 700}, blur=0.3)
    found = segment(volume, MM, working=int(truth.size / 60)).labels
    wire = found[86:88, 20:22, 8:152]
    name = np.bincount(wire.reshape(-1)).argmax()
    assert name > 0
    assert (wire == name).mean() > 0.9
    assert (found == name).sum() < 1.5 * wire.size
    # Single voxels are no object.
    assert not found[3, 3, ::3].any()
    assert (found[truth == 0] > 0).mean() < 0.02


def test_cells_that_are_not_cubes():
    shape = (24, 112, 160)
    truth = np.zeros(shape, np.int32)
    truth[box(shape, (4, 20, 20), (20, 92, 80))] = 1
    truth[box(shape, (4, 20, 80), (20, 92, 140))] = 2
    volume = scanned(truth, {1: 900, 2: 1500})
    found = segment(volume, (4.0, 1.0, 1.0), working=24 * 28 * 40, method="cuts")
    assert len(found.objects) == 2
    assert min(ious(truth, found.labels)) > 0.95


@pytest.mark.parametrize(
    ("out", "kind", "words"),
    [
        (np.zeros((4, 4, 4), np.int32), ValueError, "volume's shape"),
        (np.zeros((48, 56, 80), np.float32), TypeError, "integers of 16 bits"),
        (np.zeros((48, 56, 80), np.uint8), TypeError, "integers of 16 bits"),
        ([1, 2], TypeError, "integers of 16 bits"),
    ],
)
def test_labels_cannot_go_just_anywhere(out, kind, words):
    truth, densities = packed_shapes()
    with pytest.raises(kind, match=words):
        segment(scanned(truth, densities), MM, out=out)


@pytest.mark.parametrize("large", [False, True])
def test_an_array_of_too_few_bits_for_all_objects_is_refused(monkeypatch, large):
    volume = scanned(*packed_shapes())
    ranked = pipeline.rank_labels
    monkeypatch.setattr(pipeline, "rank_labels", lambda labels: 20_000 * ranked(labels))
    out = np.zeros(volume.shape, np.int16)
    with pytest.raises(ValueError, match=r"out of int16 cannot hold \d+0000 objects; .* int32"):
        segment(volume, MM, working=20_000 if large else 10**7, out=out)


@pytest.mark.parametrize("value", [-0.0, np.nan])
def test_a_large_volume_of_nothing_is_refused(value):
    with pytest.raises(ValueError, match="constant .0 " if value == 0 else "no finite value"):
        segment(np.full((20, 20, 20), value), MM, working=500)


@pytest.mark.parametrize("given", [{"method": "cuts"}, {"working": 20_000}])
def test_the_slow_method_and_a_size_that_is_asked_for_stay_on_one_grid(monkeypatch, given):
    monkeypatch.setattr(pipeline, "WORKING_VOXELS", 20_000)
    monkeypatch.setattr(large_volumes, "finer_grid", lambda *_: pytest.fail("looked closer"))
    volume = scanned(*packed_shapes())
    assert len(segment(volume, MM, **given).objects) > 1
    with pytest.raises(pytest.fail.Exception, match="looked closer"):
        segment(volume, MM)


def test_cancelling_stops_the_threads_that_refine(monkeypatch):
    truth, densities = packed_shapes()
    stored = Stored(scanned(truth, densities), 4_000)
    monkeypatch.setattr(large_volumes, "BLOCK", 500)
    read = []

    def cancel(fraction, text):
        if text == "Refining the borders" and fraction > 0.7:
            read.append(stored.read)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        segment(stored, MM, progress=cancel, working=20_000)
    # What was being read then, and nothing that waited.
    assert stored.read - read[0] <= 9 * stored.most


def test_cancelling_stops_the_refinement():
    truth, densities = packed_shapes()

    def cancel(fraction, text):
        if text.startswith("Refining"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        segment(scanned(truth, densities), MM, progress=cancel, working=20_000)


def test_labels_without_an_object_are_measured_as_a_table_without_rows():
    volume = np.ones((4, 4, 4), np.uint8)
    none = np.zeros(0, np.int64)
    table = large_volumes.measured_objects(
        source_of(volume), np.zeros((4, 4, 4), np.int32), none, MM, Share()
    )
    assert len(table) == 0
    assert "volume_mm3" in table
