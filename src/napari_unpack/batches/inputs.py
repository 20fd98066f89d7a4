"""From what a person names to scans: files, folders, DICOM series, patterns and tables."""

from __future__ import annotations

import glob
import math
import os
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from napari_unpack.atomic import given_path
from napari_unpack.batches.run_settings import OWN_FILES, SCANS, is_run
from napari_unpack.io.optional import needed
from napari_unpack.io.scan import Spacing, spacing_from
from napari_unpack.io.slice_folder import is_slice, slices_in
from napari_unpack.io.volumes import (
    DICOM_SUFFIXES,
    LABELS,
    READABLE,
    is_dicom,
    is_zarr,
    printable,
    stem_of,
    suffix_of,
    without_labels,
)

TABLES = (".csv", ".parquet")

_WHOLE = frozenset(READABLE) - set(DICOM_SUFFIXES)
"""Suffixes of files that hold a volume each."""


@dataclass(frozen=True)
class ScanInput:
    """A scan to work on.

    Parameters
    ----------
    volume : Path
        Absolute, as workers may run elsewhere.
    name : str
        Unlike that of any other scan of the run.
    labels : Path, optional
        Labels to use instead of those of the volume's file.
    spacing : (float, float, float) of mm, z y x, optional
        Instead of what the file says.
    """

    volume: Path
    name: str
    labels: Path | None = None
    spacing: Spacing | None = None

    @property
    def source(self) -> str:
        """Where its volume is, to be read."""
        return printable(str(self.volume))


def find_inputs(asked: Iterable[str | Path]) -> list[ScanInput]:
    """Return the scans that are meant, in order, each once.

    Parameters
    ----------
    asked : iterable of str or Path
        Files; folders, of which everything readable is taken (the DICOM files of a folder are one
        scan); patterns such as ``scans/*.npz``; tables (.csv, .parquet) with a column `volume` and
        perhaps `labels`, `spacing` ("z y x" in mm) and `name`. Paths in a table start from it.
        Results of a run are left out, unless nothing else is named.

    Raises
    ------
    FileNotFoundError
        If something is not there, or a pattern fits nothing.
    ValueError
        If there is no scan, or a table cannot be used.
    """
    found: dict[Any, ScanInput] = {}
    for path in _without_results([path for one in asked for path in _paths(str(one))]):
        for scan in _scans(path):
            key = (_place(scan.volume), scan.labels and _place(scan.labels), scan.spacing)
            found.setdefault(key, scan)
    if not found:
        raise ValueError("no scans: name files, folders, patterns or a table of volumes")
    return told_apart(list(found.values()))


def _paths(asked: str) -> list[Path]:
    path = given_path(asked)
    if path.exists():
        return [_plain(path)]
    # A shell leaves a pattern as it is where it is quoted, and Windows always does.
    names = sorted(glob.glob(str(path), recursive=True)) if glob.has_magic(asked) else []
    if not names:
        raise FileNotFoundError(f"no such file or folder: {asked}")
    return without_labels([_plain(Path(name)) for name in names])


def _without_results(paths: list[Path]) -> list[Path]:
    """Return paths without the results of runs, as patterns find those too."""
    # Who names nothing else means them.
    return [path for path in paths if not _is_result(path)] or paths


def _is_result(path: Path) -> bool:
    # Scans may lie beside a run, or in a folder below one.
    if path.name in OWN_FILES and is_run(path.parent):
        return True
    return any(one.name == SCANS and is_run(one.parent) for one in (path, *path.parents))


def _plain(path: Path) -> Path:
    """Return an absolute path without "..", which is above where a link leads."""
    path = path.absolute()
    if path.name == "..":
        return path.resolve()
    return Path(*_place(path)) if ".." in path.parts else path


def _place(path: Path) -> tuple[str, str]:
    """Return by what a file is known, however it is spelled: a link to it has a name of its own."""
    return os.path.realpath(path.parent), path.name


def _scans(path: Path) -> Iterator[ScanInput]:
    if suffix_of(path) in TABLES and path.is_file():
        yield from _listed(path)
    elif path.is_dir() and not is_zarr(path):
        yield from map(_scan, _inside(path, frozenset()))
    else:
        yield _scan(path)


def _scan(path: Path) -> ScanInput:
    beside = path.with_name(f"{stem_of(path)}{LABELS}{suffix_of(path)}")
    name = printable(stem_of(path) or path.name)
    # Not Path's own, which raises what the system says of a name that it does not take.
    return ScanInput(path, name, beside if os.path.exists(beside) else None)


