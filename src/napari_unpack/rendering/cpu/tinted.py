"""The tinted image: one pass of ray casting with a colour and an opacity an object.

Li et al. 2012, section 4.1: the density is interpolated, the label is not, and the tint of the
label's object multiplies what the master transfer function makes of the density.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.rays import Rays
from napari_unpack.geometry.shading import UNLIT, Shading
from napari_unpack.rendering.cpu.brick_cache import BrickCache
from napari_unpack.rendering.cpu.bricks import Bricks, Density, Strides
from napari_unpack.rendering.cpu.compositing import correction, march
from napari_unpack.rendering.cpu.ray_sampling import BRICK, band_of, clipping_planes, ray_numbers
from napari_unpack.rendering.cpu.thread_pool import over_bands

# Voxels along all rays that one thread casts alone.
FEW = 1 << 16


def tinted(
    volume: Density,
    labels: NDArray[np.uint16],
    rays: Rays,
    spacing: ArrayLike,
    table: NDArray[np.float32],
    domain: tuple[float, float],
    tints: NDArray[np.float32],
    shading: Shading | None,
    bricks: Bricks | None = None,
    jitter: bool = False,
    clipping: ArrayLike | None = None,
    threads: int | None = None,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Cast a tinted image.

    Parameters
    ----------
    volume : (Z, Y, X) ndarray of uint16 or float32
        Density, C-contiguous, without NaN.
    labels : (Z, Y, X) ndarray of uint16
        Object IDs, C-contiguous.
    rays : Rays
        Of the image, in voxels.
    spacing : (3,) array_like, mm z y x
    table : (K, 4) ndarray of float32
        Transfer function: straight RGB and opacity per voxel (per `min(spacing)` mm), looked up
        linearly over `domain` and clamped.
    domain : (float, float)
        Densities of the first and last row of the table.
    tints : (M, 4) ndarray of float32
        By ID, M above every label: RGB multiplies the colour, alpha the opacity.
    shading : Shading, optional
    bricks : Bricks, optional
        Of this volume and these labels; saves visiting what cannot be seen, changes nothing.
    jitter : bool
        Shift the samples of every ray by a fraction of a step of its own (`phase_of`), which
        trades banding for grain.
    clipping : (N, 2, 3) array_like, optional
        Planes (point, normal) in voxels; what lies behind one is cut away.
    threads : int, optional
        Workers, by default one a core.

    Returns
    -------
    image : (H, W, 4) ndarray of float32
        Premultiplied RGBA.
    depth : (H, W) ndarray of float32
        t in mm where alpha first reaches 0.5, +inf where it never does.

    Notes
    -----
    Opacity is corrected for the length of a step, 1 - (1 - a)^(length / min(spacing)), after
    the tint's alpha is multiplied on. A sample's colour is at most 1 in each channel, highlight
    included. A ray ends at alpha `compositing.OPAQUE`. The gradient is the central difference of
    the interpolated density one voxel to both sides, in density per `min(spacing)` mm of the
    bag; see `Shading` for the light.
    """
    numbers, step, near = ray_numbers(rays)
    image = np.zeros((*rays.size, 4), np.float32)
    depth = np.full(rays.size, np.inf, np.float32)
    full = np.ones([-(-n // BRICK) for n in labels.shape], np.bool_)
    if bricks is not None:
        full = bricks.occupied(table, domain, tints)
    strides = Strides.of(full.astype(np.int32), rays)
    look = _look(spacing, domain, len(table), shading)
    planes = clipping_planes(clipping)
    exponents, corrected = correction(rays, spacing)
    shine = (np.linspace(0, 1, 513) ** (shading or UNLIT).shininess).astype(np.float32)
    table = np.ascontiguousarray(table, np.float32)
    # Always a copy: numba compiles a kernel again for read-only arrays.
    tints = np.array(tints, np.float32, order="C")
    shown = tints[:, 3] > 0
    families = np.zeros(depth.size if len(corrected) else 0, np.int32)

    def work(blocks: BrickCache, first: int, last: int) -> None:
        march(
            volume, labels, numbers, step, near, jitter, planes, strides.grids, strides.slots,
            table, tints, shown, look, exponents, corrected, shine, first, last,
            blocks, families, image, depth,
        )  # fmt: skip

    def blocks() -> BrickCache:
        return BrickCache.of(volume, full, bricks)

    # Others take longer to start than a small object to cast.
    few = 1 if threads is None and depth.size * max(labels.shape) <= FEW else threads
    over_bands(rays.size[0], work, blocks, few, band=band_of(rays.size[0]))
    return image, depth


def _look(
    spacing: ArrayLike, domain: tuple[float, float], entries: int, shading: Shading | None
) -> NDArray[np.float32]:
    # What the kernel needs to know of the transfer function's domain and of the light.
    mm = np.asarray(spacing, dtype=np.float64)
    light = shading or UNLIT
    scale = (entries - 1) / (domain[1] - domain[0])
    floor = max(light.gradient_floor * (domain[1] - domain[0]), 1e-12)
    return np.array(
        [
            domain[0],
            scale,
            *mm,
            mm.min(),
            light.ambient,
            light.diffuse,
            light.specular,
            light.shininess,
            1.0 / floor,
            *(mm.min() / mm),
        ],
        np.float32,
    )
