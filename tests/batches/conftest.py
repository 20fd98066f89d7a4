"""Three tiny bags with labels, one without, one broken file, and a real cluster."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import numpy as np
import pytest

from napari_unpack.batches.cluster import cluster_client
from napari_unpack.io import Scan, save_scan


def make_bag(path: Path, seed: int, labelled: bool = True) -> Path:
    """Save a bag of three boxes in a row."""
    labels = np.zeros((24, 26, 44), np.uint8)
    for i in (1, 2, 3):
        labels[4:20, 4 : 20 - seed % 8, 13 * i - 9 : 13 * i + 1] = i
    noise = np.random.default_rng(seed).integers(0, 30, labels.shape)
    volume = (np.where(labels > 0, 1500, 0) + noise).astype(np.uint16)
    save_scan(Scan(volume, (1.0, 1.0, 1.0), labels if labelled else None), path)
    return path


@pytest.fixture(scope="session")
def bags(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of three bags, one of them without labels, and a broken file."""
    folder = tmp_path_factory.mktemp("bags")
    make_bag(folder / "a.npz", 0)
    make_bag(folder / "b.npz", 1, labelled=False)
    make_bag(folder / "c.npz", 2)
    (folder / "broken.npz").write_bytes(b"PK not an archive")
    return folder


class Pair:
    """A plain `dask scheduler`, and `dask worker` processes of it.

    Parameters
    ----------
    folder : Path
        For what they write.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.file = folder / "scheduler.json"
        self.processes: list[subprocess.Popen[bytes]] = []
        options = ("--port", "0", "--dashboard-address", ":0", "--scheduler-file", self.file)
        self._start("scheduler", "--host", "127.0.0.1", *options)
        # Written once it answers.
        end = monotonic() + 60
        while not self.file.exists() and monotonic() < end:
            sleep(0.02)

    def worker(self, path: Path | None = None) -> subprocess.Popen[bytes]:
        """Start a worker, which looks for packages in a folder first."""
        options = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--memory-limit", "3GB")
        place = ("--local-directory", self.folder)
        return self._start("worker", "--scheduler-file", self.file, *options, *place, path=path)

    def _start(
        self, kind: str, *options: object, path: Path | None = None
    ) -> subprocess.Popen[bytes]:
        words = [sys.executable, "-m", "dask", kind, *map(str, options)]
        environment = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(path or "")}
        quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self.processes.append(subprocess.Popen(words, env=environment, **quiet))
        return self.processes[-1]

    def close(self) -> None:
        """End all of them."""
        for process in self.processes:
            process.kill()
        for process in self.processes:
            process.wait()


@pytest.fixture(scope="session")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Pair]:
    """A scheduler with two workers."""
    started = Pair(tmp_path_factory.mktemp("dask"))
    started.worker()
    started.worker()
    yield started
    started.close()


@pytest.fixture(scope="session")
def client(pair: Pair) -> Iterator[Any]:
    """A client of the pair, with both workers."""
    with cluster_client([], scheduler=str(pair.file)) as found:
        found.wait_for_workers(2, timeout=60)
        yield found
