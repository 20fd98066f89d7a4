"""The Dask cluster that does the work: one on this machine, or whichever a person names."""

from __future__ import annotations

import json
import logging
import re
import signal
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing.resource_tracker import ensure_running
from pathlib import Path
from time import monotonic, sleep
from typing import Any

from napari_unpack.atomic import empty_file_beside, given_path
from napari_unpack.batches.inputs import ScanInput
from napari_unpack.batches.memory_needs import need_of
from napari_unpack.batches.run_settings import RUN
from napari_unpack.io.optional import needed
from napari_unpack.memory import free_memory
from napari_unpack.thread_count import SETTING, thread_count
from napari_unpack.version import __version__

CONNECT_SECONDS = 10
"""A scheduler that is there answers within one, also from far away."""

WRITE_SECONDS = 1.0
"""A scheduler that has just begun writes its file in a moment, and not as a whole."""

LOOKED_AT = 100
"""Headers that are read to size the workers of this machine; of more scans, every few."""

SHARE_OF_MEMORY = 0.9
"""Of what is free: the rest is for the scheduler, and for what else runs."""

DEAF_TO_INTERRUPTS = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"
"""Of this machine's workers, which a terminal's Ctrl+C reaches as well: the command ends them."""


@contextmanager
def cluster_client(
    scans: Sequence[ScanInput],
    client: Any = None,
    scheduler: str | None = None,
    workers: int | None = None,
    threads: int | None = None,
) -> Iterator[Any]:
    """Give a client of a Dask cluster.

    Parameters
    ----------
    scans : sequence of ScanInput
        What is to be done, by which workers of this machine are sized.
    client : distributed.Client, optional
        The one to use.
    scheduler : str, optional
        Address (tcp://...) or scheduler file of a running cluster.
    workers, threads : int, optional
        Of this machine: how many processes, and how many threads each takes.

    Raises
    ------
    ImportError
        If dask.distributed is missing.
    ValueError
        If workers of this machine are wanted beside another cluster.
    OSError
        If no scheduler answers.
    """
    if workers is not None and (client is not None or scheduler is not None):
        raise ValueError("a running cluster has workers of its own: leave --workers (workers) out")
    distributed = needed("distributed", "work on several processes", "batch")
    if client is not None:
        yield client
    elif scheduler is not None:
        with _connected(distributed, scheduler) as found:
            yield found
    else:
        with _local(distributed, scans, workers, threads) as found:
            yield found


@contextmanager
def losses_told() -> Iterator[None]:
    """Say in a sentence that workers, or the cluster, were lost while they worked on blocks.

    Raises
    ------
    MemoryError
        If one block ended worker after worker.
    ConnectionError
        If the cluster was lost.
    """
    from distributed import CancelledError, KilledWorker

    try:
        yield
    except KilledWorker as error:
        raise MemoryError(
            "a block's workers ended again and again, most likely as their memory was used up: "
            "give them more memory (fewer --workers)"
        ) from error
    except CancelledError as error:
        raise ConnectionError(
            "the Dask cluster was lost, and nothing is written: start it and the command again"
        ) from error


@contextmanager
def _connected(distributed: Any, scheduler: str) -> Iterator[Any]:
    file = given_path(scheduler)
    # A port, and no drive of Windows.
    if not file.is_file() and not re.search(r":\d", scheduler):
        raise FileNotFoundError(
            f"there is no scheduler file {scheduler!r}; an address is like tcp://HOST:8786"
        )
    with _silent():
        try:
            address = _address_in(file) if file.is_file() else scheduler
            # A client that cannot understand its address takes 20 s to end, with a traceback.
            distributed.comm.resolve_address(address)
            client = distributed.Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
        except Exception as error:
            # Of addresses, files, sockets and versions, each with errors of its own.
            raise OSError(
                f"no Dask scheduler answers at {scheduler} "
                f"({' '.join(str(error).split())[:200]}): "
                "check the address, and that `dask scheduler` runs there"
            ) from error
        with client:
            yield client


def _address_in(file: Path) -> str:
    end = monotonic() + WRITE_SECONDS
    while True:
        try:
            return str(json.loads(file.read_bytes())["address"])
        except ValueError:
            if monotonic() > end:
                raise
            sleep(WRITE_SECONDS / 10)


@contextmanager
def _silent() -> Iterator[None]:
    """Have Dask log nothing: how often it tried to connect, tracebacks of a scheduler that is lost.

    The run says in words what has become of it.
    """
    from distributed.utils import silence_logging_cmgr

    # The client's log has a level and a handler of its own.
    with (
        silence_logging_cmgr(logging.CRITICAL),
        silence_logging_cmgr(logging.CRITICAL, root="distributed.client"),
    ):
        yield


