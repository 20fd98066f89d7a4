"""A cluster that is mistyped, has no worker, or is stopped while it starts, says so."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from threading import Thread, Timer
from time import monotonic, sleep
from typing import Any

import numpy as np
import psutil
import pytest
import zarr
from dask_pair import Pair, make_bag

import napari_unpack as nu
from napari_unpack.batches.cluster import cluster_client
from napari_unpack.batches.large_files import segment_zarr
from napari_unpack.segmentation.block_workers import BlockWorkers
from napari_unpack.segmentation.common.array_source import source_of
from napari_unpack.segmentation.common.block_jobs import BlockJob
from napari_unpack.tasks import Cancelled, Share

distributed = pytest.importorskip("distributed")


@pytest.fixture
def deserted(tmp_path: Path) -> Iterator[str]:
    """The file of a scheduler without workers."""
    (tmp_path / "dask").mkdir()
    own = Pair(tmp_path / "dask")
    yield str(own.file)
    own.close()


def stop_where_no_worker(sentence: str) -> None:
    """Stop once the person has been told."""
    if "no worker" in sentence:
        raise Cancelled


def test_who_waits_for_the_first_worker_is_told(tmp_path: Path, deserted: str) -> None:
    zarr.create_array(str(tmp_path / "in.zarr"), shape=(9, 9, 9), dtype="u2")
    with pytest.raises(Cancelled):
        segment_zarr(
            tmp_path / "in.zarr",
            tmp_path / "out.zarr",
            scheduler=deserted,
            say=stop_where_no_worker,
        )


def test_who_waits_for_blocks_that_no_worker_is_left_for_is_told(deserted: str) -> None:
    volume = np.zeros((4, 4, 4))
    job = BlockJob(lambda source, share: 1, (slice(0, 4),) * 3, ())
    share = Share(lambda _, text: stop_where_no_worker(text))
    with cluster_client([], scheduler=deserted) as client, pytest.raises(Cancelled):
        list(BlockWorkers(client).run(source_of(volume), iter([job]), 1, share))


def test_a_run_whose_last_worker_is_lost_says_so_and_goes_on_with_the_next(tmp_path: Path) -> None:
    own, said, done = Pair(tmp_path), list[str](), list[str]()
    victim = own.worker()
    inputs = [make_bag(tmp_path / f"{n}.npz", n) for n in range(3)]

    def say(sentence: str) -> None:
        said.append(sentence)
        if "lost its workers" in sentence:
            own.worker()

    def told(result: Any, *_: int) -> None:
        done.append(result.status)
        victim.kill()

    with cluster_client([], scheduler=str(own.file)) as client:
        client.wait_for_workers(1, timeout=60)
        run = partial(
            nu.batch, inputs, tmp_path / "out", client, say=say, told=told, pictures=False
        )
        work = Thread(target=run, daemon=True)
        work.start()
        work.join(90)
    own.close()
    assert said[1:] == ["the cluster has lost its workers: waiting for one"]
    # A result that was lost is made again, or found where the worker had written it.
    assert len(done) == 3
    assert set(done) <= {"done", "kept"}


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ("foo", "there is no scheduler file 'foo'"),
        ("", "there is no scheduler file ''"),
        ("none.json", "there is no scheduler file 'none.json'"),
        ("tcp://localhost", "there is no scheduler file 'tcp://localhost'"),
        ("http://localhost:8786", "unknown address scheme 'http'"),
        ("localhost:http", "there is no scheduler file 'localhost:http'"),
        (r"C:\share\none.json", "there is no scheduler file"),
        ("broken.json", "no Dask scheduler answers at broken.json"),
    ],
)
def test_a_scheduler_that_is_mistyped_is_told_before_anybody_waits_for_it(
    given: str, sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("it was waited for")

    monkeypatch.setattr(distributed.Client, "__init__", never)
    monkeypatch.setattr(distributed.Client, "__del__", lambda _: None)
    monkeypatch.chdir(tmp_path)
    Path("broken.json").write_text('{"broken')
    with pytest.raises(OSError, match=sentence), cluster_client([], scheduler=given):
        pass


def test_a_scheduler_file_that_is_being_written_is_waited_for(
    deserted: str, tmp_path: Path
) -> None:
    file = tmp_path / "new.json"
    file.touch()
    written = Timer(0.3, lambda: shutil.copy(deserted, file))
    written.start()
    with cluster_client([], scheduler=str(file)) as client:
        assert client.status == "running"
    written.join()


def test_workers_of_this_machine_are_not_ignored_beside_another_cluster() -> None:
    for cluster in ({"scheduler": "tcp://127.0.0.1:9"}, {"client": object()}):
        given: dict[str, Any] = cluster
        with (
            pytest.raises(ValueError, match="leave --workers"),
            cluster_client([], workers=2, **given),
        ):
            pass


@pytest.mark.skipif(os.name != "posix", reason="signals of a terminal")
def test_ctrl_c_while_workers_start_ends_a_run_in_one_sentence(bags: Path, tmp_path: Path) -> None:
    begin = [sys.executable, "-c", "from napari_unpack.cli import main; main()"]
    run = subprocess.Popen(
        [*begin, "batch", str(bags), "--output", "out", "--workers", "2", "--no-pictures"],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # Tests that were begun in the background inherit that the signal is ignored.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    end = monotonic() + 60
    while monotonic() < end and not any(
        "spawn_main" in word
        for child in psutil.Process(run.pid).children()
        for word in child.cmdline()
    ):
        sleep(0.01)
    # They import what they need now, and would print where they were interrupted.
    sleep(0.3)
    os.killpg(run.pid, signal.SIGINT)
    said = run.communicate(timeout=60)[1]
    assert said == "stopped: what is done is kept, and the same command goes on with the rest\n"
    assert run.returncode == 130
