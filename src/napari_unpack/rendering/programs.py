"""Compiles our shaders at once, and says where they are wrong in our own files and lines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from vispy import gloo

from napari_unpack.rendering.framebuffer import current_context, namespace
from napari_unpack.rendering.ledger import TABLES, ledger
from napari_unpack.rendering.shader_source import ShaderSource, load


class ShaderError(RuntimeError):
    """A shader that this machine's driver does not accept."""


class Programs:
    """Passes compiled once a GL context, for all that draw there."""

    def __init__(self) -> None:
        self._made: WeakKeyDictionary[Any, dict[object, gloo.Program]] = WeakKeyDictionary()

    def here(
        self,
        fragment: str,
        defines: Mapping[str, object] | None = None,
        vertex: str = "fullscreen.vert",
    ) -> gloo.Program:
        """Return the program of the current context; see `compiled`."""
        made = self._made.setdefault(namespace(), {})
        key = fragment, vertex, *sorted((defines or {}).items())
        if key not in made:
            made[key] = compiled(fragment, defines, vertex)
        return made[key]


def compiled(
    fragment: str,
    defines: Mapping[str, object] | None = None,
    vertex: str = "fullscreen.vert",
    version: str | None = None,
) -> gloo.Program:
    """Compile and link one pass in the current context.

    Parameters
    ----------
    fragment, vertex : str
        Files under shaders/passes/.
    defines : mapping, optional
        Macros for both.
    version : str, optional
        GLSL's, for both; by default 1.20.

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
    vert, frag = (load(f"passes/{name}", defines, version) for name in (vertex, fragment))
    program = linked(vert, frag)
    if "a_position" in program:
        corners = [[-1, -1], [-1, 1], [1, -1], [1, 1]]
        buffer = gloo.VertexBuffer(np.array(corners, dtype=np.float32))
        program["a_position"] = ledger().enter(TABLES, buffer)
    return program


def linked(vertex: ShaderSource, fragment: ShaderSource) -> gloo.Program:
    """Compile and link two sources in the current context; see `compiled`."""
    context = current_context()
    context.flush_commands()
    program = gloo.Program(vertex.code, fragment.code)
    context.glir.associate(program.glir)
    try:
        context.flush_commands()
    except RuntimeError as error:
        log = str(error)
        source = vertex if "VERTEX" in log.split(":", 1)[0] else fragment
        raise ShaderError(f"{source.files[0]}: {source.explain(log)}") from error
    return program
