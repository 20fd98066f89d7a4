"""Which kinds of objects segmentation misses, and why: from the tables of docs/segmentation.md."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

FAMILIES = {
    "Bags of the package's generator": "the package's",
    "Bags of the second generator": "the second",
}
OURS = "ours"
TOTALS = ("f1", "voi", "count_error")
ENOUGH = 0.8
"""A kind of which this share is found needs no reason."""

CLOTH = "cloth that winds through the bag comes apart where it is thin, and its ends go elsewhere"
BESIDE = "joined with what lies flat against it at nearly its density"
REASONS = {
    "wrap": "a thin sheet around part of a thing looks like the wall of a container, which by "
    "definition is one with its filling; at one density with what it wraps, nothing parts them",
    "plate": BESIDE,
    "tube": BESIDE,
    "belt": "one of three, joined with a larger thing that it touches",
    "phone": BESIDE,
    "book": BESIDE,
    "carton": BESIDE,
    "coin": "one and a half voxels thick and stacked in a pouch: the stack comes as one object",
    "scissors": "handles and blades come as two or three objects",
    "headphones": "two cups and a bow come as three objects: the bow is thin where it meets them",
    "mug": "joined with what is in it or presses against its side",
    "cutlery": "fork and knife lie apart and come as two objects, or one goes with its neighbour",
    "pouch": "joined with cloth around it, or in two where a stiff content parts it",
    "trousers": CLOTH,
    "scarf": CLOTH,
    "sweater": CLOTH,
    "towel": CLOTH,
}
"""Seen on validation bags, by what the missed objects were joined with or came as."""


@dataclass(frozen=True)
class Table:
    """A table of Markdown: the heading above it, its columns, and its rows of text."""

    heading: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def tables(text: str) -> list[Table]:
    """Return the tables of a page; headings without the number of bags behind them."""
    found, heading = [], ""
    for block in re.split(r"\n\s*\n", text):
        lines = block.strip().splitlines()
        if lines and lines[0].startswith("## "):
            heading = re.sub(r"\s*\(\d+\)$", "", lines[0][3:])
        if len(lines) > 2 and lines[0].startswith("|"):
            cells = [tuple(c.strip() for c in line.strip("| ").split("|")) for line in lines]
            found.append(Table(heading, cells[0], tuple(cells[2:])))
    return found


def section(text: str) -> str:
    """Return the section of docs/benchmarks.md, given the text of docs/segmentation.md."""
    totals: dict[str, list[float]] = {}
    missed: list[tuple[str, str, int, float]] = []
    for table in tables(text):
        family = FAMILIES.get(table.heading)
        if family is None:
            continue
        if table.columns[0] == "method":
            ours = next(
                dict(zip(table.columns, r, strict=True)) for r in table.rows if r[0] == OURS
            )
            totals[family] = [float(ours[name]) for name in TOTALS]
        elif table.columns[0] == "kind":
            found = table.columns.index(OURS)
            kinds = [(row[0], int(row[1]), float(row[found])) for row in table.rows]
            missed += [(family, *kind) for kind in kinds if kind[2] < ENOUGH]
    totals["mean of both"] = np.mean(list(totals.values()), axis=0).tolist()
    lines = ["\n## Where segmentation falls short, and why\n"]
    lines += [
        "| twenty unseen bags | F1 at IoU 0.5 | VOI, bits | count error |",
        "|---|---|---|---|",
    ]
    for name, (f1, voi, count) in totals.items():
        lines.append(f"| {name} | {f1:.2f} | {voi:.2f} | {count:.0%} |")
    lines.append("| goal | >= 0.85 | <= 0.40 | <= 10% |")
    lines += ["", f"Kinds of which less than {ENOUGH:.0%} is found:", ""]
    lines += [
        "| kind | bags | objects | found | why the others are missed |",
        "|---|---|---|---|---|",
    ]
    for family, kind, objects, share in sorted(missed, key=lambda row: row[3]):
        why = REASONS.get(kind, "see segmentation.md")
        lines.append(f"| {kind} | {family} | {objects} | {share:.0%} | {why} |")
    return "\n".join(lines) + "\n"
