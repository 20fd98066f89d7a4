"""The two volumes on the GPU, uploaded once a context and shared by everything that casts rays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from vispy import gloo

from napari_unpack.rendering.framebuffer import current_context

Density = NDArray[np.uint16] | NDArray[np.float32]
Factor = tuple[int, int, int]

FORMATS = {"uint8": ("r8", 255.0), "uint16": ("r16", 65535.0), "float32": ("r32f", 1.0)}
"""Texture format of each density type, and the density that a texel of 1.0 means."""


class VolumeTextures:
    """Density and labels as 3D textures in the current context.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of uint16
        Object IDs.
    volume : (Z, Y, X) ndarray of uint16 or float32, optional
        Density; the ID passes need none.
    largest : int, optional
        Longest side of a texture; by default what the driver allows.

    Attributes
    ----------
    uploads : int
        Textures sent so far.
    factor : (int, int, int)
        Voxels a texel along z, y, x; 1 unless the volume was too large.
    notice : str or None
        A sentence for the user if the volume is drawn coarser than it is.

    Notes
    -----
    Labels take 1 byte a voxel up to ID 255 and 2 beyond, density its own type: 4 bytes a voxel
    for a CT. Both are on one grid. Coarser density is the mean of a block, a coarser label the
    one at its middle, so IDs stay IDs.
    """

    def __init__(
        self,
        labels: NDArray[np.uint16],
        volume: Density | None = None,
        largest: int | None = None,
    ) -> None:
        if labels.ndim != 3 or 0 in labels.shape:
            raise ValueError(f"labels must be a filled 3D array, got shape {labels.shape}")
        if volume is not None and volume.shape != labels.shape:
            raise ValueError(f"volume must be {labels.shape} like labels, got {volume.shape}")
        if volume is not None and volume.dtype.name not in FORMATS:
            raise TypeError(f"volume must be one of {', '.join(FORMATS)}, got {volume.dtype}")
        self.uploads = 0
        self.shape: tuple[int, ...] = labels.shape
        self.density: gloo.Texture3D | None = None
        self.density_scale = 1.0
        texel = (2 if labels.max() > 255 else 1) if volume is None else volume.itemsize
        self.factor = fitting_factor(labels.shape, largest or largest_side(), texel)
        self.grid = tuple(-(-n // f) for n, f in zip(labels.shape, self.factor, strict=True))
        self.set_labels(labels)
        if volume is not None:
            self._set_volume(volume)

    @property
    def notice(self) -> str | None:
        """What to tell the user, if anything."""
        if self.factor == (1, 1, 1):
            return None
        full, coarse = ("x".join(map(str, s)) for s in (self.shape, self.grid))
        return (
            f"The volume ({full}) is too large for this graphics driver; it is drawn at {coarse}."
        )

    @property
    def label_scale(self) -> float:
        """What a texel of 1.0 means, 255 or 65535."""
        return 255.0 if self.labels.internalformat == "r8" else 65535.0

    def set_labels(self, labels: NDArray[np.uint16]) -> None:
        """Upload other labels of the same shape, after a split or a merge."""
        if labels.shape != self.shape:
            raise ValueError(f"labels must be {self.shape} as before, got {labels.shape}")
        middles = [np.minimum(np.arange(0, n, f) + f // 2, n - 1) for n, f in self._axes()]
        coarse = labels if self.factor == (1, 1, 1) else labels[np.ix_(*middles)]
        small = coarse.max(initial=0) <= 255
        array = coarse.astype(np.uint8) if small else np.ascontiguousarray(coarse, np.uint16)
        self.labels = self._uploaded(array, "r8" if small else "r16", "nearest")

    def delete(self) -> None:
        """Free the textures."""
        self.labels.delete()
        if self.density is not None:
            self.density.delete()

    def _axes(self) -> list[tuple[int, int]]:
        return list(zip(self.shape, self.factor, strict=True))

    def _set_volume(self, volume: Density) -> None:
        coarse = np.ascontiguousarray(_block_mean(volume, self.factor))
        internal, self.density_scale = FORMATS[coarse.dtype.name]
        self.density = self._uploaded(coarse, internal, "linear")

    def _uploaded(
        self, array: NDArray[np.generic], internal: str, filtering: str
    ) -> gloo.Texture3D:
        texture = gloo.Texture3D(
            array.shape, format="red", internalformat=internal, interpolation=filtering
        )
        texture.set_data(array)
        context = current_context()
        context.glir.associate(texture.glir)
        # Sent now, so that the array need not live on in a queue.
        context.flush_commands()
        self.uploads += 1
        return texture


def largest_side() -> int:
    """Return the driver's longest side of a 3D texture."""
    from OpenGL import GL

    current_context().flush_commands()
    return int(GL.glGetIntegerv(GL.GL_MAX_3D_TEXTURE_SIZE))


def fitting_factor(shape: Sequence[int], largest: int, bytes_per_texel: int) -> Factor:
    """Return voxels a texel along each axis of the finest texture that this driver holds.

    Parameters
    ----------
    shape : (3,) sequence of int
        Voxels along z, y, x.
    largest : int
        Longest side allowed.
    bytes_per_texel : int
        1, 2 or 4.

    Returns
    -------
    (int, int, int)
        Each axis is coarsened as far as its own length demands; then, while the driver still
        says that there is no room, the longest axis of the texture is.
    """
    factor = [max(1, -(-n // largest)) for n in shape]
    while not _driver_holds(
        [-(-n // f) for n, f in zip(shape, factor, strict=True)], bytes_per_texel
    ):
        lengths = [n / f for n, f in zip(shape, factor, strict=True)]
        longest = lengths.index(max(lengths))
        if lengths[longest] <= 1:
            break
        factor[longest] += 1
    return factor[0], factor[1], factor[2]


def _driver_holds(grid: Sequence[int], bytes_per_texel: int) -> bool:
    from OpenGL import GL

    current_context().flush_commands()
    internal, kind = {
        1: (GL.GL_R8, GL.GL_UNSIGNED_BYTE),
        2: (GL.GL_R16, GL.GL_UNSIGNED_SHORT),
        4: (GL.GL_R32F, GL.GL_FLOAT),
    }[bytes_per_texel]
    depth, height, width = grid
    GL.glTexImage3D(
        GL.GL_PROXY_TEXTURE_3D, 0, internal, width, height, depth, 0, GL.GL_RED, kind, None
    )
    held = GL.glGetTexLevelParameteriv(GL.GL_PROXY_TEXTURE_3D, 0, GL.GL_TEXTURE_WIDTH)
    return int(np.asarray(held).ravel()[0]) == width


def _block_mean(volume: Density, factor: Factor) -> Density:
    if factor == (1, 1, 1):
        return volume
    padding = [(0, -n % f) for n, f in zip(volume.shape, factor, strict=True)]
    filled = np.pad(volume, padding, mode="edge")
    blocks = filled.reshape(
        [v for n, f in zip(filled.shape, factor, strict=True) for v in (n // f, f)]
    )
    mean = blocks.mean(axis=(1, 3, 5), dtype=np.float32)
    if volume.dtype == np.float32:
        return mean
    rounded: NDArray[np.uint16] = np.rint(mean).astype(volume.dtype)
    return rounded
