"""Uniforms that all ray-casting passes share: rays, textures, clipping and empty space."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from vispy import gloo

from napari_unpack.geometry.axes import flip
from napari_unpack.geometry.rays import Rays
from napari_unpack.rendering.gl.compute_program import ComputeProgram
from napari_unpack.rendering.gl.textures import VolumeTextures
from napari_unpack.rendering.validation import MOST_PLANES, checked_planes

Uniforms = dict[str, Any]


def ray_uniforms(rays: Rays, textures: VolumeTextures) -> Uniforms:
    """Return the uniforms of lib/ray.glsl, lib/ray_box.glsl and lib/label_lookup.glsl.

    Parameters
    ----------
    rays : Rays
    textures : VolumeTextures
    """
    names = ("origin", "origin_row", "origin_col", "direction", "direction_row", "direction_col")
    uniforms: Uniforms = {
        f"u_{name}": row for name, row in zip(names, flip(rays.table), strict=True)
    }
    return uniforms | {
        "u_step": rays.step,
        # Not every driver knows infinity.
        "u_near": max(rays.near, -1e30),
        "u_shape": flip(textures.shape),
        # Reciprocals, since no compiler turns divisions by uniforms into products.
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
        As `checked_planes`.
    """
    planes = checked_planes(clipping)
    rows = np.zeros((MOST_PLANES, 4))
    rows[: len(planes), :3] = flip(planes[:, 1])
    rows[: len(planes), 3] = -(planes[:, 0] * planes[:, 1]).sum(axis=1)
    # One by one: vispy sends all of a uniform array the first time only.
    uniforms: Uniforms = {f"u_planes[{i}]": row for i, row in enumerate(rows)}
    return uniforms | {"u_plane_count": float(len(planes))}


# Share of bricks that may have become empty before distances are worked out anew.
STALE = 1 / 8


class Leaps:
    """The distance from every brick to the nearest of the other kind, as a texture.

    Attributes
    ----------
    uploads : int
        How often it was sent.

    Notes
    -----
    What is leapt over must be empty; what is not may be empty too, and costs time alone. So an
    object that is hidden sends nothing: in 512 x 512 x 1024 voxels the distances take 17 ms to
    work out, 0.05 ms to send. They follow once an eighth of the bricks has become empty.
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
        if not self._serves(occupied):
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

    def _serves(self, occupied: NDArray[np.bool_]) -> bool:
        """Return whether what is held leaps over nothing that is occupied now, and is fresh."""
        held = self._held
        if held is None or held.shape != occupied.shape or (occupied > held).any():
            return False
        return bool(np.count_nonzero(held > occupied) <= STALE * np.count_nonzero(held))


def brick_distances(occupied: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return how many bricks away the nearest of the other kind is, at least, (Bz, By, Bx) uint8.

    128 + the chessboard distance to the next occupied brick in empty ones, 128 - that to the next
    empty one in occupied ones; at most 127 either way, which is also said where there is none.
    Outside the box of all that is occupied it is the distance to that box.
    """
    far = 127
    signed = np.full(occupied.shape, far, np.int16)
    if not occupied.any():
        return (128 + signed).astype(np.uint8)
    box, to_box = [], np.zeros((1, 1, 1), np.int64)
    for axis, n in enumerate(occupied.shape):
        filled = np.flatnonzero(occupied.any(axis=tuple({0, 1, 2} - {axis})))
        first, last = int(filled[0]), int(filled[-1])
        # A layer of empty bricks more, where there is one, for the distance to the empty.
        box.append(slice(max(first - 1, 0), min(last + 2, n)))
        away = np.maximum(first - np.arange(n), np.arange(n) - last)
        shape = [1, 1, 1]
        shape[axis] = n
        to_box = np.maximum(to_box, away.reshape(shape))
    np.clip(to_box, 1, far, out=signed, casting="unsafe")
    signed[tuple(box)] = _exact_distances(occupied[tuple(box)], far)
    return (128 + signed).astype(np.uint8)


def _exact_distances(occupied: NDArray[np.bool_], far: int) -> NDArray[np.int16]:
    from scipy.ndimage import distance_transform_cdt

    signed = np.empty(occupied.shape, np.int16)
    for kind, sign in ((~occupied, 1), (occupied, -1)):
        # The transform of an array without zeros is not defined.
        distance = far if kind.all() else distance_transform_cdt(kind, metric="chessboard")[kind]
        signed[kind] = sign * np.minimum(distance, far)
    return signed


def assign(program: gloo.Program | ComputeProgram, uniforms: Uniforms) -> None:
    """Set the uniforms that a program has, and leave the others.

    Parameters
    ----------
    program : Program or ComputeProgram
    uniforms : mapping of str to value
    """
    for name, value in uniforms.items():
        if name in program:
            program[name] = value
