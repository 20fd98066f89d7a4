"""Drop compiled kernels that are older than a module they were made from.

`python tools/fresh_kernels.py [FOLDER]`; the folder, src by default, holds the packages.

numba keeps a kernel beside its module and drops it when that one file changes. What the kernel
inlines from other modules may change unnoticed, so that after an edit, or a pull, old code runs.
Here a kernel is kept while it is younger than the last change of code in every module that its own
imports, however far. A new comment, a new docstring or a file written again as it was is no change
of code: what each module held at the last look is kept in `__pycache__/kernel_sources.json`.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path

Sources = dict[str, dict[str, str | float]]


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


def code_hash(text: str) -> str:
    """Return a hash of a module's code, which comments, docstrings and layout do not change."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            body[:] = [one for one in body if not _is_text(one)]
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()


def _is_text(node: ast.stmt) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


@dataclass(frozen=True)
class Changes:
    """When the code of modules changed, as far as was noticed; times in s since the epoch.

    Parameters
    ----------
    looked : float
        Time of the last look, 0 where there was none.
    changed : dict of Path to float
        By module, the last change of its code.
    rewritten : dict of Path to float
        When modules were written that hold the same code as at the last look. In between they may
        have held other code.
    """

    looked: float
    changed: dict[Path, float]
    rewritten: dict[Path, float]

    def made_stale(self, kernel: float, modules: set[Path]) -> bool:
        """Tell whether a kernel compiled at a time from these modules is out of date."""
        return any(kernel < self.changed[module] for module in modules) or any(
            self.looked < kernel < self.rewritten.get(module, 0.0) for module in modules
        )


def code_changes(folder: Path) -> Changes:
    """Compare the modules below a folder with the last look, and keep what they hold now."""
    notes = folder / "__pycache__" / "kernel_sources.json"
    known: Sources = {}
    looked = 0.0
    if notes.exists():
        known, looked = json.loads(notes.read_text("utf-8")), notes.stat().st_mtime
    seen: Sources = {}
    rewritten: dict[Path, float] = {}
    for module in folder.rglob("*.py"):
        name, written = module.relative_to(folder).as_posix(), module.stat().st_mtime
        before = known.get(name)
        if before is not None and before["written"] == written:
            seen[name] = before
            continue
        text = module.read_bytes()
        content, code = hashlib.sha256(text).hexdigest(), code_hash(text.decode("utf-8"))
        changed = written
        if before is not None and before["code"] == code:
            changed, rewritten[module] = float(before["changed"]), written
        if before is not None and before["content"] == content:
            # numba compares times: a file that git wrote again as it was gets its own time back.
            written = float(before["written"])
            os.utime(module, (written, written))
        seen[name] = {"written": written, "content": content, "code": code, "changed": changed}
    notes.parent.mkdir(exist_ok=True)
    notes.write_text(json.dumps(seen), "utf-8")
    changes = {folder / name: float(source["changed"]) for name, source in seen.items()}
    return Changes(looked, changes, rewritten)


def stale_kernels(folder: Path) -> list[Path]:
    """Return the files of numba's cache that are older than what they were made from."""
    stale: list[Path] = []
    changes = code_changes(folder)
    for module in folder.rglob("*.py"):
        kernels = [
            kernel
            for ending in ("nbi", "nbc")
            for kernel in (module.parent / "__pycache__").glob(f"{module.stem}.*-*.{ending}")
        ]
        if kernels:
            modules = reached(module, folder)
            stale += [one for one in kernels if changes.made_stale(one.stat().st_mtime, modules)]
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