@contextmanager
def _local(
    distributed: Any, scans: Sequence[ScanInput], workers: int | None, threads: int | None
) -> Iterator[Any]:
    cores, free = thread_count(), int(free_memory() * SHARE_OF_MEMORY)
    count = workers or workers_that_fit(scans, cores, free)
    each = threads or max(1, cores // count)
    begin = partial(
        distributed.LocalCluster,
        n_workers=count,
        # One scan at a time; its own threads are the setting's.
        threads_per_worker=1,
        memory_limit=free // count,
        env={SETTING: str(each)},
        preload=[DEAF_TO_INTERRUPTS],
        # Of a scheduler that has ended a worker tells with a traceback; the run says it in words.
        silence_logs=logging.CRITICAL,
        # Any free port: another run of today may have the usual one.
        dashboard_address=":0",
    )
    with _whole(begin) as cluster, distributed.Client(cluster, set_as_default=False) as client:
        yield client


def _whole(begin: Callable[[], Any]) -> Any:
    """Return a cluster; an interruption waits until it can be ended, as half a one cannot."""
    # Workers inherit the thread's deafness from their first moment on.
    with ThreadPoolExecutor(1, "unpack-cluster", _ignore_interrupts) as pool:
        begun = pool.submit(begin)
        try:
            return begun.result()
        except KeyboardInterrupt:
            with suppress(Exception):
                begun.result().close()
            raise


def _ignore_interrupts() -> None:
    if hasattr(signal, "pthread_sigmask"):
        # Begun later, it would let interrupts in again.
        ensure_running()
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


def workers_that_fit(scans: Sequence[ScanInput], cores: int, memory: int) -> int:
    """Return how many scans can be worked on at once, one at least.

    Parameters
    ----------
    scans : sequence of ScanInput
    cores : int
    memory : int
        Bytes.
    """
    needs = [0]
    for scan in scans[:: max(1, len(scans) // LOOKED_AT)]:
        # What cannot be read gets its reason from the worker that tries.
        with suppress(Exception):
            needs.append(need_of(scan))
    # Those that take more than all there is fit no worker, and shall not leave a single one.
    largest = max((need for need in needs if need <= memory), default=0)
    return max(1, min(cores, len(scans), memory // max(largest, 1)))


def check_workers(client: Any, output: Path) -> None:
    """Refuse workers that would do other work, or would write where nobody finds it.

    Parameters
    ----------
    client : distributed.Client
        Waits until it has a worker.
    output : Path
        The run's folder, made where it is missing.

    Raises
    ------
    ValueError
        If a worker lacks this package, has another version of it, or does not see the folder.
    """
    check_versions(client)

    def seen(file: str) -> bool:
        import os

        return os.path.exists(file)

    output.mkdir(parents=True, exist_ok=True)
    # A file of its own: that of the run is written once all workers are fit for it.
    with empty_file_beside(output / RUN) as file:
        answers = client.run(seen, str(file))
    for worker, answer in answers.items():
        if not answer:
            raise ValueError(
                f"the worker {worker} does not see {output}: choose a folder that all machines "
                "share"
            )


def check_versions(client: Any) -> None:
    """Refuse workers without this package, or with another version of it.

    Parameters
    ----------
    client : distributed.Client
        Waits until it has a worker.

    Raises
    ------
    ValueError
        If there is one.
    """
    client.wait_for_workers(1)

    # Sent by value, as a worker without this package cannot look it up.
    def asked() -> str:
        from importlib.metadata import version

        return version("napari-unpack")

    for worker, answer in client.run(asked, on_error="return").items():
        if isinstance(answer, BaseException):
            raise ValueError(
                f"the worker {worker} has no napari-unpack: install version {__version__} there"
            )
        if answer != __version__:
            raise ValueError(
                f"the worker {worker} has napari-unpack {answer}, and this is "
                f"{__version__}: install the same version everywhere"
            )


def threads_by_host(client: Any) -> Counter[str]:
    """Return how many scans each machine works on at once, by its host."""
    scans: Counter[str] = Counter()
    for worker in client.scheduler_info(n_workers=-1)["workers"].values():
        scans[worker["host"]] += worker["nthreads"]
    return scans


def dashboard_of(client: Any) -> str:
    """Return the address of Dask's dashboard; nothing where there is none."""

    # Where the scheduler runs; without bokeh its page says no more than that.
    def drawn() -> bool:
        from importlib.util import find_spec

        return find_spec("bokeh") is not None

    return str(client.dashboard_link) if client.run_on_scheduler(drawn) else ""
