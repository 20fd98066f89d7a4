"""What every ray-casting pass tells its shader about rays, textures and empty space."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from vispy import gloo

from napari_unpack.geometry.axes import flip
from napari_unpack.geometry.rays import Rays
from napari_unpack.rendering.textures import VolumeTextures

MAX_PLANES = 8
"""Clipping planes a shader takes; the twin of shaders/lib/clip_planes.glsl."""

Uniforms = dict[str, Any]


def ray_uniforms(rays: Rays, textures: VolumeTextures) -> Uniforms:
    """Return the uniforms of lib/ray.glsl, lib/ray_box.glsl and lib/label_lookup.glsl."""
    names = ("origin", "origin_row", "origin_col", "direction", "direction_row", "direction_col")
    uniforms: Uniforms = {
        f"u_{name}": row for name, row in zip(names, flip(rays.table), strict=True)
    }
    return uniforms | {
        "u_step": rays.step,
        "u_near": max(rays.near, -1e30),
        "u_shape": flip(textures.shape),
        "u_per_grid": 1.0 / np.asarray(flip(textures.grid), np.float64),
        "u_per_factor": 1.0 / np.asarray(flip(textures.factor), np.float64),
        "u_labels": textures.labels,
        "u_label_scale": textures.label_scale,
    }


def plane_uniforms(clipping: ArrayLike | None) -> Uniforms:
    """Return the uniforms of lib/clip_planes.glsl.

    Parameters
    ----------
    clipping : (N, 2, 3) array_like, optional
        Planes (point, normal), voxels z y x; what lies behind one is cut away. At most 8.

    Raises
    ------
    ValueError
        If the shape is another or there are more.
    """
    planes = np.zeros((0, 2, 3)) if clipping is None else np.asarray(clipping, dtype=np.float64)
    if planes.ndim != 3 or planes.shape[1:] != (2, 3) or len(planes) > MAX_PLANES:
        raise ValueError(
            f"clipping must be (N, 2, 3) with N up to {MAX_PLANES}: a point and a normal a "
            f"plane, got {planes.shape}"
        )
    rows = np.zeros((MAX_PLANES, 4))
    rows[: len(planes), :3] = flip(planes[:, 1])
    rows[: len(planes), 3] = -(planes[:, 0] * planes[:, 1]).sum(axis=1)
    # One by one: vispy sends all of a uniform array the first time only.
    uniforms: Uniforms = {f"u_planes[{i}]": row for i, row in enumerate(rows)}
    return uniforms | {"u_plane_count": float(len(planes))}


class Leaps:
    """The distance from every brick to the nearest of the other kind, as a texture.

    Attributes
    ----------
    uploads : int
        How often it was sent; unchanged occupancy is not sent again.
    """

    def __init__(self) -> None:
        self.uploads = 0
        self._texture: gloo.Texture3D | None = None
        self._held: NDArray[np.bool_] | None = None
        self._none = gloo.Texture3D(np.zeros((1, 1, 1), np.float32), internalformat="r32f")

    def uniforms(self, occupied: NDArray[np.bool_] | None) -> Uniforms:
        """Return the uniforms of lib/skip_empty.glsl; None skips nothing.

        Parameters
        ----------
        occupied : (Bz, By, Bx) ndarray of bool, optional
            Bricks of 8 voxels that may hold something to be seen.
        """
        if occupied is None:
            return {"u_leaps": self._none, "u_bricks": (1.0, 1.0, 1.0), "u_skip": 0.0}
        if self._held is None or not np.array_equal(self._held, occupied):
            distances = brick_distances(occupied)
            if self._texture is None or self._texture.shape[:3] != distances.shape:
                self._texture = gloo.Texture3D(
                    distances, format="red", internalformat="r8", interpolation="nearest"
                )
            else:
                self._texture.set_data(distances)
            self._held = occupied.copy()
            self.uploads += 1
        return {"u_leaps": self._texture, "u_bricks": flip(occupied.shape), "u_skip": 1.0}


def brick_distances(occupied: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return 128 + the chessboard distance to the next occupied brick, or 128 - to the next empty.

    At most 127 either way, which is also said where there is none.
    """
    from scipy.ndimage import distance_transform_cdt

    signed = np.empty(occupied.shape, np.int16)
    for kind, sign in ((~occupied, 1), (occupied, -1)):
        # The transform of an array without zeros is not defined.
        far = kind.all()
        distance = 127 if far else distance_transform_cdt(kind, metric="chessboard")[kind]
        signed[kind] = sign * np.minimum(distance, 127)
    return (128 + signed).astype(np.uint8)


def assign(program: gloo.Program, uniforms: Uniforms) -> None:
    """Set the uniforms that a program has, and leave the others."""
    for name, value in uniforms.items():
        if name in program:
            program[name] = value