def _inside(folder: Path, above: frozenset[Path]) -> Iterator[Path]:
    """Yield all volumes in a folder and in those below it, given the real ones that lead to it."""
    real = folder.resolve()
    # A link may lead round in a circle.
    if real in above:
        return
    try:
        entries = sorted(folder.iterdir())
        # Refused too where names can be listed and nothing behind them can be read.
        os.stat(os.path.join(folder, "."))
    except OSError:
        # The work on it says why.
        yield folder
        return
    files = [e for e in entries if os.path.isfile(e)]
    slices = slices_in(folder)
    # Stacks beside two pictures are scans of their own.
    whole = bool(slices) and all(map(is_slice, slices))
    taken = frozenset(slices if whole else ())
    yield from without_labels(f for f in files if suffix_of(f) in _WHOLE and f not in taken)
    if whole or _holds_slices(files):
        yield folder
    for entry in entries:
        # What starts with a point is hidden, or half written; results are no inputs.
        mine = is_run(entry) or (entry.name == SCANS and is_run(folder))
        if os.path.isdir(entry) and not entry.name.startswith(".") and not mine:
            yield from [entry] if is_zarr(entry) else _inside(entry, above | {real})


def _holds_slices(files: list[Path]) -> bool:
    """Tell whether slices of a DICOM series are among the files of a folder."""
    # The first few tell: a series has its slices together.
    unnamed = [f for f in files if suffix_of(f) not in READABLE and f.name != "DICOMDIR"][:20]
    return any(suffix_of(f) in DICOM_SUFFIXES for f in files) or any(map(is_dicom, unnamed))


COLUMNS = ("volume", "labels", "name", "spacing")
"""What a table of volumes may say of each; others are a person's own."""


MISSING = frozenset({"", "na", "n/a", "nan", "null", "none"})
"""What programs write into a table for labels and voxel sizes that there are not."""


def _listed(table: Path) -> Iterator[ScanInput]:
    """Yield the scans of a table."""
    import pandas as pd

    if suffix_of(table) == ".parquet":
        needed("pyarrow", "reading Parquet tables", "batch")
    try:
        # As text, so that names of digits keep their zeros, and NA is a name; people put blanks
        # after commas.
        csv = partial(pd.read_csv, dtype=str, skipinitialspace=True, keep_default_na=False)
        if suffix_of(table) == ".parquet":
            rows: Any = pd.read_parquet(table)
            given = list(map(str, rows))
        else:
            rows = csv(table)
            # Before pandas gives the second of two alike a name of its own.
            given = list(map(str, csv(table, header=None, nrows=1).iloc[0]))
    except Exception as error:
        # Of pandas and of pyarrow, which have errors of their own.
        raise ValueError(f"{table} is no readable table: {error}") from error
    rows.columns = [name.strip().lower() for name in given]
    if "volume" not in rows:
        raise ValueError(f"{table} must have a column 'volume', got {given}")
    if any(list(rows.columns).count(name) > 1 for name in COLUMNS):
        raise ValueError(f"{table} must have each column once, got {given}")
    used = rows.loc[:, rows.columns.isin(COLUMNS)]
    for number, row in enumerate(used.to_dict("records"), 1):
        where = f"row {number} of {table}"
        volume = _entry(row, "volume")
        if volume is None:
            raise ValueError(f"{where} names no volume")
        labels, name = _entry(row, "labels"), _entry(row, "name")
        path = _plain(table.parent / given_path(volume))
        scan = replace(_scan(path), spacing=_spacing(row.get("spacing"), where))
        # What a table leaves out counts as left out: no labels are looked for beside the volume.
        own = _plain(table.parent / given_path(labels)) if labels else None
        scan = replace(scan, labels=own if "labels" in row else scan.labels)
        yield replace(scan, name=name or scan.name)


def _entry(row: dict[str, Any], column: str) -> str | None:
    value = row.get(column)
    missing = _is_missing(value) or (column == "labels" and str(value).strip().lower() in MISSING)
    # Whole numbers beside missing ones, as Parquet has them.
    value = int(value) if isinstance(value, float) and value % 1 == 0 else value
    return None if missing or not str(value).strip() else str(value).strip()


def _spacing(value: Any, where: str) -> Spacing | None:
    missing = _is_missing(value) or str(value).strip().lower() in MISSING
    return None if missing else spacing_from(value, where)


def _is_missing(value: Any) -> bool:
    return value is None or (isinstance(value, float) and math.isnan(value))


def told_apart(scans: list[ScanInput], taken: Iterable[str] = ()) -> list[ScanInput]:
    """Return scans with names that differ, also where upper and lower case are one.

    Parameters
    ----------
    scans : list of ScanInput
    taken : iterable of str
        Names of other scans.
    """
    given = {name.lower() for name in taken}
    counts = Counter([*given, *(scan.name.lower() for scan in scans)])
    # Such as many patients' folders with a file of one name each.
    longer = [
        replace(s, name=printable(f"{s.volume.parent.name}-{s.name}"))
        if counts[s.name.lower()] > 1
        else s
        for s in scans
    ]
    own, told = {scan.name.lower() for scan in longer}, []
    for scan in longer:
        name, number = scan.name, 1
        # Neither a name that was made nor one that another scan has of its own.
        while name.lower() in given or (number > 1 and name.lower() in own):
            number += 1
            name = f"{scan.name}-{number}"
        given.add(name.lower())
        told.append(replace(scan, name=name))
    return told
