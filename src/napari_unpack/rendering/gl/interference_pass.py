"""Interference of the objects in a view by scatter into a table, in a compute shader."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from napari_unpack.rendering.gl.compute_program import ComputeProgram, computed
from napari_unpack.rendering.gl.occlusion_atomics import (
    RayTooCrowdedError,
    new_buffer,
    read_buffer,
)
from napari_unpack.rendering.gl.uniforms import assign

# Objects of an image; with more of them the tables outgrow what a driver likes to give.
MOST_OBJECTS = 4096


class InterferencePass:
    """Equation 1 of one GL context; see `gl.backend.interference`."""

    def __init__(self) -> None:
        self.passes = 0
        self._program: ComputeProgram | None = None

    def pairs(
        self, stack: NDArray[np.integer], half_widths: NDArray[np.integer]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Find the pairs that interfere.

        Parameters
        ----------
        stack : (L, H, W) ndarray of int
            Object-ID layers, 0 is nothing; any IDs, at most 4096 of them.
        half_widths : (2 R + 1,) ndarray of int
            Of the rows of a disk of radius DT, pixels.

        Returns
        -------
        ids : (N,) ndarray of int64
            Present, ascending.
        pairs : (P, 2) ndarray of int64
            IDs, the smaller first.
        lengths : (P,) ndarray of int64
            Contact lengths, pixels, at least 1.

        Raises
        ------
        RayTooCrowdedError
            If a pixel came near more than 64 objects: use the CPU.
        ValueError
            If there are more than 4096 objects.

        Notes
        -----
        Li et al. 2012, section 4.2. Costs pixels of borders times the disk.
        """
        from OpenGL import GL

        ids, slots = np.unique(np.append(stack.ravel(), stack.dtype.type(0)), return_inverse=True)
        n = len(ids)
        if n > MOST_OBJECTS + 1:
            raise ValueError(f"stack must hold at most {MOST_OBJECTS} objects, got {n - 1}")
        if self._program is None:
            self._program = computed("interfering.comp")
        layers, height, width = stack.shape
        values = {
            "u_layers": layers,
            "u_height": height,
            "u_width": width,
            "u_reach": len(half_widths) // 2,
            "u_objects": n,
        }
        assign(self._program, {name: float(value) for name, value in values.items()})
        words = n * n // 32 + 2
        buffers = [
            new_buffer(0, np.ascontiguousarray(slots[:-1], dtype=np.uint32)),
            new_buffer(1, np.ascontiguousarray(half_widths, dtype=np.int32)),
            new_buffer(2, np.zeros(words, np.uint32)),
            new_buffer(3, np.zeros(n * n, np.uint32)),
        ]
        try:
            self._program.run((0, 0, width, height))
            self.passes += 1
            table = read_buffer(buffers[2], words)
            lengths = read_buffer(buffers[3], n * n)
        finally:
            GL.glDeleteBuffers(len(buffers), buffers)
        if table[-1]:
            raise RayTooCrowdedError("a pixel comes near more objects than the shader remembers")
        bits = np.unpackbits(table.view(np.uint8), bitorder="little")[: n * n]
        places = np.flatnonzero(bits)
        ends = np.stack([ids[places // n], ids[places % n]], axis=1).astype(np.int64)
        return ids[1:].astype(np.int64), ends, np.maximum(lengths[places], 1).astype(np.int64)
