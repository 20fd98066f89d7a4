"""The table of docs/reliability.md, and how many tests stand behind each of its rows.

Run as `make reliability` does: prints a line a row, with the number of tests that pytest finds for
each name, parameters counted. Ends with status 1 where a name has none.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "reliability.md"


@dataclass(frozen=True)
class TableRow:
    """A row, and the (file, function) of the tests it names; no function means all of a file."""

    fault: str
    cases: str
    tests: tuple[tuple[Path, str], ...]


def table() -> list[TableRow]:
    """Return the rows of the page's table."""
    lines = [line for line in PAGE.read_text("utf-8").splitlines() if line.startswith("| ")]
    found = []
    for line in lines[1:]:
        fault, cases, _, named = (cell.strip() for cell in line.strip("|").split(" | "))
        found.append(TableRow(fault, cases, tuple(_named(named))))
    return found


def _named(cell: str) -> list[tuple[Path, str]]:
    files = {path.name: path for path in (ROOT / "tests").rglob("test_*.py")}
    found: list[tuple[Path, str]] = []
    for name in re.findall(r"`([^`]+)`", cell):
        file, _, function = name.partition("::")
        # A second test of the same file may leave it out.
        path = found[-1][0] if file == "..." else files.get(Path(file).name, ROOT / file)
        found.append((path, function))
    return found


def counted(paths: set[Path]) -> Counter[tuple[Path, str]]:
    """Return how many tests pytest finds, by file and function."""
    words = ("-m", "pytest", "-p", "pytest_timeout", "--collect-only", "-q")
    said = subprocess.run(
        (sys.executable, *words, *map(str, sorted(paths))),
        cwd=ROOT,
        # Plugins of pytest take seconds to load. Marks of one are known by its name above.
        env=os.environ | {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
        capture_output=True,
        text=True,
        check=False,
    ).stdout
    found: Counter[tuple[Path, str]] = Counter()
    for file, function in re.findall(r"^([\w/]+\.py)::(\w+)", said, re.MULTILINE):
        found[ROOT / file, function] += 1
        found[ROOT / file, ""] += 1
    return found


def main() -> int:
    """Print the rows; return 1 where a test is missing."""
    rows = table()
    found, missing = counted({path for row in rows for path, _ in row.tests}), 0
    for row in rows:
        print(f"{row.fault}: {row.cases}")
        for test in row.tests:
            path, function = test
            missing += not found[test]
            print(f"  {found[test]:4} {path.name}{'::' + function if function else ''}")
    print(f"{len(rows)} classes of fault; names without a test: {missing}")
    return int(missing > 0)


if __name__ == "__main__":
    raise SystemExit(main())
