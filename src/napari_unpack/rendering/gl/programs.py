"""Shader programs: GLSL files with their includes, compiled once, errors named by file and line.

`#include "lib/x.glsl"` inserts a file once, where it is first asked for.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import resources
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from vispy import gloo

from napari_unpack.rendering.gl.framebuffer import current_context, namespace

INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"\s*$')
# Line n of the i-th file is numbered i * STRIDE + n: drivers and vispy keep numbers, not names.
STRIDE = 100_000

Made = TypeVar("Made")


@dataclass(frozen=True)
class ShaderSource:
    """A whole shader: GLSL without includes, and the files it came from, by number.

    Parameters
    ----------
    code : str
        All files joined.
    files : sequence of str
        Their paths, by the numbers that `#line` gives them.
    """

    code: str
    files: tuple[str, ...]

    def explain(self, log: str) -> str:
        """Return a driver's log with our file names and lines in place of its numbers."""

        def named(match: re.Match[str]) -> str:
            file, line = divmod(int(match.group()), STRIDE)
            return f"{self.files[file - 1]}:{line}" if file <= len(self.files) else match.group()

        return re.sub(rf"\b[1-9]\d{{{len(str(STRIDE)) - 1},}}\b", named, log)


def read(path: str) -> str:
    """Return the text of one file under shaders/; raise `FileNotFoundError` if it is missing."""
    return resources.files("napari_unpack.shaders").joinpath(path).read_text(encoding="utf-8")


def load(
    path: str,
    defines: Mapping[str, object] | None = None,
    version: str | None = None,
    read: Callable[[str], str] = read,
) -> ShaderSource:
    """Join a shader under shaders/ with what it includes, version and macros first.

    Parameters
    ----------
    path : str
        Below `shaders/`.
    defines : mapping of str to object, optional
        `#define`s put before the code.
    version : str, optional
        Of GLSL, as `#version` takes it.
    read : callable
        Given a path, returns the file's text.

    Raises
    ------
    ValueError
        If files include each other in a circle.
    """
    files: list[str] = [path]
    # GLSL 1.20, section 3.3: the line after `#line n` is n + 1; from 3.30 on it is n.
    first = 1 if version is not None and int(version.split()[0]) >= 330 else 0

    def expand(name: str, above: tuple[str, ...]) -> list[str]:
        base = (files.index(name) + 1) * STRIDE + first
        lines = [f"#line {base}"]
        for number, line in enumerate(read(name).splitlines(), start=1):
            match = INCLUDE.match(line)
            if match is None:
                lines.append(line)
                continue
            wanted = match.group(1)
            if wanted in (*above, name):
                circle = " -> ".join([*above, name, wanted])
                raise ValueError(f"shader files include each other in a circle: {circle}")
            # Once, where it is first asked for: GLSL has no include guards.
            if wanted not in files:
                files.append(wanted)
                lines += expand(wanted, (*above, name))
            lines.append(f"#line {base + number}")
        return lines

    head = [f"#version {version}"] if version else []
    head += [f"#define {key} {value}" for key, value in (defines or {}).items()]
    return ShaderSource("\n".join([*head, *expand(path, ())]) + "\n", tuple(files))


class ShaderError(RuntimeError):
    """A shader that this machine's driver does not accept."""


class Programs:
    """Passes compiled once a GL context, for all that draw there."""

    def __init__(self) -> None:
        self._made: WeakKeyDictionary[Any, dict[object, Any]] = WeakKeyDictionary()

    def kept(self, key: object, make: Callable[[], Made]) -> Made:
        """Return what was made for a key in the current context, made now or earlier.

        Parameters
        ----------
        key : hashable
        make : callable
            Compiles it.
        """
        made = self._made.setdefault(namespace(), {})
        if key not in made:
            made[key] = make()
        found: Made = made[key]
        return found


def compiled(
    fragment: str,
    defines: Mapping[str, object] | None = None,
    vertex: str = "fullscreen.vert",
) -> gloo.Program:
    """Compile and link one pass in the current context.

    Parameters
    ----------
    fragment, vertex : str
        Files under shaders/passes/.
    defines : mapping, optional
        Macros for both.

    Returns
    -------
    vispy.gloo.Program
        With a full-screen triangle strip bound where it takes `a_position`.

    Raises
    ------
    ShaderError
        With the driver's log, its line numbers turned into our files and lines.
    RuntimeError
        If no canvas is current.
    """
    vert, frag = (load(f"passes/{name}", defines) for name in (vertex, fragment))
    program = linked(vert, frag)
    if "a_position" in program:
        corners = [[-1, -1], [-1, 1], [1, -1], [1, 1]]
        program["a_position"] = gloo.VertexBuffer(np.array(corners, dtype=np.float32))
    return program


def linked(vertex: ShaderSource, fragment: ShaderSource) -> gloo.Program:
    """Compile and link two sources in the current context; see `compiled`.

    Parameters
    ----------
    vertex, fragment : ShaderSource

    Raises
    ------
    ShaderError
        If the driver refuses, with its log.
    """
    context = current_context()
    context.flush_commands()
    program = gloo.Program(vertex.code, fragment.code)
    # Compiled now, so that a wrong shader is reported here and not at the first draw.
    context.glir.associate(program.glir)
    try:
        context.flush_commands()
    except RuntimeError as error:
        log = str(error)
        source = vertex if "VERTEX" in log.split(":", 1)[0] else fragment
        raise ShaderError(f"{source.files[0]}: {source.explain(log)}") from error
    return program
