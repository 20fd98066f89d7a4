"""What came of one scan: a folder that is there whole or not at all, and a record of it."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from napari_unpack.atomic import written_atomically
from napari_unpack.batches.run_settings import SCANS
from napari_unpack.io.session_archive import holds_session

DONE = "done.json"
"""Written last into a scan's folder, which then takes its name in one move."""

SESSION, PICTURE, PAGE, FILM = "session.unpack", "picture.png", "objects.html", "unpacking.mp4"
OBJECTS = "objects.parquet"

NAMED = 12
"""Names of scans in a message: it has to be read."""

_DIGITS = 10
"""Of a result's identity in the name of its folder: none of 100,000 meets another by chance."""


@dataclass(frozen=True)
class ScanResult:
    """What came of a scan.

    Parameters
    ----------
    scan : str
        Its name.
    source : str
        Where its volume is.
    status : {"done", "kept", "failed"}
        "kept": it was done before, and is as it was.
    reason : str
        Why it failed, a sentence.
    folder : str
        Its results, from the run's folder.
    objects : int
        How many there are.
    seconds : float
        What the work took, reading and writing included.
    megabytes : float
        Size of its results.
    notes : tuple of str
        What had to be assumed of the file.
    identity, settings : str
        See `run_settings.identity` and `run_settings.identity_of_settings`.
    """

    scan: str
    source: str
    status: str
    reason: str = ""
    folder: str = ""
    objects: int = 0
    seconds: float = 0.0
    megabytes: float = 0.0
    notes: tuple[str, ...] = ()
    identity: str = ""
    settings: str = ""

    def record(self) -> dict[str, Any]:
        """Return it as plain data."""
        return asdict(self)


def folder_name(scan: str, identity: str) -> str:
    """Return the name of a scan's folder.

    Parameters
    ----------
    scan : str
        The scan's name, for people.
    identity : str
        By which it is found again.
    """
    # Letters and digits fit every file system; what it is called in full stands in the tables.
    plain = re.sub(r"[^\w.-]+", "_", scan, flags=re.ASCII).strip("._")[:60] or "scan"
    if plain.lower() != scan:
        # Scans of one content may differ in the letters that are left out, or in capitals, which
        # some file systems take for small ones.
        identity = hashlib.sha256(f"{identity} {scan}".encode()).hexdigest()
    return f"{plain}-{identity[:_DIGITS]}"


def read_result(folder: Path) -> ScanResult | None:
    """Return the record in a scan's folder; None where it is not done, or not whole any more."""
    try:
        told = json.loads((folder / DONE).read_text("utf-8"))
        found = ScanResult(**{**told, "notes": tuple(told["notes"])})
    except (OSError, ValueError, TypeError, KeyError):
        # Not done, or by another version: it is made anew.
        return None
    # The table of the whole run is made of it.
    return found if (folder / OBJECTS).is_file() else None


def note_names(output: Path, results: Iterable[ScanResult]) -> None:
    """Let the records of kept results say what their scans are called now, as the tables do.

    Parameters
    ----------
    output : Path
        The run's folder.
    results : iterable of ScanResult
    """
    results = tuple(results)
    holds = {one.source: one.folder for one in results}
    now = {one.folder for one in results}
    found: dict[str, list[ScanResult]] = {}
    for one in results_in(output):
        found.setdefault(one.source, []).append(one)
    for one in results:
        same = [each.folder for each in found.get(one.source, ()) if each.scan == one.scan]
        if one.status != "kept" or same[-1:] == [one.folder]:
            continue
        before = read_result(output / one.folder)
        if before is None:
            continue
        # Where the file of the record is there as well, and is it, one is a copy of the other.
        is_it = holds.get(before.source, before.folder) == before.folder
        moved = before.source != one.source
        if not moved or not (is_it and Path(before.source).exists()):
            # What the file held earlier stays what it held earlier; of one that was moved all,
            # whatever tables called it.
            earlier = [
                each
                for each in found.get(before.source, ())
                if (moved or each.scan == before.scan) and each.folder not in now
            ]
            for told in (*earlier, one):
                told = replace(told, scan=one.scan, source=one.source, status="done")
                with written_atomically(output / told.folder / DONE) as temporary:
                    temporary.write_text(json.dumps(told.record(), indent=1), encoding="utf-8")


def session_in(place: Path, scan: str | None = None) -> Path:
    """Return the session that is meant: itself, that of a scan's folder, or of a scan of a run.

    Parameters
    ----------
    place : Path
    scan : str, optional
        Which of a run, by its name; not needed where there is one.

    Raises
    ------
    FileNotFoundError
        If there is nothing.
    ValueError
        If it is neither, a session alone of which a scan is named, or a run of several scans and
        none of them is named.
    """
    if not place.exists():
        raise FileNotFoundError(f"no such session or folder: {place}")
    one = place if holds_session(place) else place / SESSION
    if scan is None and one.exists():
        return one
    found = {result.scan: place / result.folder / SESSION for result in results_in(place)}
    if not found and one.exists():
        raise ValueError(f"{place} is one session: leave --scan out")
    if not found:
        raise ValueError(f"{place} is neither a session nor a folder that `batch` made")
    if scan is None and len(found) == 1:
        return next(iter(found.values()))
    if scan not in found:
        names = ", ".join(sorted(found)[:NAMED]) + (", ..." if len(found) > NAMED else "")
        wanted = "say which" if scan is None else f"none is called {scan!r}; say which"
        raise ValueError(f"{place} holds {len(found)} scans: {wanted} with --scan ({names})")
    return found[scan]


def results_in(output: Path) -> Iterator[ScanResult]:
    """Yield the records of all scans that a run's folder holds, of a replaced file's all, in turn.

    The last of those of one name is that of the file that is there now.
    """
    for done in sorted((output / SCANS).glob("[!.]*/" + DONE), key=_when):
        found = read_result(done.parent)
        if found is not None:
            yield found


def _when(file: Path) -> tuple[int, Path]:
    try:
        return file.stat().st_mtime_ns, file
    except OSError:
        # Somebody removed it this moment.
        return 0, file
