"""Object-ID layers, computed by shaders/passes/object_id.glsl four at a time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.rays import Rays
from napari_unpack.rendering.gl.framebuffer import Target
from napari_unpack.rendering.gl.lookup_tables import IdTable
from napari_unpack.rendering.gl.pixel_program import pixel_program
from napari_unpack.rendering.gl.programs import Programs
from napari_unpack.rendering.gl.textures import VolumeTextures
from napari_unpack.rendering.gl.uniforms import Leaps, plane_uniforms, ray_uniforms

# One layer a channel of an RGBA target.
LAYERS_A_PASS = 4
# Each pass reads all earlier ones; 7 beside the labels and tables fit any driver's 16 samplers.
MOST_LAYERS = 32


class ObjectIdPass:
    """The ID pass of one GL context."""

    def __init__(self) -> None:
        self.visible = IdTable()
        self.leaps = Leaps()
        self._programs = Programs()

    def draw(
        self,
        targets: Sequence[Target],
        textures: VolumeTextures,
        rays: Rays,
        visible: NDArray[np.bool_],
        layers: int,
        occupied: NDArray[np.bool_] | None = None,
        clipping: ArrayLike | None = None,
    ) -> None:
        """List the distinct visible objects on every ray, nearest first.

        Parameters
        ----------
        targets : sequence of Target
            One for every four layers, RGBA, of the rays' size; layer 4 i + c goes to channel c
            of the i-th.
        textures : VolumeTextures
            Labels suffice.
        rays : Rays
            In voxels of the whole volume.
        visible : (M,) ndarray of bool
            By ID, M above every label; `visible[0]` False.
        layers : int
            1 to 32.
        occupied : (Bz, By, Bx) ndarray of bool, optional
            Bricks of 8 voxels with a visible object.
        clipping : (N, 2, 3) array_like, optional
            Planes (point, normal), voxels.

        Raises
        ------
        ValueError
            If there are more layers or clipping planes than the shader takes.
        """
        if not 1 <= layers <= MOST_LAYERS:
            raise ValueError(
                f"layers must be 1 to {MOST_LAYERS} with backend 'gl', got {layers}; "
                "use backend 'cpu' for more"
            )
        table = np.zeros((len(visible), 4), np.float32)
        table[:, 0] = visible
        shared = (
            ray_uniforms(rays, textures)
            | plane_uniforms(clipping)
            | self.leaps.uniforms(occupied)
            | {
                "u_visible": self.visible.update(table),
                "u_visible_rows": float(self.visible.rows),
                "u_size": (float(rays.size[1]), float(rays.size[0])),
            }
        )
        for i, first in enumerate(range(0, layers, LAYERS_A_PASS)):
            found = {f"u_found_{j}": targets[j].textures[0] for j in range(i)}
            wanted = {"u_wanted": float(min(LAYERS_A_PASS, layers - first))}
            program = pixel_program(self._programs, "object_id.glsl", {"FOUND": i})
            program.run(targets[i], shared | found | wanted)
