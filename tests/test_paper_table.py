"""Every module, definition, shader and test that docs/paper.md names is in the repository.

So is every step of the journeys of docs/architecture.md, and all of the package is in its table.
"""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "napari_unpack"
PAGE = (ROOT / "docs" / "paper.md").read_text("utf-8")
FROM_ROOT = ("shaders/", "tests/", "benchmarks/", "docs/")
NAMED = re.compile(r"`([\w./-]+/[\w.-]+\.(?:py|comp|frag|vert|glsl|md|png))(?::([\w.]+))?`")
NAMES = sorted(set(NAMED.findall(PAGE)))


def place(path: str) -> Path:
    return ROOT / path if path.startswith(FROM_ROOT) else PACKAGE / path


def targets(node: ast.stmt) -> list[str]:
    """Return the plain names that an assignment gives a value."""
    if isinstance(node, ast.AnnAssign):
        return [node.target.id] if isinstance(node.target, ast.Name) else []
    if isinstance(node, ast.Assign):
        return [target.id for target in node.targets if isinstance(target, ast.Name)]
    return []


def body(statements: list[ast.stmt]) -> dict[str, ast.stmt]:
    """Return by name what a module or a class defines."""
    found: dict[str, ast.stmt] = {}
    for node in statements:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            found[node.name] = node
        found |= dict.fromkeys(targets(node), node)
    return found


@cache
def definitions(path: Path) -> dict[str, ast.stmt]:
    return body(ast.parse(path.read_text("utf-8")).body)


@cache
def classes() -> dict[str, ast.ClassDef]:
    """Return every class of the package by name, to find what a class inherits."""
    return {
        name: node
        for path in PACKAGE.rglob("*.py")
        for name, node in definitions(path).items()
        if isinstance(node, ast.ClassDef)
    }


def has_member(owner: ast.stmt | None, member: str) -> bool:
    if not isinstance(owner, ast.ClassDef):
        return False
    if member in body(owner.body):
        return True
    bases = [classes().get(base.id) for base in owner.bases if isinstance(base, ast.Name)]
    return any(has_member(base, member) for base in bases)


def is_defined(path: Path, name: str) -> bool:
    if path.suffix != ".py":
        function = re.compile(rf"^\w+ {re.escape(name)}\(", re.MULTILINE)
        return bool(function.search(path.read_text("utf-8")))
    owner, _, member = name.partition(".")
    known = definitions(path)
    return has_member(known.get(owner), member) if member else owner in known


def test_the_page_names_much_of_the_package() -> None:
    assert len(NAMES) > 150
    # The pattern misses none that is written in another way.
    quoted = re.findall(r"`[^`\s]+\.(?:py|comp|frag|vert|glsl)(?::[^`]*)?`", PAGE)
    assert [text for text in quoted if not NAMED.fullmatch(text)] == []


@pytest.mark.parametrize(("path", "name"), NAMES, ids=[":".join(pair) for pair in NAMES])
def test_what_the_page_names_is_there(path: str, name: str) -> None:
    assert place(path).is_file(), f"docs/paper.md names {path}, which does not exist"
    assert not name or is_defined(place(path), name), f"{path} defines no {name}"


@pytest.mark.parametrize("kind", ["R", "D"])
def test_numbers_of_readings_and_deviations_lead_somewhere(kind: str) -> None:
    told = [int(n) for n in re.findall(rf"\*\*{kind}(\d+)[.,:]", PAGE)]
    assert sorted(told) == list(range(1, len(told) + 1))
    assert len(told) >= 15
    assert {int(n) for n in re.findall(rf"\b{kind}(\d+)\b", PAGE)} == set(told)


ARCHITECTURE = (ROOT / "docs" / "architecture.md").read_text("utf-8")
JOURNEYS = ARCHITECTURE.split("## Four journeys")[1].split("\n## ")[0]
# The names that follow a file: "`a.py`, `one`" and "`a.py`".
STEPS = sorted(set(re.findall(r"`([\w/]+\.py)`(?:, `([\w.]+)`)?", JOURNEYS)))


def test_the_journeys_have_many_steps() -> None:
    assert len(STEPS) > 35
    assert sum(bool(name) for _, name in STEPS) > 25


@pytest.mark.parametrize(("path", "name"), STEPS, ids=[":".join(pair) for pair in STEPS])
def test_what_a_journey_names_is_there(path: str, name: str) -> None:
    # Some are named within the folder that the step is in.
    files = [PACKAGE / path] if (PACKAGE / path).is_file() else list(PACKAGE.rglob(path))
    assert files, f"docs/architecture.md names {path}, which does not exist"
    kinds = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef
    tree = ast.walk(ast.parse(files[0].read_text("utf-8")))
    assert not name or name in {node.name for node in tree if isinstance(node, kinds)}


def test_every_part_of_the_package_is_in_the_table_of_packages() -> None:
    table = ARCHITECTURE.split("## The packages")[1].split("\n## ")[0]
    rows = "".join(line.split("|")[1] for line in table.splitlines() if line.startswith("|"))
    named = set(re.findall(r"`([\w.]+)`", rows))
    parts = {path.name for path in PACKAGE.iterdir() if not path.name.startswith("_")}
    parts -= {"napari.yaml", "py.typed"}
    assert named == parts
