"""What test_house.py counts in the sources: definitions, docstrings, comments, private names."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator

Function = ast.FunctionDef | ast.AsyncFunctionDef
DIRECTIVE = re.compile(r"#\s*(type:|noqa|ruff:|pragma|fmt:|!)")


def comments(text: str) -> int:
    """Count the comments of a source, without directives to tools."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return sum(t.type == tokenize.COMMENT and not DIRECTIVE.match(t.string) for t in tokens)


def is_public(name: str) -> bool:
    return not name.startswith("_")


def decorators(node: Function | ast.ClassDef) -> set[str]:
    """Return the last names of what decorates a definition: property, setter, dataclass."""
    calls = [d.func if isinstance(d, ast.Call) else d for d in node.decorator_list]
    return {ast.unparse(call).rsplit(".", 1)[-1] for call in calls}


def arguments(node: Function) -> list[ast.arg]:
    """Return what a caller passes; not self, not cls."""
    given = node.args
    found = [*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg]
    return [arg for arg in found if arg is not None and arg.arg not in ("self", "cls")]


def raises(node: Function) -> bool:
    """Return whether a function itself raises a new error; helpers and nested functions aside."""
    waiting: list[ast.AST] = list(node.body)
    while waiting:
        inner = waiting.pop()
        if isinstance(inner, ast.Raise) and isinstance(inner.exc, ast.Call):
            return "NotImplementedError" not in ast.unparse(inner.exc)
        if not isinstance(inner, Function | ast.ClassDef | ast.Lambda):
            waiting.extend(ast.iter_child_nodes(inner))
    return False


def public_callables(tree: ast.Module) -> Iterator[tuple[str, int, str, bool]]:
    """Yield what others may call: its name, number of arguments, docstring, whether it raises.

    A class is called too: its arguments are those of `__init__` or the fields of a dataclass, and
    its docstring says them.
    """
    for node in tree.body:
        if isinstance(node, Function) and is_public(node.name):
            yield node.name, len(arguments(node)), ast.get_docstring(node) or "", raises(node)
        if not isinstance(node, ast.ClassDef) or not is_public(node.name):
            continue
        text, fields = ast.get_docstring(node) or "", 0
        if "dataclass" in decorators(node):
            fields = sum(
                isinstance(f, ast.AnnAssign) and is_public(ast.unparse(f.target)) for f in node.body
            )
        for method in node.body:
            if not isinstance(method, Function) or "overload" in decorators(method):
                continue
            name, told = method.name, ast.get_docstring(method) or ""
            if name == "__init__":
                yield node.name, len(arguments(method)), text + told, raises(method)
            elif is_public(name):
                yield f"{node.name}.{name}", len(arguments(method)), told, raises(method)
        if fields:
            yield node.name, fields, text, False


def undocumented(tree: ast.Module) -> tuple[list[str], list[str]]:
    """Return which public callables of two or more arguments lack Parameters, which Raises."""
    found = list(public_callables(tree))
    lacking = [name for name, n, text, _ in found if n > 1 and "Parameters\n---" not in text]
    silent = [name for name, _, text, throws in found if throws and "Raises\n---" not in text]
    return lacking, silent


def methods(node: ast.ClassDef) -> int:
    """Count the methods of a class; a property with its setter is one."""
    return len({item.name for item in node.body if isinstance(item, Function)})


def untyped(tree: ast.AST, known: frozenset[str]) -> list[int]:
    """Return the lines at which something with a known name is annotated `Any`."""
    lines = []
    for node in ast.walk(tree):
        if isinstance(node, ast.arg) and node.annotation is not None:
            name, note = node.arg, node.annotation
        elif isinstance(node, ast.AnnAssign):
            name, note = ast.unparse(node.target).rsplit(".", 1)[-1], node.annotation
        elif isinstance(node, Function) and node.returns is not None:
            name, note = node.name, node.returns
        else:
            continue
        if name.strip("_") in known and re.search(r"\bAny\b", ast.unparse(note)):
            lines.append(node.lineno)
    return lines


def called(node: ast.Call) -> str:
    """Return the last name of what is called, nothing where that is no name."""
    return str(getattr(node.func, "attr", getattr(node.func, "id", "")))


def private_reads(tree: ast.AST) -> list[int]:
    """Return the lines that read or replace a private attribute of another object."""
    lines = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            name = node.attr
            if isinstance(node.value, ast.Name) and node.value.id in ("self", "cls"):
                continue
        elif isinstance(node, ast.Call) and called(node).endswith("attr"):
            given = node.args[1] if len(node.args) > 1 else None
            name = str(given.value) if isinstance(given, ast.Constant) else ""
        else:
            continue
        if name.startswith("_") and not name.startswith("__"):
            lines.append(node.lineno)
    return lines


THEIRS = frozenset({"canvas", "scene_canvas", "context", "window", "qt_viewer", "native"})
"""Names of objects of napari and vispy whose methods a program may want to replace."""

THEIR_DATA = frozenset({"background_color_override"})
"""Public attributes of theirs that are there to be set."""


def replacements(tree: ast.Module) -> Iterator[int]:
    """Return the lines that set or delete an attribute of an object or class of napari or vispy."""
    nodes = list(ast.walk(tree))
    imported = {
        (alias.asname or alias.name).split(".")[0]
        for node in nodes
        if isinstance(node, ast.Import | ast.ImportFrom)
        for alias in node.names
        if (getattr(node, "module", None) or alias.name).split(".")[0] in {"napari", "vispy"}
    }
    for node in nodes:
        if isinstance(node, ast.Attribute) and not isinstance(node.ctx, ast.Load):
            held, name = node.value, node.attr
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") in {"setattr", "delattr"}:
            held, name = node.args[0], getattr(node.args[1], "value", "")
        else:
            continue
        last = getattr(held, "attr", getattr(held, "id", "")).lstrip("_")
        root = held
        while isinstance(root, ast.Attribute):
            root = root.value
        theirs = last in THEIRS or getattr(root, "id", None) in imported
        if theirs and name not in THEIR_DATA:
            yield node.lineno
