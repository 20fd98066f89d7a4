"""The index of a run: one page with a picture of each scan, which leads to the scan's own page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path
from urllib.parse import quote

from napari_unpack.atomic import written_atomically
from napari_unpack.batches.results import FILM, PAGE, PICTURE, ScanResult
from napari_unpack.batches.run_settings import INDEX
from napari_unpack.io.table_page import PageColumn, PageParts, number_cell, table_page

COLUMNS = (
    PageColumn("Picture", ""),
    PageColumn("Scan", "t", "part"),
    PageColumn("Result", "t", "part"),
    PageColumn("Objects", "n"),
    PageColumn("Seconds", "n"),
    PageColumn("MB", "n"),
    PageColumn("Source and notes", "t", "part"),
)

WORDS = {"done": "done", "kept": "done", "failed": "failed"}


def write_index(output: Path, results: Sequence[ScanResult]) -> Path:
    """Write the index of a run.

    Parameters
    ----------
    output : Path
        The run's folder; the page refers to what is in it.
    results : sequence of ScanResult
        One a row.
    """
    failed = sum(one.status == "failed" for one in results)
    counts = f"{len(results)} scans" + (f", {failed} failed" if failed else "")
    parts = PageParts(
        output.name,
        f"{counts}. Click a scan for its objects, a column to sort by it. All objects are in "
        "<a href='objects.parquet'>objects.parquet</a>, all scans in "
        "<a href='scans.parquet'>scans.parquet</a>. To go on with a scan in napari: "
        "<code>napari-unpack open FOLDER --scan NAME</code>.",
        "scan, failed, a reason",
    )
    page = table_page(parts, COLUMNS, _rows(output, results))
    target = output / INDEX
    with written_atomically(target) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return target


def _rows(output: Path, results: Sequence[ScanResult]) -> Iterator[str]:
    for one in results:
        folder, name = output / one.folder, escape(one.scan)
        href = {file: quote(f"{one.folder}/{file}") for file in (PAGE, PICTURE, FILM)}
        there = {file for file in href if one.folder and (folder / file).is_file()}
        alt = f"Objects of {name}"
        # Loaded as they come into sight: a thousand pictures are too many at once.
        image = (
            f'<img src="{href[PICTURE]}" alt="{alt}" loading="lazy">' if PICTURE in there else ""
        )
        title, linked = name, image
        if PAGE in there:
            title, linked = (f'<a href="{href[PAGE]}">{part}</a>' for part in (name, image))
        if FILM in there:
            title += f'<br><a href="{href[FILM]}">film</a>'
        told = [part for part in (one.reason, *one.notes, one.source) if part]
        done = one.status != "failed"
        yield (
            f'<tr><td class="scan picture">{linked}</td><td>{title}</td>'
            + f"<td>{WORDS[one.status]}</td>"
            + number_cell(one.objects if done else None, str(one.objects) if done else "–")
            + number_cell(one.seconds, f"{one.seconds:.1f}")
            + number_cell(one.megabytes if done else None, f"{one.megabytes:.1f}" if done else "–")
            + f'<td class="long">{"<br>".join(escape(part) for part in told)}</td></tr>'
        )
