"""One volume block by block on the workers of a real cluster: the same labels, little memory."""

from __future__ import annotations

import logging
import signal
import time
import tracemalloc
from pathlib import Path
from threading import Lock
from typing import Any

import dask.array as da
import numpy as np
import pytest
import zarr
from dask_pair import Pair, make_bag
from typer.testing import CliRunner

import napari_unpack as nu
from napari_unpack.cli import app
from napari_unpack.geometry.coarser_labels import halved
from napari_unpack.io import load_labels
from napari_unpack.io.ome_zarr import write_labels_zarr
from napari_unpack.segmentation import large_volumes, pipeline
from napari_unpack.segmentation.block_workers import BlockWorkers
from napari_unpack.segmentation.common.array_source import blocks, grown, source_of
from napari_unpack.segmentation.common.block_jobs import BlockJob
from napari_unpack.segmentation.foreground.thresholds import Levels
from napari_unpack.segmentation.label_upsampling import grid_labels, refined
from napari_unpack.segmentation.overlapping_blocks import find_in_blocks
from napari_unpack.tasks import SILENT

distributed = pytest.importorskip("distributed")
SIDE, MM = 96, (1.0, 1.0, 1.0)


@pytest.fixture(scope="module")
def volume() -> np.ndarray:
    """Balls of two densities in air, and noise."""
    at = np.indices((SIDE,) * 3)
    volume = np.random.default_rng(0).normal(60, 20, (SIDE,) * 3)
    for n, center in enumerate(np.ndindex(2, 2, 2)):
        middle = 24 + 46 * np.array(center)
        inside = ((at - middle[:, None, None, None]) ** 2).sum(axis=0) < 18**2
        volume[inside] += 1100 if n % 2 else 1500
    return np.clip(volume, 0, None).astype(np.uint16)


@pytest.fixture(scope="module")
def stored(volume: np.ndarray, tmp_path_factory: pytest.TempPathFactory) -> Any:
    place = tmp_path_factory.mktemp("volume") / "in.zarr"
    return zarr.create_array(str(place), data=volume, chunks=(32,) * 3)


