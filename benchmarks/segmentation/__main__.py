"""Measure segmentations of bags nobody has tuned on, beside the plain peers.

`python -m benchmarks.segmentation` takes ten bags of each generator (seeds from 9001 on), five
scanned by rays, and the nuclei where they are here.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from benchmarks.segmentation.bags import HELD_OUT, cases
from benchmarks.segmentation.ours import OURS
from benchmarks.segmentation.peers import PEERS
from benchmarks.segmentation.report import Report, markdown

DOCUMENT = Path(__file__).parents[2] / "docs" / "segmentation.md"
FAMILIES = {"first": 10, "second": 10, "projection": 5, "cells": 1}
TITLES = {
    "first": "Bags of the package's generator",
    "second": "Bags of the second generator",
    "projection": "Bags scanned by rays",
    "cells": "Nuclei",
}


def main(arguments: list[str] | None = None) -> int:
    """Measure and print; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.segmentation", description=__doc__)
    parser.add_argument("families", nargs="*", help=f"of {', '.join(FAMILIES)}; by default all")
    parser.add_argument("--count", type=int, help="bags of each family")
    parser.add_argument("--first", type=int, default=HELD_OUT, help="seed of the first bag")
    parser.add_argument("--only", nargs="+", default=[""], help="parts of methods' names")
    parser.add_argument("--write", action="store_true", help=f"also write {DOCUMENT.name}")
    options = parser.parse_args(arguments)
    families = options.families or list(FAMILIES)
    for family in families:
        if family not in FAMILIES:
            parser.error(f"no family is called {family!r}; there are {', '.join(FAMILIES)}")
    methods = [m for m in (*PEERS, *OURS) if any(part in m[0] for part in options.only)]
    parts = []
    for family in families:
        report = Report()
        try:
            for case in cases(family, options.count or FAMILIES[family], options.first):
                for method, find in methods:
                    start = time.perf_counter()
                    for setting, found in find(case.volume, case.spacing):
                        report.add(method, setting, case, found, time.perf_counter() - start)
                        start = time.perf_counter()
        except FileNotFoundError as error:
            print(f"{TITLES[family]}: skipped, {error}\n")
            continue
        parts.append(_text(family, report))
        print(parts[-1], flush=True)
    if options.write:
        DOCUMENT.write_text("\n".join([HEAD, *parts]))
    return 0


HEAD = """# How well segmentation does

`python -m benchmarks.segmentation --write` renews this page. Every peer is given our foreground and
stands with the setting that suits a family best; ours has one setting for all. Seconds are of one
setting, on a busy machine. Shares by kind are of objects matched at IoU > 0.5; shares by class of
objects detected with precision and recall of 50 %, sheets 20 %.
"""


def _text(family: str, report: Report) -> str:
    count = len({row["case"] for row in report.totals})
    parts = [f"## {TITLES[family]} ({count})", "", markdown(report.metrics(), "method"), ""]
    if family != "cells":
        parts += [markdown(report.by("group"), "class"), "", markdown(report.by("kind"), "kind")]
    return "\n".join([*parts, ""])


if __name__ == "__main__":
    raise SystemExit(main())
