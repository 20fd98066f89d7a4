"""The tinted pass inside a live canvas: rays are cast only when an input has changed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.rays import Rays
from napari_unpack.rendering.gl.depth_quads import ImageTexture
from napari_unpack.rendering.gl.framebuffer import PixelWindow, Targets, namespace
from napari_unpack.rendering.gl.programs import Programs
from napari_unpack.rendering.gl.tinted_pass import Appearance, TintedPass
from napari_unpack.rendering.gl.volume_store import VolumeStore

Where = Callable[[frozenset[int]], PixelWindow | None]


@dataclass(frozen=True, eq=False)
class Inputs:
    """All that a tinted image depends on besides the volumes.

    Parameters
    ----------
    rays, look, occupied, jitter, clipping
        As in `TintedPass.draw`.
    version : int
        Of the volumes.
    """

    rays: Rays
    look: Appearance
    occupied: NDArray[np.bool_] | None
    jitter: bool
    clipping: ArrayLike | None
    version: int

    def retinted(self, other: Inputs | None) -> frozenset[int] | None:
        """Return the IDs whose tints alone tell two images apart, none of equal ones.

        None where more does.
        """
        if other is None or len(self.look.tints) != len(other.look.tints):
            return None
        if not all(_equal(a, b) for a, b in zip(self._parts(), other._parts(), strict=True)):
            return None
        changed = (self.look.tints != other.look.tints).any(axis=1)
        return frozenset(np.flatnonzero(changed).tolist())

    def _parts(self) -> list[Any]:
        rays, look = self.rays, self.look
        return [
            *(rays.table, rays.size, rays.step, rays.near),
            *(look.spacing, look.table, look.domain, look.shading),
            # Occupancy follows from the look and only saves time.
            *(
                self.version,
                self.jitter,
                np.zeros((0, 2, 3)) if self.clipping is None else self.clipping,
            ),
        ]


class TintedCaster:
    """Cast the tinted image in the current canvas's context, and only when something changed.

    Parameters
    ----------
    store : VolumeStore
        The volumes, shared with other casters.
    programs : Programs, optional
        Compiled shaders, shared likewise.

    Attributes
    ----------
    image : ImageTexture or None
        The last image, for a `Quad`; the same object for life, its textures change.
    passes : int
        How often rays were cast.
    rays_cast : int
        How many rays.
    targets : Targets
        Frame buffers by size.
    tinted_pass : TintedPass or None
        Of the current context; None before the first image.

    Notes
    -----
    To be used where the canvas's context is current, as in `QuadsVisual.before_draw`. Frame
    buffer and viewport are as before afterwards; blending and depth test may be off, which
    `QuadsVisual` and vispy's visuals set for themselves. In another context than last time, as
    when a layer moves to another canvas, it starts afresh.
    """

    def __init__(self, store: VolumeStore, programs: Programs | None = None) -> None:
        self.store = store
        self._programs = programs or Programs()
        self.image: ImageTexture | None = None
        self.targets = Targets(TintedPass.channels, smooth=True)
        self.tinted_pass: TintedPass | None = None
        self._context: Any = None
        self._earlier = self.rays_cast = 0
        self._last: Inputs | None = None

    @property
    def passes(self) -> int:
        """How often rays were cast."""
        return self._earlier + (0 if self.tinted_pass is None else self.tinted_pass.passes)

    def cast(
        self,
        rays: Rays,
        look: Appearance,
        occupied: NDArray[np.bool_] | None = None,
        jitter: bool = False,
        clipping: ArrayLike | None = None,
        where: Where | None = None,
    ) -> ImageTexture:
        """Return the image of these inputs, casting rays unless it is the last one still.

        Parameters
        ----------
        rays, look, occupied, jitter, clipping
            As in `TintedPass.draw`.
        where : callable, optional
            Given IDs, returns the pixels in which those objects may be seen, as
            `TintedPass.draw` takes them, or None for no pixel. Where nothing but their tints has
            changed the others are kept.

        Returns
        -------
        ImageTexture
            Colour and depth textures of the rays' size.
        """
        context = namespace()
        # Textures of another context mean nothing in this one.
        if context is not self._context:
            self._start_afresh()
            self._context = context
        inputs = Inputs(rays, look, occupied, jitter, clipping, self.store.version)
        retinted = inputs.retinted(self._last)
        if self.image is not None and retinted == frozenset():
            return self.image
        if self.tinted_pass is None:
            self.tinted_pass = TintedPass(self._programs)
        target = self.targets.get(rays.size)
        window: PixelWindow | None = (0, 0, rays.size[1], rays.size[0])
        # Only tints have changed: pixels without these objects stay as they are.
        if retinted and where is not None and self.image is not None:
            window = where(retinted)
        # Half an image must not be taken for a whole one if a driver gives up.
        self._last = None
        if window is not None:
            self.tinted_pass.draw(
                target, self.store.here(), rays, look, occupied, jitter, clipping, window
            )
            self.rays_cast += window[2] * window[3]
        self._last = inputs
        if self.image is None:
            self.image = ImageTexture(*target.textures)
        else:
            self.image.update(*target.textures)
        return self.image

    def close(self) -> None:
        """Free the frame buffers; the volumes stay with the store."""
        self.targets.clear()
        self._start_afresh()

    def _start_afresh(self) -> None:
        self._earlier = self.passes
        self.tinted_pass = self._last = self.image = self._context = None
        self.targets = Targets(TintedPass.channels, smooth=True)


def _equal(a: Any, b: Any) -> bool:
    return a is b or bool(np.array_equal(np.asarray(a), np.asarray(b)))
