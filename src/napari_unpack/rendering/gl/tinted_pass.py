"""The tinted image, computed by shaders/passes/tinted_volume.glsl into a frame buffer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.axes import flip
from napari_unpack.geometry.rays import Rays
from napari_unpack.geometry.shading import UNLIT, Shading
from napari_unpack.rendering.gl.framebuffer import PixelWindow, Target, renderer
from napari_unpack.rendering.gl.lookup_tables import IdTable, TransferTable
from napari_unpack.rendering.gl.offscreen import is_software_renderer
from napari_unpack.rendering.gl.pixel_program import pixel_program
from napari_unpack.rendering.gl.programs import Programs
from napari_unpack.rendering.gl.textures import VolumeTextures
from napari_unpack.rendering.gl.uniforms import Leaps, plane_uniforms, ray_uniforms
from napari_unpack.rendering.gl.voxel_buffer import VoxelBuffer

# Samples that a software rasteriser takes before it asks for empty bricks again.
#
# Eight pixels go there in step, and wait where one goes on alone; on hardware they do not.
RUN = 6.0


@dataclass(frozen=True, eq=False)
class Appearance:
    """How a volume is to look.

    Parameters
    ----------
    spacing : (3,) array_like, mm z y x
    table : (K, 4) ndarray of float32
        Straight RGB and opacity per voxel over `domain`, K >= 2.
    domain : (float, float)
        Densities of the table's first and last row.
    tints : (M, 4) ndarray of float32
        By ID, multiplied on; alpha 0 hides.
    shading : Shading, optional
    """

    spacing: ArrayLike
    table: NDArray[np.float32]
    domain: tuple[float, float]
    tints: NDArray[np.float32]
    shading: Shading | None = None

    def __post_init__(self) -> None:
        if self.table.ndim != 2 or self.table.shape[1] != 4 or len(self.table) < 2:
            raise ValueError(f"table must be (K, 4) with K >= 2, got {self.table.shape}")
        if self.tints.ndim != 2 or self.tints.shape[1] != 4:
            raise ValueError(f"tints must be (M, 4), got {self.tints.shape}")


class TintedPass:
    """The tinted pass of one GL context: its program and small tables.

    Parameters
    ----------
    programs : Programs, optional
        Compiled shaders shared with other passes.

    Attributes
    ----------
    passes : int
        How often it has cast rays.
    """

    # Attachments it draws into: premultiplied RGBA, and t where alpha first reached 1/2.
    channels = (4, 1)

    def __init__(self, programs: Programs | None = None) -> None:
        self.passes = 0
        self._programs = programs or Programs()
        self.tints = IdTable()
        self._table = TransferTable()
        self.leaps = Leaps()
        self._run: float | None = None

    def draw(
        self,
        target: Target,
        textures: VolumeTextures,
        rays: Rays,
        look: Appearance,
        occupied: NDArray[np.bool_] | None = None,
        jitter: bool = False,
        clipping: ArrayLike | None = None,
        window: PixelWindow | None = None,
    ) -> None:
        """Cast one image.

        Parameters
        ----------
        target : Target
            Of the rays' size, with `channels`.
        textures : VolumeTextures
            With density.
        rays : Rays
            In voxels of the whole volume.
        look : Appearance
            Transfer function, tints, light.
        occupied : (Bz, By, Bx) ndarray of bool, optional
            Bricks of 8 voxels where something may be seen; saves time, changes nothing.
        jitter : bool
            Start each ray at a hash of its pixel.
        clipping : (N, 2, 3) array_like, optional
            Planes (point, normal), voxels.
        window : (int, int, int, int), optional
            First column, first row, width and height of the pixels to cast; the others stay as
            the target holds them.

        Raises
        ------
        ValueError
            If the textures hold no density, or the target is not of the rays' size.
        """
        if textures.density is None:
            raise ValueError("textures must hold a volume to draw a tinted picture")
        if target.size != rays.size:
            raise ValueError(f"target must be {rays.size} like the rays, got {target.size}")
        spacing = np.asarray(look.spacing, dtype=np.float64)
        light = look.shading or UNLIT
        low, high = look.domain
        per_unit = (len(look.table) - 1) / (high - low)
        scale = textures.density_scale
        floor = max(light.gradient_floor * (high - low), 1e-12)
        shaded = light.diffuse > 0 or light.specular > 0
        if self._run is None:
            self._run = RUN if is_software_renderer(renderer()) else 0.0
        density = textures.density
        buffered = isinstance(density, VoxelBuffer)
        defines = {name: 1 for name, on in (("SHADED", shaded), ("VOXELS", buffered)) if on}
        uniforms = (
            ray_uniforms(rays, textures)
            | plane_uniforms(clipping)
            | self.leaps.uniforms(occupied)
            | {"u_voxels" if buffered else "u_density": density}
            | {
                "u_tints": self.tints.update(look.tints),
                "u_tint_rows": float(self.tints.rows),
                "u_table": self._table.update(look.table),
                "u_table_size": float(len(look.table)),
                "u_entry": (scale * per_unit, -low * per_unit),
                "u_spacing": flip(spacing),
                "u_reference": float(spacing.min()),
                "u_light": (light.ambient, light.diffuse, light.specular, light.shininess),
                "u_steepness": scale / floor,
                "u_jitter": float(jitter),
                "u_run": self._run,
            }
        )
        pixel_program(self._programs, "tinted_volume.glsl", defines).run(target, uniforms, window)
        self.passes += 1
