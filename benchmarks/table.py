"""The table as people read it on a terminal, and as Markdown."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from benchmarks.row import Row

HEADINGS = ("what", "work", "ours", "peer", "ratio", "goal", "")
WIDTHS = (24, 30, 20, 30, 8, 22, 7)
MARKS = {True: "met", False: "missed", None: ""}


def cells(row: Row) -> tuple[str, ...]:
    """Return the cells of a row."""
    return (row.what, row.work, row.ours, row.peer, row.ratio, row.goal, MARKS[row.met])


def heading() -> str:
    """Return the first two lines of the table."""
    return _lines(HEADINGS) + "\n" + "  ".join("-" * width for width in WIDTHS)


def text(row: Row) -> str:
    """Return a row, its long cells wrapped."""
    return _lines(cells(row))


def markdown(rows: Sequence[Row]) -> str:
    """Return the whole table in Markdown."""
    lines = ["| " + " | ".join(HEADINGS) + " |", "|" + "---|" * len(HEADINGS)]
    lines += ["| " + " | ".join(cells(row)) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def _lines(values: Sequence[str]) -> str:
    columns = [textwrap.wrap(v, w) or [""] for v, w in zip(values, WIDTHS, strict=True)]
    height = max(map(len, columns))
    rows = []
    for i in range(height):
        parts = [
            (column[i] if i < len(column) else "").ljust(width)
            for column, width in zip(columns, WIDTHS, strict=True)
        ]
        rows.append("  ".join(parts).rstrip())
    return "\n".join(rows)
