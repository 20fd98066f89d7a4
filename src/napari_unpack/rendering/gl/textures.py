"""The two volumes on the GPU, uploaded once a context and shared by everything that casts rays."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from vispy import gloo

from napari_unpack.rendering.gl.framebuffer import current_context
from napari_unpack.rendering.gl.voxel_buffer import VoxelBuffer, serves_best

Density = NDArray[np.uint16] | NDArray[np.float32]
Factor = tuple[int, int, int]
Box = tuple[slice, slice, slice]
Held: TypeAlias = "gloo.Texture3D | VoxelBuffer"

# What is sent to the graphics card at one go, unless a single plane is more.
SLAB_BYTES = 8 * 2**20
# Texture format of each density type, and the density that a texel of 1.0 means.
FORMATS = {"uint8": ("r8", 255.0), "uint16": ("r16", 65535.0), "float32": ("r32f", 1.0)}


class VolumeTextures:
    """Density and labels as 3D textures in the current context; `send` fills them.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of uint16
    volume : (Z, Y, X) ndarray of uint16 or float32, optional
        Density; the ID passes need none.
    largest : int, optional
        Longest side of a texture; by default what the driver allows.
    most : int, optional
        The largest label, where it is known; it need not be looked for then.
    as_buffer : bool, optional
        Hold density as a buffer of voxels; by default where a software rasteriser draws, and
        the volume needs no coarser grid.

    Attributes
    ----------
    uploads : int
        Textures begun, and boxes of labels, so far.
    bytes_sent : int
        Of all texels so far.
    factor : (int, int, int)
        Voxels a texel along z, y, x; 1 unless the volume was too large.
    notice : str or None
        A sentence for the user if the volume is drawn coarser than it is.

    Raises
    ------
    ValueError
        If labels are not 3D or empty, or density has another shape.
    TypeError
        If density is neither uint16 nor float32.

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
        most: int | None = None,
        as_buffer: bool | None = None,
    ) -> None:
        if labels.ndim != 3 or 0 in labels.shape:
            raise ValueError(f"labels must be a filled 3D array, got shape {labels.shape}")
        if volume is not None and volume.shape != labels.shape:
            raise ValueError(f"volume must be {labels.shape} like labels, got {volume.shape}")
        if volume is not None and volume.dtype.name not in FORMATS:
            raise TypeError(f"volume must be one of {', '.join(FORMATS)}, got {volume.dtype}")
        self.uploads = self.bytes_sent = 0
        self.shape: tuple[int, ...] = labels.shape
        self.density: Held | None = None
        self.density_scale = 1.0
        most = int(labels.max()) if most is None else most
        texel = (2 if most > 255 else 1) if volume is None else volume.itemsize
        self.factor = fitting_factor(labels.shape, largest or largest_side(), texel)
        self.grid = tuple(-(-n // f) for n, f in zip(labels.shape, self.factor, strict=True))
        self._waiting: deque[tuple[Held, NDArray[np.generic], Box]] = deque()
        self._begin_labels(labels, most)
        if volume is not None:
            internal, self.density_scale = FORMATS[volume.dtype.name]
            if as_buffer is None:
                as_buffer = self.factor == (1, 1, 1) and serves_best(self.shape)
            if as_buffer:
                self.uploads += 1
                self.density = VoxelBuffer(self.shape, volume.dtype.name)
            else:
                self.density = self._begun(internal, "linear")
            self._queue(self.density, volume, self._everything())

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

    @property
    def complete(self) -> bool:
        """Whether all has been sent."""
        return not self._waiting

    def send(self, most_bytes: float = np.inf) -> bool:
        """Send what waits, at least one piece and no more than so many bytes; return `complete`.

        Piece by piece, as a large volume takes longer than a window may stand still.
        """
        end = self.bytes_sent + most_bytes
        while self._waiting:
            texture, source, box = self._waiting[0]
            part = self._texels(texture, source, box)
            if self.bytes_sent + part.nbytes > end and end - self.bytes_sent < most_bytes:
                break
            self._waiting.popleft()
            texture.set_data(part, offset=tuple(s.start for s in box))
            context = current_context()
            context.glir.associate(texture.glir)
            # Sent now, so that the array need not live on in a queue.
            context.flush_commands()
            self.bytes_sent += part.nbytes
        return self.complete

    def set_labels(
        self, labels: NDArray[np.uint16], box: Box | None = None, most: int | None = None
    ) -> None:
        """Have other labels of the same shape sent, after a split or a merge.

        Parameters
        ----------
        labels : (Z, Y, X) ndarray of uint16
        box : (slice, slice, slice), optional
            Voxels outside which they are as before; by default all are sent.
        most : int, optional
            The largest label, where it is known.

        Raises
        ------
        ValueError
            If the shape is another.
        """
        if labels.shape != self.shape:
            raise ValueError(f"labels must be {self.shape} as before, got {labels.shape}")
        most = int(labels.max(initial=0)) if most is None else most
        if box is None or (most > 255 and self.labels.internalformat == "r8"):
            old = self.labels
            self._waiting = deque(w for w in self._waiting if w[0] is not old)
            self._begin_labels(labels, most)
            old.delete()
            return
        # Pieces of the labels before that still wait are of these labels now.
        self._waiting = deque(
            (t, labels if t is self.labels else source, b) for t, source, b in self._waiting
        )
        self.uploads += 1
        planes, rows, columns = (
            slice(s.start // f, -(-s.stop // f)) for s, f in zip(box, self.factor, strict=True)
        )
        self._queue(self.labels, labels, (planes, rows, columns))

    def delete(self) -> None:
        """Free the textures."""
        self._waiting.clear()
        for texture in (self.labels, self.density):
            if texture is not None:
                texture.delete()

    def _everything(self) -> Box:
        depth, height, width = self.grid
        return slice(0, depth), slice(0, height), slice(0, width)

    def _begin_labels(self, labels: NDArray[np.uint16], most: int) -> None:
        self.labels = self._begun("r8" if most <= 255 else "r16", "nearest")
        self._queue(self.labels, labels, self._everything())

    def _begun(self, internal: str, filtering: str) -> gloo.Texture3D:
        self.uploads += 1
        return gloo.Texture3D(
            self.grid, format="red", internalformat=internal, interpolation=filtering
        )

    def _queue(self, texture: Held, source: NDArray[np.generic], box: Box) -> None:
        planes, rows, columns = box
        size = (rows.stop - rows.start) * (columns.stop - columns.start) * source.itemsize
        thick = max(1, SLAB_BYTES // max(size, 1))
        for first in range(planes.start, planes.stop, thick):
            slab = slice(first, min(first + thick, planes.stop))
            self._waiting.append((texture, source, (slab, rows, columns)))

    def _texels(self, texture: Held, source: NDArray[np.generic], box: Box) -> NDArray[np.generic]:
        """Return what a box of the grid shows: means of blocks of density, middles of labels."""
        sides = list(zip(box, self.factor, self.shape, strict=True))
        if texture is self.labels:
            middles = [
                np.minimum(np.arange(s.start, s.stop) * f + f // 2, n - 1) for s, f, n in sides
            ]
            part = source[box] if self.factor == (1, 1, 1) else source[np.ix_(*middles)]
            small = texture.internalformat == "r8"
            return np.ascontiguousarray(part, np.uint8 if small else np.uint16)
        voxels = tuple(slice(s.start * f, min(s.stop * f, n)) for s, f, n in sides)
        return np.ascontiguousarray(_block_mean(source[voxels], self.factor))  # type: ignore[arg-type]


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
    while not driver_holds(
        [-(-n // f) for n, f in zip(shape, factor, strict=True)], bytes_per_texel
    ):
        lengths = [n / f for n, f in zip(shape, factor, strict=True)]
        longest = lengths.index(max(lengths))
        if lengths[longest] <= 1:
            break
        factor[longest] += 1
    return factor[0], factor[1], factor[2]


def driver_holds(grid: Sequence[int], bytes_per_texel: int) -> bool:
    """Return whether the driver would take such a 3D texture, by a proxy.

    Parameters
    ----------
    grid : (int, int, int)
        Texels, z y x.
    bytes_per_texel : {1, 2, 4}
    """
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
