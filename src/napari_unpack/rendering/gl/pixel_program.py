"""A pass over the pixels of a target: one GLSL source, a fragment or a compute shader."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext, suppress

from vispy import gloo

from napari_unpack.rendering.gl import compute_program
from napari_unpack.rendering.gl.compute_program import ComputeProgram, computed
from napari_unpack.rendering.gl.framebuffer import PixelWindow, Target
from napari_unpack.rendering.gl.programs import Programs, ShaderError, compiled
from napari_unpack.rendering.gl.uniforms import Uniforms, assign
from napari_unpack.rendering.gl.voxel_buffer import VoxelBuffer


class FragmentProgram:
    """A pixel program that is drawn, as every driver can.

    Parameters
    ----------
    program : vispy.gloo.Program
        A fragment shader over the whole frame buffer.
    """

    def __init__(self, program: gloo.Program) -> None:
        self._program = program

    def run(self, target: Target, uniforms: Uniforms, window: PixelWindow | None = None) -> None:
        """Compute the pixels of a window, by default all.

        Parameters
        ----------
        target : Target
            The others stay as it holds them.
        uniforms : mapping of str to value
            What the shader has no use for is left out.
        window : (int, int, int, int), optional
            First column, first row, width and height.
        """
        held = uniforms.get("u_voxels")
        voxels = held.bound(self._program) if isinstance(held, VoxelBuffer) else nullcontext()
        assign(self._program, {k: v for k, v in uniforms.items() if v is not held})
        with voxels, target.drawing():
            if window is not None:
                gloo.set_state(scissor_test=True)
                gloo.set_scissor(*window)
            self._program.draw("triangle_strip")


class ComputedPixels:
    """A pixel program that draws nothing, for all the processors of a card.

    Parameters
    ----------
    program : ComputeProgram
    """

    def __init__(self, program: ComputeProgram) -> None:
        self._program = program

    def run(self, target: Target, uniforms: Uniforms, window: PixelWindow | None = None) -> None:
        """Compute the pixels of a window, by default all.

        Parameters
        ----------
        target, uniforms, window
            As `FragmentProgram` takes them.
        """
        assign(self._program, uniforms)
        height, width = target.size
        self._program.run(window or (0, 0, width, height), target.textures)


# Computes every pixel of a target by itself.
PixelProgram = FragmentProgram | ComputedPixels


def pixel_program(
    programs: Programs, shader: str, defines: Mapping[str, object] | None = None
) -> PixelProgram:
    """Return a pass of the current context, compiled now or earlier.

    Parameters
    ----------
    programs : Programs
        Where it is kept.
    shader : str
        A file under shaders/passes/ with lib/pixel.glsl.
    defines : mapping of str to object, optional

    Raises
    ------
    ShaderError
        If the driver refuses it.
    """
    key = shader, *sorted((defines or {}).items())
    # Software reads a buffer of voxels, which compute shaders here do not.
    wanted = compute_program.preferred() and "VOXELS" not in (defines or {})

    def made() -> PixelProgram:
        if wanted:
            # Drivers that say they have compute shaders may still refuse this one.
            with suppress(ShaderError):
                return ComputedPixels(computed(shader, defines))
        return FragmentProgram(compiled(shader, defines))

    return programs.kept((wanted, *key), made)