def test_labels_are_those_of_one_machine_whatever_the_blocks(
    volume: np.ndarray, stored: Any, client: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted = nu.segment(volume, MM, working=48**3)
    assert len(wanted.objects) == 8
    out = zarr.open_array(str(tmp_path / "out.zarr"), mode="w", shape=volume.shape, dtype="i4")
    monkeypatch.setattr(large_volumes, "BLOCK", 50_000)
    found = nu.segment(stored, MM, working=48**3, out=out, client=client)
    assert np.array_equal(out[...], wanted.labels)
    np.testing.assert_allclose(found.objects, wanted.objects, rtol=1e-9)


def test_objects_found_in_blocks_on_workers_are_those_found_here(
    volume: np.ndarray, stored: Any, client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pipeline, "WORKING_VOXELS", 500_000)
    monkeypatch.setitem(find_in_blocks.__kwdefaults__, "most", 64 * 96 * 96)
    monkeypatch.setitem(find_in_blocks.__kwdefaults__, "overlap", 32)
    wanted = nu.segment(volume, MM, working=SIDE**3)
    assert len(wanted.objects) == 8
    found = nu.segment(stored, MM, working=SIDE**3, client=client)
    assert np.array_equal(found.labels, wanted.labels)


BLOCK, WHOLE = 40_000, SIDE**3
LIMIT = 20 * 60_000 + (6 << 20)
"""Bytes: 20 a voxel of a block with those around it, and a tile of the network, which all of the
reduced volume fits into."""


def test_the_peak_of_a_worker_follows_its_blocks_and_not_the_volume(
    stored: Any, client: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = zarr.open_array(str(tmp_path / "out.zarr"), mode="w", shape=stored.shape, dtype="i4")
    peaks = {}
    # Kernels are loaded with the first, which takes memory once.
    for block in (BLOCK, BLOCK, WHOLE):
        monkeypatch.setattr(large_volumes, "BLOCK", block)
        client.run(tracemalloc.start)
        try:
            nu.segment(stored, MM, working=48**3, out=out, client=client)
            traced = client.run(tracemalloc.get_traced_memory)
        finally:
            client.run(tracemalloc.stop)
        peaks[block] = max(peak for _, peak in traced.values())
    assert peaks[BLOCK] < LIMIT < peaks[WHOLE]


class Camera:
    """A volume that can be read here alone, whatever its attributes are called."""

    def __init__(self, volume: np.ndarray) -> None:
        self._volume, self.shape, self.dtype = volume, volume.shape, volume.dtype
        self.store = self.dask = Lock()

    def __getitem__(self, box: Any) -> np.ndarray:
        return self._volume[box]


@pytest.mark.parametrize("kind", ["array", "zarr", "dask", "camera"])
def test_a_worker_holds_its_block_and_no_more(
    volume: np.ndarray, stored: Any, client: Any, kind: str
) -> None:
    # Within this test, so that it is sent and not looked up by the worker.
    def held(source: Any, _share: Any) -> tuple[tuple[int, ...], int]:
        return source.array.block.shape, int(source.array.block.sum())

    kinds = {
        "array": volume,
        "zarr": stored,
        "dask": da.from_zarr(stored),
        "camera": Camera(volume),
    }
    array = kinds[kind]
    places = list(blocks(volume.shape, (2, 2, 2), 40**3))
    boxes = [grown(box, 2, volume.shape) for box, _ in places]
    jobs = (BlockJob(held, box, ()) for box in boxes)
    found = list(BlockWorkers(client).run(source_of(array), jobs, len(boxes), SILENT))
    assert found == [(volume[box].shape, int(volume[box].sum())) for box in boxes]


def test_a_part_of_the_grid_labels_a_block_as_all_of_it_does(volume: np.ndarray) -> None:
    factors = (4, 3, 2)
    shape = tuple(n // f for n, f in zip(volume.shape, factors, strict=True))
    means = volume.reshape(shape[0], 4, shape[1], 3, shape[2], 2).mean(axis=(1, 3, 5))
    names = np.where(means > 600, 1 + (np.indices(shape) // 12).sum(axis=0), 0).astype(np.int32)
    whole = grid_labels(names, means, means < -1, factors, Levels(60.0, 20.0, 400.0, 700.0))
    source = source_of(volume)
    for box, cells in blocks(volume.shape, factors, 30_000):
        part = whole.around(cells)
        assert part.labels.size < 0.2 * whole.labels.size
        for one, other in zip(
            refined(source, whole, box, cells), refined(source, part, box, cells), strict=True
        ):
            assert np.array_equal(one, other)


def test_zarr_becomes_a_label_image_on_a_cluster(
    volume: np.ndarray, pair: Any, client: Any, tmp_path: Path
) -> None:
    small, out = volume[:48, :48, :48], tmp_path / "labels.zarr"
    zarr.create_array(str(tmp_path / "in.zarr"), data=small, chunks=(32,) * 3)
    words = ["segment", tmp_path / "in.zarr", out, "--csv", tmp_path / "objects.csv"]
    told = CliRunner().invoke(app, [*map(str, words), "--scheduler", str(pair.file)])
    assert told.exit_code == 0, told.output
    assert "note: in.zarr: it gives no voxel size: 1 mm was assumed" in told.stderr
    labels, spacing = load_labels(out)
    assert spacing == MM
    assert np.array_equal(labels, nu.segment(small, MM).labels)
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "mine.txt").write_text("mine")
    (tmp_path / "notes").rename(tmp_path / "notes.zarr")
    # What a person has put among older labels is no less theirs.
    (out / "mine.txt").write_text("mine")
    for there in (tmp_path / "notes.zarr", out):
        again = CliRunner().invoke(app, ["segment", str(tmp_path / "in.zarr"), str(there)])
        assert again.exit_code == 1
        assert "holds something else" in again.output
        assert (there / "mine.txt").read_text() == "mine"


def test_how_finely_objects_are_looked_for_is_told_in_millions_of_voxels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    array = zarr.create_array(str(tmp_path / "in.zarr"), shape=(9, 9, 9), dtype="u2")
    asked: list[int | None] = []

    def asked_for(*_: Any, working: int | None, **__: Any) -> Any:
        asked.append(working)
        raise ValueError("enough")

    monkeypatch.setattr("napari_unpack.segmentation.segment", asked_for)
    words = ["segment", str(array.store.root), str(tmp_path / "labels.zarr")]
    for more in ([], ["--working", "270"]):
        assert CliRunner().invoke(app, [*words, *more]).exit_code == 1
    assert asked == [None, 270_000_000]


@pytest.mark.parametrize("option", ["--scheduler", "--workers", "--working"])
def test_what_only_zarr_outputs_obey_is_refused_for_others(tmp_path: Path, option: str) -> None:
    make_bag(tmp_path / "bag.npz", 0)
    words = ["segment", str(tmp_path / "bag.npz"), str(tmp_path / "labels.npz"), option, "2"]
    told = CliRunner().invoke(app, words)
    assert told.exit_code == 1
    assert f"error: {option} is for Zarr outputs" in told.output
    assert not (tmp_path / "labels.npz").exists()


@pytest.fixture
def empty_zarr(tmp_path: Path) -> Path:
    zarr.create_array(str(tmp_path / "in.zarr"), shape=(9, 9, 9), dtype="u2")
    return tmp_path / "in.zarr"


def test_a_block_that_ends_every_worker_is_told_in_a_sentence(
    empty_zarr: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import dask

    def ending(*_: Any, client: Any, **__: Any) -> Any:
        return client.submit(signal.raise_signal, signal.SIGKILL).result()

    monkeypatch.setattr("napari_unpack.segmentation.segment", ending)
    with dask.config.set({"distributed.scheduler.allowed-failures": 0}):
        told = CliRunner().invoke(
            app, ["segment", str(empty_zarr), str(tmp_path / "labels.zarr"), "--workers", "1"]
        )
    assert told.exit_code == 1
    assert "error: a block's workers ended again and again" in told.output
    assert "fewer --workers" in told.output
    assert [path.name for path in tmp_path.iterdir()] == ["in.zarr"]


def test_a_lost_cluster_is_told_in_a_sentence_and_no_traceback(
    empty_zarr: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    for name in ("distributed", "distributed.client"):
        log = logging.getLogger(name)
        monkeypatch.setattr(log, "handlers", [*log.handlers, caplog.handler])
    (tmp_path / "dask").mkdir()
    own = Pair(tmp_path / "dask")
    own.worker()

    def losing(*_: Any, client: Any, **__: Any) -> Any:
        waiting = client.submit(time.sleep, 60)
        own.close()
        return waiting.result()

    monkeypatch.setattr("napari_unpack.segmentation.segment", losing)
    words = ["segment", str(empty_zarr), str(tmp_path / "labels.zarr")]
    told = CliRunner().invoke(app, [*words, "--scheduler", str(own.file)])
    assert told.exit_code == 1
    assert "error: the Dask cluster was lost, and nothing is written" in told.output
    assert caplog.text == ""
    assert not (tmp_path / "labels.zarr").exists()


def test_coarser_levels_of_labels_halve_and_keep_their_ids(tmp_path: Path) -> None:
    labels = np.random.default_rng(0).integers(0, 9, (5, 300, 130)).astype(np.int32)
    write_labels_zarr(tmp_path / "labels.zarr", labels, (2.0, 1.0, 0.5))
    read, spacing = load_labels(tmp_path / "labels.zarr")
    assert (spacing, read.shape) == ((2.0, 1.0, 0.5), labels.shape)
    assert np.array_equal(read, labels)
    node = zarr.open_group(str(tmp_path / "labels.zarr"), mode="r")
    (scale,) = node.attrs["multiscales"]
    assert [level["path"] for level in scale["datasets"]] == ["0", "1"]
    assert np.array_equal(node["1"][...], halved(labels))
    assert scale["datasets"][1]["coordinateTransformations"] == [
        {"type": "scale", "scale": [4.0, 2.0, 1.0]},
        {"type": "translation", "translation": [1.0, 0.5, 0.25]},
    ]
