"""Many bags on Dask: what two workers gain, what the cluster costs, and a run that is killed."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
import psutil

import napari_unpack as nu
from benchmarks.row import Row
from benchmarks.scenes import Scenes
from napari_unpack.batches.cluster import cluster_client
from napari_unpack.batches.results import results_in
from napari_unpack.file_sizes import stored_size
from napari_unpack.io import Scan, load_labels, save_scan

SEGMENTED, COUNTED = (64, 64, 88), 6
TINY = (32, 36, 48)
BAGS, BROKEN = 200, 5


def bags(folder: Path, count: int, shape: tuple[int, int, int], labelled: bool) -> list[Path]:
    folder.mkdir()
    paths = [folder / f"bag{n:03}.npz" for n in range(count)]
    for n, path in enumerate(paths):
        bag = nu.simulate_bag(seed=n, shape=shape, count=3 if labelled else COUNTED)
        z, y, x = (float(mm) for mm in bag.spacing)
        save_scan(Scan(bag.volume, (z, y, x), bag.labels if labelled else None), path)
    return paths


def measure(scenes: Scenes) -> list[Row]:
    with TemporaryDirectory() as name:
        place = Path(name)
        return [*throughput(place, scenes), interrupted(place, scenes)]


def throughput(place: Path, scenes: Scenes) -> list[Row]:
    scans = bags(place / "segmented", 6 if scenes.quick else 20, SEGMENTED, labelled=False)
    work = f"{len(scans)} bags of {'x'.join(map(str, SEGMENTED))}, segmented, one thread a worker"
    seconds = {}
    for count in (1, 2):
        with cluster_client([], workers=count, threads=1) as client:
            # Each worker loads its kernels before the clock runs.
            warm = bags(place / f"warm{count}", 2 * count, SEGMENTED, labelled=False)
            nu.batch(warm, place / f"warm{count}-out", client)
            start = time.perf_counter()
            report = nu.batch(scans, place / f"out{count}", client)
            seconds[count] = time.perf_counter() - start
            if count == 1:
                # What the scans themselves took, by the worker's clock: the plain loop.
                own = sum(one.seconds for one in report.results)
            assert not report.failed
    over, gain = seconds[1] / own - 1, seconds[1] / seconds[2]
    return [
        Row(
            "batch: two workers",
            work,
            f"{3600 * len(scans) / seconds[2]:.0f} scans an hour",
            f"one worker: {3600 * len(scans) / seconds[1]:.0f}",
            f"{gain:.2f}",
            ">= 1.7 x",
            gain >= 1.7,
        ),
        Row(
            "batch: what the cluster costs",
            f"{work}, one worker",
            f"{seconds[1]:.1f} s",
            f"the same scans one after the other: {own:.1f} s",
            f"{1 + over:.3f}",
            "<= 1.05",
            over <= 0.05,
        ),
    ]


def interrupted(place: Path, scenes: Scenes) -> Row:
    """Two workers killed, then the whole; the same command goes on."""
    count, start = BAGS // (10 if scenes.quick else 1), time.perf_counter()
    paths = bags(place / "many", count, TINY, labelled=True)
    broken = paths[3 :: count // BROKEN][:BROKEN]
    for path in broken:
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    out = place / "many-out"
    words = [str(Path(sys.executable).with_name("napari-unpack")), "batch", str(place / "many")]
    words = [*words, "--output", str(out), "--workers", "2", "--json", "--no-pictures"]
    with running(words) as (process, lines):
        begun = 0
        for begun, _ in enumerate(lines, 1):
            if begun in (count // 5, count // 3):
                workers(process)[0].kill()
            if begun == count // 2:
                process.send_signal(signal.SIGKILL)
                break
    done = {one.scan: one.seconds for one in results_in(out)}
    with running(words) as (process, lines):
        told = {one["scan"]: one for one in map(json.loads, lines)}
        status = process.wait()
    kinds = Counter(one["status"] for one in told.values())
    right = sum(
        bool((load_labels(out / one["folder"] / "labels.npz")[0] == truth(one["source"])).all())
        for one in told.values()
        if one["folder"]
    )
    table = pd.read_parquet(out / "objects.parquet")
    twice = len(list((out / "scans").glob("[!.]*"))) - right
    # What was done before the kill is as it was.
    kept = all(told[name]["status"] == "kept" for name in done)
    whole = len(table) == sum(one["objects"] for one in told.values())
    reasons = sum(bool(one["reason"]) for one in told.values())
    met = (right, reasons, twice) == (count - BROKEN, BROKEN, 0) and kept and whole and status == 3
    minutes, size = (time.perf_counter() - start) / 60, stored_size(out) / 1e6
    return Row(
        "batch: killed and started again",
        f"{count} bags of {'x'.join(map(str, TINY))} with labels, {BROKEN} broken; two workers "
        f"killed, then the whole after {begun} scans",
        f"{right} right, {reasons} reasons, {twice} twice, {kinds['kept']} kept, one table of "
        f"{len(table)} rows; {minutes:.1f} minutes, {size:.0f} MB",
        goal=f"{count - BROKEN} right, {BROKEN} reasons, nothing twice, one table",
        met=met,
    )


def truth(source: str) -> np.ndarray:
    return load_labels(source)[0]


def workers(process: subprocess.Popen[str]) -> list[psutil.Process]:
    below = psutil.Process(process.pid).children(recursive=True)
    return [one for one in below if "spawn_main" in " ".join(one.cmdline())]


@contextmanager
def running(words: list[str]) -> Iterator[tuple[subprocess.Popen[str], Iterator[str]]]:
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    try:
        yield process, iter(process.stdout)
    finally:
        process.kill()
        process.wait()
