"""Occlusion counts in one pass with atomic counters, in a compute shader.

The paper's second method, extended: the same walk also tells who blocks whom.
"""

from __future__ import annotations

from ctypes import c_void_p
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.occlusion_counts import OcclusionCounts
from napari_unpack.geometry.rays import Rays
from napari_unpack.rendering.gl.compute_program import ComputeProgram, computed
from napari_unpack.rendering.gl.textures import VolumeTextures
from napari_unpack.rendering.gl.uniforms import Leaps, assign, plane_uniforms, ray_uniforms


class RayTooCrowdedError(RuntimeError):
    """A ray met more objects than the shader remembers."""


class OcclusionAtomics:
    """The one-pass counters of one GL context."""

    def __init__(self) -> None:
        self.leaps = Leaps()
        self._program: ComputeProgram | None = None

    def count(
        self,
        textures: VolumeTextures,
        rays: Rays,
        visible: NDArray[np.bool_],
        occupied: NDArray[np.bool_] | None = None,
    ) -> OcclusionCounts:
        """Count how much of every object is hidden by others.

        Parameters
        ----------
        textures, rays, visible, occupied
            As in `ObjectIdPass.draw`; at most 4096 visible objects, whose
            pairs are numbered by 32-bit integers.

        Raises
        ------
        RayTooCrowdedError
            If a ray met more than 96 objects: use another way.

        Notes
        -----
        Li et al. 2012, section 5.1, `countOccludedSamples`. The paper skips a ray's first object
        and counts eq. 2's numerator alone; here every counter of `OcclusionCounts` is kept, and
        a bit a pair says who lies in front of whom.
        """
        from OpenGL import GL

        if self._program is None:
            self._program = computed("count_occluded.comp")
        candidates = np.flatnonzero(visible)
        n = len(candidates)
        slots = np.full(len(visible), -1, np.int32)
        slots[candidates] = np.arange(n)
        assign(
            self._program,
            ray_uniforms(rays, textures)
            | plane_uniforms(None)
            | self.leaps.uniforms(occupied)
            | {"u_objects": float(n)},
        )
        # As bound in shaders/passes/count_occluded.comp; the last counter tells of overflow.
        buffers = [
            new_buffer(0, slots),
            new_buffer(1, np.zeros(5 * n + 1, np.uint32)),
            new_buffer(2, np.zeros(n * n // 32 + 1, np.uint32)),
        ]
        try:
            self._program.run((0, 0, rays.size[1], rays.size[0]))
            counters = read_buffer(buffers[1], 5 * n + 1)
            words = read_buffer(buffers[2], n * n // 32 + 1)
        finally:
            GL.glDeleteBuffers(len(buffers), buffers)
        if counters[-1]:
            raise RayTooCrowdedError("a ray meets more objects than the shader remembers")
        return _counts(counters[:-1].reshape(5, n), words, candidates, len(visible))


def _counts(
    counters: NDArray[np.uint32],
    words: NDArray[np.uint32],
    candidates: NDArray[np.int64],
    size: int,
) -> OcclusionCounts:
    rows = np.zeros((5, size), np.int64)
    rows[:, candidates] = counters
    n = len(candidates)
    # One bit a pair, 32 to a word, lowest first, as the shader sets them.
    bits = np.unpackbits(words.view(np.uint8), bitorder="little")[: n * n]
    met = counters[0] > 0
    blocks = bits.reshape(n, n).astype(np.bool_)[np.ix_(met, met)]
    return OcclusionCounts(candidates[met], rows[0], rows[1], rows[2], rows[3], rows[4], blocks)


def new_buffer(binding: int, values: NDArray[Any]) -> int:
    """Make a shader storage buffer of an array and bind it; return its name.

    Parameters
    ----------
    binding : int
        Of the shader's storage block.
    values : ndarray
        What it holds at first.
    """
    from OpenGL import GL

    name = int(GL.glGenBuffers(1))
    GL.glBindBuffer(GL.GL_SHADER_STORAGE_BUFFER, name)
    GL.glBufferData(GL.GL_SHADER_STORAGE_BUFFER, values.nbytes, values, GL.GL_DYNAMIC_READ)
    GL.glBindBufferBase(GL.GL_SHADER_STORAGE_BUFFER, binding, name)
    return name


def read_buffer(name: int, length: int) -> NDArray[np.uint32]:
    """Return so many words of a shader storage buffer.

    Parameters
    ----------
    name : int
        From `new_buffer`.
    length : int
        Words to read.
    """
    from OpenGL import GL

    # PyOpenGL's own wrapper writes past a numpy array given to it.
    from OpenGL.raw.GL.VERSION.GL_1_5 import glGetBufferSubData

    out = np.empty(length, np.uint32)
    GL.glBindBuffer(GL.GL_SHADER_STORAGE_BUFFER, name)
    glGetBufferSubData(GL.GL_SHADER_STORAGE_BUFFER, 0, out.nbytes, out.ctypes.data_as(c_void_p))
    GL.glBindBuffer(GL.GL_SHADER_STORAGE_BUFFER, 0)
    return out
