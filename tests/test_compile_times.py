"""Kernels keep off what takes numba long to compile."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src" / "napari_unpack"
# Numbers, though they do not look so.
SCALARS = {"names[0]"}


def slices_assigned(path: Path) -> list[str]:
    """List the assignments to slices in the kernels of a module, but for those of a number."""
    found = []
    for function in ast.walk(ast.parse(path.read_text("utf-8"))):
        if not isinstance(function, ast.FunctionDef):
            continue
        if not any("njit" in ast.unparse(each) for each in function.decorator_list):
            continue
        for node in ast.walk(function):
            targets = node.targets if isinstance(node, ast.Assign) else []
            for target in targets:
                into = any(isinstance(part, ast.Slice) for part in ast.walk(target))
                number = isinstance(node.value, ast.Constant)
                if into and not number and ast.unparse(node.value) not in SCALARS:
                    found.append(f"{path.name}:{node.lineno} {ast.unparse(node)}")
    return found


@pytest.mark.parametrize("package", sorted(p.name for p in SOURCE.iterdir() if p.is_dir()))
def test_no_kernel_assigns_an_array_to_a_slice(package) -> None:
    # numba compiles the sentence of its error, with all that strings need: three seconds each.
    assert [a for p in (SOURCE / package).rglob("*.py") for a in slices_assigned(p)] == []
