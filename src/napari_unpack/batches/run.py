"""A run over many scans: what is done already is kept, the rest goes to a Dask cluster."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from time import sleep
from typing import TYPE_CHECKING, Any

from napari_unpack.atomic import check_space, check_writable, given_path, written_atomically
from napari_unpack.batches.cluster import (
    check_workers,
    cluster_client,
    dashboard_of,
    threads_by_host,
)
from napari_unpack.batches.index_page import write_index
from napari_unpack.batches.inputs import ScanInput, find_inputs, told_apart
from napari_unpack.batches.object_rows import join_object_rows
from napari_unpack.batches.results import OBJECTS, ScanResult, note_names, results_in
from napari_unpack.batches.run_settings import (
    ALL_OBJECTS,
    ALL_SCANS,
    RUN,
    Settings,
    check_folder,
    claim_folder,
    identity_of_settings,
)
from napari_unpack.batches.scan_work import Place
from napari_unpack.file_sizes import stored_size
from napari_unpack.io.optional import needed
from napari_unpack.tasks import BEAT_SECONDS

if TYPE_CHECKING:
    import pandas as pd

Told = Callable[[ScanResult, int, int], None]
"""Called with what came of a scan, how many are done, and how many there are."""


@dataclass(frozen=True, eq=False)
class BatchReport:
    """What came of a run.

    Parameters
    ----------
    output : Path
        The run's folder.
    results : tuple of ScanResult
        Of the scans that were asked for, in their order.
    index : Path
        The page of all scans.
    """

    output: Path
    results: tuple[ScanResult, ...]
    index: Path

    @property
    def failed(self) -> tuple[ScanResult, ...]:
        """Those that failed, each with its reason."""
        return tuple(one for one in self.results if one.status == "failed")

    @property
    def scans(self) -> pd.DataFrame:
        """A row for each scan that was asked for."""
        import pandas as pd

        return pd.DataFrame([one.record() for one in self.results]).set_index("scan")

    @property
    def objects(self) -> pd.DataFrame:
        """All objects, one row each."""
        import pandas as pd

        return pd.read_parquet(self.output / ALL_OBJECTS)


def batch(
    inputs: str | Path | Iterable[str | Path],
    output: str | Path,
    client: Any = None,
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    threads: int | None = None,
    settings: Settings | None = None,
    large: bool = False,
    force: bool = False,
    told: Told | None = None,
    say: Callable[[str], None] | None = None,
    **options: Any,
) -> BatchReport:
    """Segment and unpack many scans on a Dask cluster; a session, a picture and a page of each.

    Interrupted and called again it goes on where it stopped. In a script it belongs below
    ``if __name__ == "__main__":``, as workers of this machine are processes of their own.

    Parameters
    ----------
    inputs : str, Path or iterable of them
        See `find_inputs`: files, folders, patterns, tables.
    output : str or Path
        A folder for all that is made; made where it is missing.
    client : distributed.Client, optional
        Of the cluster to use. Without it and `scheduler`, one is started on this machine with as
        many workers as fit its cores and its memory.
    scheduler : str, optional
        Address (tcp://...) or scheduler file of a running cluster.
    workers, threads : int, optional
        How many processes on this machine, and how many threads each scan takes; by default
        the cores are divided among the workers.
    settings : Settings, optional
        What is done to each scan; without them they are made of `options`.
    large : bool
        Try scans too that ask for more memory than a worker has.
    force : bool
        Use the folder even where it holds something else, or a run with other settings, whose
        results of these scans are replaced.
    told : callable, optional
        Called with (ScanResult, how many are done, how many there are).
    say : callable, optional
        Called with a sentence now and then: how many workers, where Dask's dashboard is.
    **options
        Of `Settings`: smallest, grainy, view, direction, pictures, film, labels, copies.

    Raises
    ------
    ImportError
        If dask.distributed or pyarrow is missing.
    TypeError
        If `settings` and `options` are given.
    ValueError
        If there is nothing to do, the folder holds another run, or a worker has another version.
    OSError
        If no scheduler answers, the cluster is lost, or there is no space.
    """
    for module in ("distributed", "pyarrow"):
        needed(module, "work on many scans", "batch")
    if settings is not None and options:
        raise TypeError(f"give settings or {', '.join(options)}, not both")
    given = [inputs] if isinstance(inputs, str | Path) else inputs
    scans, settings = find_inputs(given), settings or Settings(**options)
    folder = given_path(output).absolute()
    if not force:
        check_folder(folder, settings)
    found, speak = list(results_in(folder)), say or (lambda _: None)
    sources = {scan.source for scan in scans}
    # Those of earlier calls keep the names that people know them by.
    earlier = (one for one in found if one.source not in sources and Path(one.source).exists())
    scans = told_apart(scans, [one.scan for one in earlier])
    _check_disk(folder, scans, found, settings)
    known = {one.identity: one.folder for one in found}
    done: dict[str, ScanResult] = {}
    with cluster_client(scans, client, scheduler, workers, threads) as cluster:
        if not cluster.scheduler_info()["workers"]:
            speak("the cluster has no worker yet: waiting for one")
        check_workers(cluster, folder)
        # No sooner: what keeps a run from beginning leaves the folder as it is.
        claim_folder(folder, settings, force)
        speak(_described(cluster))
        place = Place(folder, settings, large=large)
        with _set_up(cluster, threads):
            for result in _results(cluster, scans, place, known, speak):
                done[result.scan] = result
                if told is not None:
                    told(result, len(done), len(scans))
    results = tuple(done[scan.name] for scan in scans)
    if force:
        _remove_replaced(folder, results)
    note_names(folder, results)
    # Scans of earlier calls with these settings stay in the report, but for those whose file has
    # another name or other content now.
    named = {one.folder for one in results}
    others = [
        one
        for one in {(one.source, one.scan): one for one in results_in(folder)}.values()
        if one.settings == identity_of_settings(settings)
        and one.source not in sources
        and (one.folder not in named or Path(one.source).exists())
    ]
    return BatchReport(folder, results, _write_report(folder, [*results, *others]))


def _described(cluster: Any) -> str:
    count, link = len(cluster.scheduler_info(n_workers=-1)["workers"]), dashboard_of(cluster)
    return f"{count} worker{'s' * (count != 1)}" + (f", Dask's dashboard at {link}" if link else "")


def _check_disk(
    folder: Path, scans: Sequence[ScanInput], found: Sequence[ScanResult], settings: Settings
) -> None:
    size = 0
    for scan in scans:
        # What cannot be read gets its reason from the worker that tries.
        with suppress(OSError):
            size += stored_size(scan.volume)
    needed = size // 4 if settings.copies else 0
    # What is done already takes its space now.
    there = next(place for place in (folder, *folder.parents) if place.exists())
    first = there / (RUN if there == folder else folder.relative_to(there).parts[0])
    check_writable(first)
    check_space(first, needed - int(1e6 * sum(one.megabytes for one in found)))


@contextmanager
def _set_up(client: Any, threads: int | None) -> Iterator[None]:
    """Have workers take their share of the cores, which they forget in the end."""
    from napari_unpack.batches.on_worker import WorkerSetup

    client.register_plugin(WorkerSetup(threads_by_host(client), threads))
    try:
        yield
    finally:
        # A cluster that was lost has nothing to forget, and would be waited for.
        if client.status == "running":
            with suppress(Exception):
                client.unregister_worker_plugin(WorkerSetup.name)


def _results(
    client: Any,
    scans: Sequence[ScanInput],
    place: Place,
    known: dict[str, str],
    speak: Callable[[str], None],
) -> Iterator[ScanResult]:
    """Yield what came of each scan as it is done; Dask sees to workers that are lost."""
    from distributed import CancelledError, as_completed

    from napari_unpack.batches.on_worker import same, scan_on_worker

    # Kept to the end: without it nothing that is lost with its worker can be done again.
    shared = client.submit(same, known, pure=False)
    futures = client.map(scan_on_worker, scans, place=place, known=shared, pure=False)
    by_key = {future.key: scan for future, scan in zip(futures, scans, strict=True)}
    waiting = as_completed(futures, loop=client.loop)
    # Else each is kept until all are done, and its result on the cluster with it.
    del futures
    look = _watch_of_workers(client, speak)
    while not waiting.is_empty():
        while not waiting.has_ready():
            look()
            sleep(BEAT_SECONDS)
        future = next(waiting)
        try:
            yield _fetched(future, by_key[future.key], look)
        except CancelledError as error:
            raise ConnectionError(
                "the Dask cluster was lost: what is done is kept, and the same command goes on"
            ) from error


def _fetched(future: Any, scan: ScanInput, look: Callable[[], None]) -> ScanResult:
    while future.status != "error":
        try:
            result: ScanResult = future.result(timeout=BEAT_SECONDS)
        except TimeoutError:
            # The worker that had it is gone: another one does the scan again.
            look()
        except Exception:
            # Which may fail, too.
            if future.status != "error":
                raise
        else:
            return result
    return _lost(scan, future.exception())


def _watch_of_workers(client: Any, speak: Callable[[str], None]) -> Callable[[], None]:
    """Return what says so whenever the last worker of a cluster is gone."""
    there = True

    def look() -> None:
        nonlocal there
        # Asked of a few: workers may be many. A lost scheduler has none, and ends the futures.
        before, there = there, bool(client.scheduler_info(n_workers=1)["workers"])
        if before and not there:
            speak("the cluster has lost its workers: waiting for one")

    return look


def _lost(scan: ScanInput, error: BaseException) -> ScanResult:
    from distributed import KilledWorker

    reason = " ".join(f"{type(error).__name__}: {error}".split())
    if isinstance(error, KilledWorker):
        reason = "its worker ended again and again, most likely as its memory was used up"
    return ScanResult(scan.name, scan.source, "failed", reason)


def _remove_replaced(folder: Path, results: Sequence[ScanResult]) -> None:
    """Remove older results of scans that are done anew."""
    done = [one for one in results if one.status != "failed"]
    # One volume may stand in several rows, with other labels or voxel sizes.
    anew, kept = {(one.source, one.scan) for one in done}, {one.folder for one in done}
    for before in list(results_in(folder)):
        if (before.source, before.scan) in anew and before.folder not in kept:
            shutil.rmtree(folder / before.folder, ignore_errors=True)


def _write_report(folder: Path, results: Sequence[ScanResult]) -> Path:
    import pandas as pd

    tables = ((one.scan, folder / one.folder / OBJECTS) for one in results if one.folder)
    join_object_rows(tables, folder / ALL_OBJECTS)
    with written_atomically(folder / ALL_SCANS) as temporary:
        pd.DataFrame([one.record() for one in results]).to_parquet(temporary, index=False)
    # Last: what the page refers to is there.
    return write_index(folder, results)
