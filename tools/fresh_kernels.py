"""Drop compiled kernels that are older than a module they were made from.

`python tools/fresh_kernels.py [FOLDER]`; the folder, src by default, holds the packages.

numba keeps a kernel beside its module and drops it when that one file changes. What the kernel
inlines from other modules may change unnoticed, so that after an edit, or a pull, old code runs.
Here a kernel is kept while it is younger than every module that its own imports, however far.
"""

from __future__ import annotations

import ast
import sys
from functools import cache
from pathlib import Path


@cache
def imported(module: Path, folder: Path) -> frozenset[Path]:
    """Return the files below a folder that a module names in its imports, wherever they stand."""
    found: set[Path] = set()
    for node in ast.walk(ast.parse(module.read_text("utf-8"))):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        for name in names:
            stem = folder.joinpath(*name.split("."))
            found.update(filter(Path.is_file, (stem.with_suffix(".py"), stem / "__init__.py")))
    return frozenset(found)


def reached(module: Path, folder: Path) -> set[Path]:
    """Return a module and all that it imports, directly or through others."""
    seen, left = {module}, [module]
    while left:
        new = imported(left.pop(), folder) - seen
        seen |= new
        left += new
    return seen


def stale_kernels(folder: Path) -> list[Path]:
    """Return the files of numba's cache that are older than what they were made from."""
    stale: list[Path] = []
    for module in folder.rglob("*.py"):
        kernels = [
            kernel
            for ending in ("nbi", "nbc")
            for kernel in (module.parent / "__pycache__").glob(f"{module.stem}.*-*.{ending}")
        ]
        if kernels:
            newest = max(path.stat().st_mtime for path in reached(module, folder))
            stale += [kernel for kernel in kernels if kernel.stat().st_mtime < newest]
    return stale


def main() -> None:
    """Drop them and say how many there were."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "src"
    stale = stale_kernels(folder)
    for kernel in stale:
        kernel.unlink(missing_ok=True)
    if stale:
        print(f"[kernels] {len(stale)} compiled before their last edit are made anew")


if __name__ == "__main__":
    main()
