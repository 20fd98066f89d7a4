"""Compute shaders, from OpenGL 4.3 on: a program that is run for every pixel and draws nothing.

gloo knows vertex, geometry and fragment shaders only, so that plain GL sets the uniforms here.
"""

from __future__ import annotations

import weakref
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from vispy import gloo

from napari_unpack.rendering.gl.framebuffer import (
    PixelWindow,
    current_context,
    handle_of,
    namespace,
    renderer,
)
from napari_unpack.rendering.gl.offscreen import is_software_renderer
from napari_unpack.rendering.gl.programs import ShaderError, ShaderSource, load

# OpenGL with compute shaders, storage buffers and their atomics.
NEEDED = (4, 3)
VERSION = "430 compatibility"
# Sides of a square of invocations, as in shaders/lib/invocation.glsl.
SIDE = 8


class ComputeProgram:
    """A compute shader of the current context.

    Parameters
    ----------
    source : ShaderSource
        With lib/invocation.glsl.

    Attributes
    ----------
    handle : int
        GL's own name of it.

    Raises
    ------
    ShaderError
        If the driver refuses, with its log.
    """

    def __init__(self, source: ShaderSource) -> None:
        from OpenGL import GL

        context = current_context()
        context.flush_commands()
        shader = GL.glCreateShader(GL.GL_COMPUTE_SHADER)
        GL.glShaderSource(shader, source.code)
        GL.glCompileShader(shader)
        if not GL.glGetShaderiv(shader, GL.GL_COMPILE_STATUS):
            log = GL.glGetShaderInfoLog(shader)
            GL.glDeleteShader(shader)
            raise _refused(source, log)
        self.handle = int(GL.glCreateProgram())
        # As gloo's own: once nobody holds it, and in its context.
        weakref.finalize(self, _delete, weakref.ref(context.glir), self.handle).atexit = False
        GL.glAttachShader(self.handle, shader)
        GL.glLinkProgram(self.handle)
        GL.glDeleteShader(shader)
        if not GL.glGetProgramiv(self.handle, GL.GL_LINK_STATUS):
            raise _refused(source, GL.glGetProgramInfoLog(self.handle))
        self._setters = {
            1: GL.glProgramUniform1fv,
            2: GL.glProgramUniform2fv,
            3: GL.glProgramUniform3fv,
            4: GL.glProgramUniform4fv,
        }
        self._places: dict[str, int] = {}
        self._textures: dict[str, Any] = {}

    def __contains__(self, name: str) -> bool:
        """Whether the shader makes use of a uniform."""
        return self._place(name) >= 0

    def __setitem__(self, name: str, value: Any) -> None:
        """Set a uniform: a number, two to four of them, or a texture."""
        if isinstance(value, (gloo.Texture2D, gloo.Texture3D)):
            self._textures[name] = value
            return
        numbers = np.ravel(value).astype(np.float32)
        self._setters[numbers.size](self.handle, self._place(name), 1, numbers)

    def run(self, window: PixelWindow, images: Sequence[gloo.Texture2D] = ()) -> None:
        """Run it for every pixel.

        Parameters
        ----------
        window : (int, int, int, int)
            First column, first row, width and height of the pixels.
        images : sequence of vispy.gloo.Texture2D
            Float textures that it writes.
        """
        from OpenGL import GL

        context = current_context()
        for texture in (*self._textures.values(), *images):
            context.glir.associate(texture.glir)
        context.flush_commands()
        for unit, (name, texture) in enumerate(self._textures.items()):
            solid = isinstance(texture, gloo.Texture3D)
            GL.glActiveTexture(GL.GL_TEXTURE0 + unit)
            GL.glBindTexture(GL.GL_TEXTURE_3D if solid else GL.GL_TEXTURE_2D, handle_of(texture))
            GL.glProgramUniform1i(self.handle, self._place(name), unit)
        GL.glActiveTexture(GL.GL_TEXTURE0)
        for unit, image in enumerate(images):
            kind = GL.GL_RGBA32F if image.internalformat == "rgba32f" else GL.GL_R32F
            GL.glBindImageTexture(unit, handle_of(image), 0, False, 0, GL.GL_WRITE_ONLY, kind)
        if "u_window" in self:
            self["u_window"] = window
        GL.glUseProgram(self.handle)
        GL.glDispatchCompute(-(-window[2] // SIDE), -(-window[3] // SIDE), 1)
        # What it wrote is to be seen by whatever reads next: a pass, a read back, another canvas.
        GL.glMemoryBarrier(GL.GL_ALL_BARRIER_BITS)
        # gloo, which sets its program only where it is another, must set it again.
        GL.glUseProgram(0)
        namespace().env["current_program"] = False

    def _place(self, name: str) -> int:
        from OpenGL import GL

        if name not in self._places:
            self._places[name] = int(GL.glGetUniformLocation(self.handle, name))
        return self._places[name]


def computed(shader: str, defines: Mapping[str, object] | None = None) -> ComputeProgram:
    """Compile a compute shader in the current context.

    Parameters
    ----------
    shader : str
        A file under shaders/passes/.
    defines : mapping, optional
        Macros.

    Raises
    ------
    ShaderError
        With the driver's log, its line numbers turned into our files and lines.
    """
    return ComputeProgram(load(f"passes/{shader}", {**(defines or {}), "COMPUTE": 1}, VERSION))


def supported() -> bool:
    """Whether the current context has compute shaders."""
    from OpenGL import GL

    current_context().flush_commands()
    text = GL.glGetString(GL.GL_VERSION)
    words = (text.decode() if isinstance(text, bytes) else str(text)).split(" ")[0].split(".")
    version = tuple(int(word) for word in words[:2] if word.isdigit())
    return len(version) == 2 and version >= NEEDED


def preferred() -> bool:
    """Whether compute shaders are there, and the card's: cards made for computing need them.

    Those run fragment shaders on a few of their processors only (docs/benchmarks.md); a software
    rasteriser gains nothing.
    """
    return supported() and not is_software_renderer(renderer())


def _delete(queue: weakref.ref[Any], handle: int) -> None:
    """Have a program deleted when its context, whose queue this is, is next drawn in."""
    commands = queue()
    if commands is not None:
        commands.command("FUNC", "glDeleteProgram", handle)


def _refused(source: ShaderSource, log: bytes | str) -> ShaderError:
    said = log.decode(errors="replace") if isinstance(log, bytes) else str(log)
    return ShaderError(f"{source.files[0]}: {source.explain(said)}")
