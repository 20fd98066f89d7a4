"""What runs in a worker of a Dask cluster; imported where dask.distributed is there."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace

from distributed import Worker, WorkerPlugin, get_worker

from napari_unpack.batches.inputs import ScanInput
from napari_unpack.batches.kernel_cache import keep_kernels_one_at_a_time
from napari_unpack.batches.results import ScanResult
from napari_unpack.batches.scan_work import Place, work_on
from napari_unpack.thread_count import SETTING, thread_count

_before: list[str | None] = []
"""What the setting of threads was, once for each worker of this process; the first was a person's.

A cluster without processes of its own has several workers in one, which may be the person's.
"""


class WorkerSetup(WorkerPlugin):
    """Gives each scan its share of a machine's cores, and compiled kernels one writer at a time.

    Parameters
    ----------
    scans : mapping of str to int
        How many scans a host works on at once.
    threads : int, optional
        How many each takes, in place of its share.
    """

    name = "napari-unpack"

    def __init__(self, scans: Mapping[str, int], threads: int | None = None) -> None:
        self._scans, self._threads = dict(scans), threads

    def setup(self, worker: Worker) -> None:
        """Set up a worker; what its environment says of threads counts more than a share.

        Parameters
        ----------
        worker : distributed.Worker
        """
        keep_kernels_one_at_a_time()
        _before.append(os.environ.get(SETTING))
        at_once = max(self._scans.get(worker.ip, 1), worker.state.nthreads)
        share = self._threads or max(1, thread_count() // at_once)
        if self._threads:
            os.environ[SETTING] = str(share)
        os.environ.setdefault(SETTING, str(share))

    def teardown(self, worker: Worker) -> None:
        """Give the process back its own setting with its last worker.

        Parameters
        ----------
        worker : distributed.Worker
        """
        own = _before.pop()
        if _before:
            return
        os.environ.pop(SETTING, None)
        if own is not None:
            os.environ[SETTING] = own


def scan_on_worker(scan: ScanInput, place: Place, known: Mapping[str, str]) -> ScanResult:
    """Work on a scan within the memory that its worker has.

    Parameters
    ----------
    scan, place, known
        As for `work_on`.
    """
    worker = get_worker()
    limit = worker.memory_manager.memory_limit
    if limit:
        place = replace(place, memory=limit // worker.state.nthreads)
    return work_on(scan, place, known)


def same(known: dict[str, str]) -> dict[str, str]:
    """Return what it is given: as a task, it can be made again where its worker was lost."""
    return known
