"""One volume larger than its workers' memory: the peak of each, and the minutes."""

from __future__ import annotations

import resource
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import distributed
import numpy as np
import zarr

import napari_unpack as nu
from benchmarks.row import Row
from benchmarks.scenes import Scenes
from napari_unpack.thread_count import SETTING

SHAPE, QUICK = (1024, 1024, 2048), (256, 256, 512)
CHUNK, TILE = 128, (256, 256, 512)
WORKERS, WORKER_BYTES = 2, 2 << 30


def measure(scenes: Scenes) -> list[Row]:
    shape = QUICK if scenes.quick else SHAPE
    with TemporaryDirectory() as name, _cluster() as cluster, distributed.Client(cluster) as client:
        source = _volume(Path(name), shape)
        out = zarr.create_array(
            f"{name}/labels.zarr", shape=shape, dtype="int32", chunks=(CHUNK,) * 3
        )
        start = time.perf_counter()
        found = nu.segment(source, out=out, client=client)
        minutes = (time.perf_counter() - start) / 60
        peaks = sorted(client.run(_peak_bytes).values())
    peak = peaks[-1] / (1 << 30)
    return [
        Row(
            "one large volume: peak of a worker",
            f"{'x'.join(map(str, shape))} in Zarr, two workers of 2 GiB",
            f"{peak:.2f} GiB, {len(found.objects)} objects, {minutes:.1f} minutes",
            goal="<= 2 GiB",
            met=len(peaks) == WORKERS and peak <= 2,
        )
    ]


def _cluster() -> Any:
    return distributed.LocalCluster(
        n_workers=WORKERS,
        threads_per_worker=1,
        memory_limit=WORKER_BYTES,
        env={SETTING: "1"},
        dashboard_address=":0",
    )


def _volume(place: Path, shape: tuple[int, int, int]) -> Any:
    """Write a shelf of bags, one like the other: a volume of any size, made in seconds."""
    bag = nu.simulate_bag(seed=0, shape=TILE, count=40)
    array = zarr.create_array(
        str(place / "volume.zarr"), shape=shape, dtype=bag.volume.dtype, chunks=(CHUNK,) * 3
    )
    for corner in np.ndindex(*(n // t for n, t in zip(shape, TILE, strict=True))):
        box = tuple(slice(c * t, (c + 1) * t) for c, t in zip(corner, TILE, strict=True))
        array[box] = bag.volume
    return array


def _peak_bytes() -> int:
    # Linux tells kibibytes.
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
