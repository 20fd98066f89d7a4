"""The house rules that linters cannot see."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = sorted((ROOT / "src" / "napari_unpack").rglob("*.py"))
SHADERS = [
    p for p in (ROOT / "shaders").rglob("*") if p.suffix in {".glsl", ".frag", ".vert", ".comp"}
]
PRIVATE_NAPARI = re.compile(r"napari(\.\w+)*\._|_qt_viewer|_qt_window|vispy(\.\w+)*\._")


def _relative(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def test_there_are_sources_to_judge() -> None:
    assert len(SOURCES) > 20


def test_private_napari_and_vispy_names_live_in_compat_alone() -> None:
    offenders = [
        f"{_relative(path)}:{number}"
        for path in SOURCES
        if not path.as_posix().endswith("layers/compat.py")
        for number, line in enumerate(path.read_text().splitlines(), 1)
        if PRIVATE_NAPARI.search(line)
    ]
    assert offenders == []


def test_no_file_is_longer_than_700_lines() -> None:
    files = [
        *SOURCES,
        *SHADERS,
        *(ROOT / "tests").rglob("*.py"),
        *(ROOT / "benchmarks").rglob("*.py"),
    ]
    too_long = [_relative(p) for p in files if len(p.read_text().splitlines()) > 700]
    assert too_long == []


def test_nothing_is_pickled() -> None:
    offenders = [
        _relative(p)
        for p in SOURCES
        if re.search(r"\bpickle\b|allow_pickle=True|joblib", p.read_text())
    ]
    assert offenders == []


@pytest.mark.parametrize("path", SOURCES, ids=_relative)
def test_every_public_definition_has_a_docstring(path: Path) -> None:
    tree = ast.parse(path.read_text())
    assert ast.get_docstring(tree), "the module says what it is for"
    bare = [
        node.name
        for node in tree.body
        if isinstance(node, ast.FunctionDef | ast.ClassDef)
        and not node.name.startswith("_")
        and not ast.get_docstring(node)
    ]
    assert bare == []


def test_every_shader_opens_with_a_comment_naming_its_twin_and_test() -> None:
    silent = [
        _relative(p)
        for p in SHADERS
        if not all(word in p.read_text()[:2000].lower() for word in ("twin", "test"))
    ]
    assert silent == []
