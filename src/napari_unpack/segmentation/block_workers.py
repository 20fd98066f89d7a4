"""The workers of a Dask cluster that do the work on blocks, and run the network on its tiles."""

from __future__ import annotations

import sys
import warnings
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from threading import Event, Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.common.array_source import Box, Source, within
from napari_unpack.segmentation.common.block_jobs import BlockJob
from napari_unpack.segmentation.learned.boundary_network import BoundaryNetwork, default_boundaries
from napari_unpack.tasks import BEAT_SECONDS, SILENT, Share

AHEAD = 2
"""Blocks for each thread of the cluster that are on their way: none waits for the next."""

DESERTED = "The cluster has no worker: waiting for one"


@dataclass(frozen=True, eq=False)
class PartArray:
    """A volume of which a box is there; it is asked for in the volume's coordinates.

    Parameters
    ----------
    block : ndarray
    box : tuple of slice
    shape : (int, int, int)
        Of the volume.
    """

    block: NDArray[Any]
    box: Box
    shape: tuple[int, int, int]

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the densities."""
        return self.block.dtype

    def __getitem__(self, box: Box) -> NDArray[Any]:
        """Return a box that lies within what is there."""
        part: NDArray[Any] = self.block[within(box, self.box)]
        return part


@dataclass(frozen=True, eq=False)
class BlockWorkers:
    """Does jobs on the workers of a Dask cluster; each holds no more than its blocks.

    Parameters
    ----------
    client : distributed.Client
    """

    client: Any

    def run(
        self, source: Source, jobs: Iterator[BlockJob], count: int, share: Share
    ) -> Iterator[Any]:
        """Do the jobs on the cluster; Dask tries those of a lost worker elsewhere.

        Parameters
        ----------
        source, jobs, count, share
            As for `RunBlocks`.
        """
        calls = (self._begun(source, job) for job in jobs)
        yield from self._in_order(calls, count, share)

    def network(self) -> BoundaryNetwork:
        """Return the network, whose tiles the workers predict."""
        return _RemoteNetwork(default_boundaries().session, self)

    def channels(
        self, tiles: Iterator[NDArray[np.float32]], count: int, share: Share
    ) -> Iterator[NDArray[np.uint8]]:
        """Yield what the network says of each tile, see `BoundaryNetwork.all_channels`.

        Parameters
        ----------
        tiles : iterator of ndarray
        count : int
        share : Share
        """
        calls = (self._submitted(_channels_of, tile) for tile in tiles)
        yield from self._in_order(calls, count, share)

    def _begun(self, source: Source, job: BlockJob) -> Any:
        # napari brings dask; nobody has a Zarr array without having imported zarr.
        from dask.array import Array as DaskArray
        from dask.delayed import delayed

        array, told = source.array, (job.box, source.shape, source.padding, job.work, job.given)
        if isinstance(array, DaskArray):
            # The cluster reads its chunks, and joins them where the work is done.
            call = delayed(_on_block, pure=False)(array[job.box], *told)
            return self.client.compute(call)
        zarr = sys.modules.get("zarr")
        if zarr is not None and isinstance(array, zarr.Array):
            # It is read where the work is done.
            return self._submitted(_on_stored_block, array, *told)
        with source.lock:
            block = np.ascontiguousarray(array[job.box])
        return self._submitted(_on_block, block, *told)

    def _submitted(self, work: Callable[..., Any], *given: Any) -> Any:
        with warnings.catch_warnings():
            # Blocks are large, and few: with the task they survive the loss of a worker.
            warnings.filterwarnings("ignore", ".*large graph")
            return self.client.submit(work, *given, pure=False)

    def _in_order(self, calls: Iterator[Any], count: int, share: Share) -> Iterator[Any]:
        most = AHEAD * max(1, sum(self.client.nthreads().values()))
        waiting: deque[Any] = deque()
        done = 0
        try:
            for call in calls:
                waiting.append(call)
                while len(waiting) >= most or (waiting and waiting[0].done()):
                    yield self._awaited(waiting.popleft(), share, done / count)
                    done += 1
            while waiting:
                yield self._awaited(waiting.popleft(), share, done / count)
                done += 1
        finally:
            # The user cancelled, or a block failed.
            self.client.cancel(list(waiting))

    def _awaited(self, future: Any, share: Share, done: float) -> Any:
        # Not `result(timeout)`, which now and then fails by itself (dask/distributed#8514).
        ended = Event()
        future.add_done_callback(lambda _: ended.set())
        while not future.done():
            # Asked of a few: workers may be many. A lost scheduler has none, and ends the future.
            share(done, "" if self.client.scheduler_info(n_workers=1)["workers"] else DESERTED)
            ended.wait(BEAT_SECONDS)
            # A result that is lost with its worker is waited for once more.
            ended.clear()
        return future.result()


@dataclass(frozen=True, eq=False)
class _RemoteNetwork(BoundaryNetwork):
    workers: BlockWorkers

    def all_channels(
        self, tiles: Iterator[NDArray[np.float32]], count: int, share: Share
    ) -> Iterator[NDArray[np.uint8]]:
        return self.workers.channels(tiles, count, share)


def _on_block(
    block: Any,
    box: Box,
    shape: tuple[int, int, int],
    padding: float | None,
    work: Callable[..., Any],
    given: tuple[Any, ...],
) -> Any:
    part = PartArray(np.asarray(block), box, shape)
    return work(Source(part, shape, Lock(), padding), *given, SILENT)


def _on_stored_block(array: Any, box: Box, *told: Any) -> Any:
    return _on_block(array[box], box, *told)


def _channels_of(tile: NDArray[np.float32]) -> NDArray[np.uint8]:
    return default_boundaries().channels(tile, SILENT)
