"""Print one table of what the package has to reach, with peers measured in the same run."""

from __future__ import annotations

import argparse
import os
import platform
import sys
import time
import traceback
from pathlib import Path

from benchmarks import plots, table
from benchmarks.on_screen import keep_screen_for_children
from benchmarks.row import Row
from benchmarks.rows import ORDER, chosen
from benchmarks.scenes import Scenes

DOCUMENT = Path(__file__).parents[1] / "docs" / "benchmarks.md"


def main(arguments: list[str] | None = None) -> int:
    """Measure and print; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("rows", nargs="*", help=f"parts of names of rows: {', '.join(ORDER)}")
    parser.add_argument("--quick", action="store_true", help="half of every edge: a rehearsal")
    parser.add_argument("--write", action="store_true", help=f"also write {DOCUMENT.name}")
    options = parser.parse_args(arguments)
    try:
        rows = chosen(options.rows)
    except ValueError as error:
        parser.error(str(error))
    keep_screen_for_children()
    scenes = Scenes(options.quick)
    start = time.perf_counter()
    print(_machine() + (", QUICK: half of every edge" if options.quick else ""))
    print("\n" + table.heading(), flush=True)
    done: list[Row] = []
    broken = 0
    for name, measure in rows:
        try:
            measured = measure(scenes)
        except Exception as error:
            # One broken row must not cost the others; the exit status tells.
            broken += 1
            traceback.print_exc(file=sys.stderr)
            measured = [Row(name, "", f"broken: {type(error).__name__}: {error}", met=False)]
        done += measured
        for row in measured:
            print(table.text(row), flush=True)
    minutes = (time.perf_counter() - start) / 60
    print(f"\n{sum(r.met is False for r in done)} missed, {minutes:.1f} minutes")
    if options.write:
        DOCUMENT.write_text(
            "# Measurements\n\n`make bench` made this table; `python -m benchmarks --write` "
            f"renews it. {_machine()}. What limits the casters is in profiles.md.\n\n{MISSED}\n"
            f"{table.markdown(done)}" + plots.section(scenes.figures)
        )
    return 1 if broken else 0


MISSED = """\
How well segmentation does, by kind of object and beside its peers, is in segmentation.md, with what
fails and why.
"""


def _machine() -> str:
    cores = os.cpu_count()
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [line for line in cpuinfo.read_text().splitlines() if "model name" in line]
        model = names[0].split(":")[1].strip() if names else model
    return f"{cores} cores of {model}, Python {platform.python_version()}"


if __name__ == "__main__":
    sys.exit(main())
