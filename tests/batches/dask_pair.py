"""A tiny bag, and a plain scheduler with workers."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import numpy as np

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
        # The code under test is the workers' too, wherever it lies.
        paths = os.pathsep.join(filter(None, (path and str(path), os.environ.get("PYTHONPATH"))))
        environment = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": paths}
        quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self.processes.append(subprocess.Popen(words, env=environment, **quiet))
        return self.processes[-1]

    def close(self) -> None:
        """End all of them."""
        for process in self.processes:
            process.kill()
        for process in self.processes:
            process.wait()
