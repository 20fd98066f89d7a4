"""A volume as a buffer texture, read voxel by voxel: the fastest way on software rasterisers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray
from vispy import gloo

from napari_unpack.rendering.gl.framebuffer import current_context, handle_of, renderer
from napari_unpack.rendering.gl.offscreen import is_software_renderer

# Texture unit of the volume: vispy counts those of its own from 0, and every driver has 16.
UNIT = 15
# What lib/voxel_buffer.glsl is written in, beyond GLSL 1.20.
EXTENSIONS = ("GL_EXT_gpu_shader4", "GL_ARB_texture_buffer_object")


class VoxelBuffer:
    """Density in a buffer object, filled like a 3D texture.

    Parameters
    ----------
    shape : (3,) sequence of int
        Voxels along z, y, x.
    kind : str
        uint8, uint16 or float32.

    Notes
    -----
    The buffer is gloo's, so that it goes with its context; the texture that shaders read it
    through is unknown to gloo and lives only while it is drawn with.
    """

    def __init__(self, shape: Sequence[int], kind: str) -> None:
        self.shape, self.kind = tuple(shape), kind
        self.buffer = gloo.VertexBuffer(np.empty(0, kind))
        self.buffer.resize_bytes(int(np.prod(shape)) * np.dtype(kind).itemsize)

    @property
    def glir(self) -> Any:
        """The queue of commands that fill it."""
        return self.buffer.glir

    def set_data(self, part: NDArray[np.generic], offset: tuple[int, int, int]) -> None:
        """Take over whole planes, from the one on that `offset` (z, 0, 0) says.

        Parameters
        ----------
        part : (z, Y, X) ndarray
            Some planes.
        offset : (int, int, int)
            First voxel of the part, z y x.

        Raises
        ------
        ValueError
            If the part is not whole planes of the volume.
        """
        if part.shape[1:] != self.shape[1:]:
            raise ValueError(f"part must be of whole planes {self.shape[1:]}, got {part.shape}")
        first = offset[0] * self.shape[1] * self.shape[2]
        self.buffer.set_subdata(np.ascontiguousarray(part).ravel(), first)

    @contextmanager
    def bound(self, program: gloo.Program) -> Iterator[None]:
        """Have a program read it as `u_voxels` inside the `with`; to be flushed there."""
        from OpenGL import GL

        formats = {"uint8": GL.GL_R8, "uint16": GL.GL_R16, "float32": GL.GL_R32F}
        context = current_context()
        context.glir.associate(self.buffer.glir)
        context.flush_commands()
        name = GL.glGenTextures(1)
        GL.glActiveTexture(GL.GL_TEXTURE0 + UNIT)
        GL.glBindTexture(GL.GL_TEXTURE_BUFFER, name)
        GL.glTexBuffer(GL.GL_TEXTURE_BUFFER, formats[self.kind], handle_of(self.buffer))
        GL.glActiveTexture(GL.GL_TEXTURE0)
        # gloo's own assignment knows no such sampler.
        unit = np.array([UNIT], np.int32)
        program.glir.command("UNIFORM", program.id, "u_voxels", "int", unit)
        try:
            yield
        finally:
            GL.glDeleteTextures([name])

    def delete(self) -> None:
        """Free it."""
        self.buffer.delete()


def serves_best(shape: Sequence[int]) -> bool:
    """Whether the current context's driver is a software rasteriser that can read such a buffer."""
    from OpenGL import GL

    if not is_software_renderer(renderer()):
        return False
    said = GL.glGetString(GL.GL_EXTENSIONS)
    known = (said.decode() if isinstance(said, bytes) else str(said)).split()
    if not set(EXTENSIONS) <= set(known):
        return False
    return int(np.prod(shape)) <= int(GL.glGetIntegerv(GL.GL_MAX_TEXTURE_BUFFER_SIZE))
