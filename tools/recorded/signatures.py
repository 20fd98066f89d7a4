"""What the public names take: parameters, their kinds and defaults, and the command line's options.

Annotations are left out: better types change nothing for a caller.
"""

from __future__ import annotations

import inspect
import os
import re
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import napari_unpack as nu

SESSION = (
    "view", "direction", "recolor", "unpackable", "unpack", "restore", "inspect", "hide",
    "isolate", "reveal", "undo", "redo",
)  # fmt: skip
"""What README.md and DESIGN.md section 5 name of a session."""

ENTRY = (
    "import sys; from importlib.metadata import entry_points; "
    "(e,) = entry_points(group='console_scripts', name='napari-unpack'); "
    "sys.argv[0] = 'napari-unpack'; e.load()()"
)
COMMAND = re.compile(r"^[│|] ([a-z][\w-]*) ")
OPTIONS = re.compile(r"^[│|] \*? *((?:-{1,2}[A-Za-z][\w-]*[ ,]*)+)")


def parameters(function: Callable[..., Any]) -> str:
    """Return the parameters of a function as text, without annotations."""
    found = inspect.signature(function)
    bare = [p.replace(annotation=inspect.Parameter.empty) for p in found.parameters.values()]
    text = str(found.replace(parameters=bare, return_annotation=inspect.Signature.empty))
    return re.sub(r" at 0x[0-9a-f]+", "", text)


def signature(owner: type | None, name: str) -> str:
    """Return what stands behind a public name: parameters, or that it is a property.

    Parameters
    ----------
    owner : type, optional
        The class whose attribute it is; None for an export of the package.
    name : str

    Returns
    -------
    str
    """
    if owner is None:
        value = getattr(nu, name)
        return f"class {parameters(value)}" if isinstance(value, type) else parameters(value)
    value = inspect.getattr_static(owner, name, None)
    if value is None:
        return "missing"
    if isinstance(value, property):
        return "property" if value.fset is None else "property, settable"
    if isinstance(value, classmethod | staticmethod):
        return f"{type(value).__name__} {parameters(getattr(owner, name))}"
    return parameters(value) if callable(value) else "attribute"


def public_attributes(owner: type) -> list[str]:
    """Return the public names of a class, methods and properties, its fields left out."""
    return [
        name
        for name in sorted(dir(owner))
        if not name.startswith("_")
        and (isinstance(getattr(owner, name), property) or callable(getattr(owner, name)))
    ]


def library() -> dict[str, str]:
    """Return the signatures of all exports, and of the attributes of their classes."""
    found = {name: signature(None, name) for name in sorted(nu.__all__)}
    for name in SESSION:
        found[f"Session.{name}"] = signature(nu.Session, name)
    for owner in (nu.Oracle, nu.TransferFunction, nu.View):
        for name in public_attributes(owner):
            found[f"{owner.__name__}.{name}"] = signature(owner, name)
        for name in inspect.signature(owner).parameters:
            found.setdefault(f"{owner.__name__}.{name}", "field")
    return found


def command_line() -> dict[str, str]:
    """Return the options of every command of `napari-unpack`, as its help lists them."""
    text = _help()
    names = text[text.index("Commands") :].splitlines()
    commands = [match[1] for match in map(COMMAND.match, names) if match]
    found = {"napari-unpack": " ".join(sorted(commands))}
    for command in commands:
        rows = filter(None, map(OPTIONS.match, _help(command).splitlines()))
        options = {option for row in rows for option in re.split(r"[ ,]+", row[1].strip())}
        found[f"napari-unpack {command}"] = " ".join(sorted(options))
    return found


def _help(*command: str) -> str:
    plain = {**os.environ, "TERM": "dumb", "NO_COLOR": "1", "COLUMNS": "200"}
    return subprocess.run(
        [sys.executable, "-c", ENTRY, *command, "--help"],
        env=plain,
        check=True,
        capture_output=True,
        text=True,
    ).stdout
