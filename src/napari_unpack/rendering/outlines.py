"""Outlines and shadows: of objects in an object-ID image, and around a finished image."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

RGBA = tuple[float, float, float, float]
# Standard deviation of the blur that takes the steps from a line, pixels.
SOFTNESS = 0.6


@dataclass(frozen=True)
class Ink:
    """How an object is marked; colours straight.

    Parameters
    ----------
    line : (r, g, b, a)
        Of the outline, which runs inside the object.
    width : int
        Of the outline, pixels.
    fill : float
        Alpha of the line's colour over the whole object.
    """

    line: RGBA
    width: int = 1
    fill: float = 0.0


def outlined(ids: NDArray[np.int32], inks: Mapping[int, Ink]) -> NDArray[np.float32]:
    """Draw the outlines of some objects: (H, W, 4), premultiplied, else transparent.

    Parameters
    ----------
    ids : (H, W) ndarray of int32
        Object shown at every pixel, 0 for none.
    inks : mapping of int to Ink
        By ID; others are left out.
    """
    from scipy import ndimage

    picture = np.zeros((*ids.shape, 4), np.float32)
    table = np.zeros((max([*inks, int(ids.max(initial=0))]) + 1,), np.bool_)
    table[list(inks)] = True
    marked = table[ids]
    if not marked.any():
        return picture
    rows, cols = np.flatnonzero(marked.any(axis=1)), np.flatnonzero(marked.any(axis=0))
    window = slice(rows[0], rows[-1] + 1), slice(cols[0], cols[-1] + 1)
    # A frame of another ID closes outlines that run into the image's edge.
    part = np.pad(np.where(marked[window], ids[window], 0), 1)
    edge = _edges(part)
    drawn = np.zeros((*part.shape, 4), np.float32)
    for object_id, ink in inks.items():
        mine = part == object_id
        if not mine.any():
            continue
        line = mine & edge
        # Dilated inwards only: an outline must not cover the neighbour.
        for _ in range(ink.width - 1):
            line = mine & ndimage.binary_dilation(line)
        alpha = np.where(line, ink.line[3], np.where(mine, ink.fill, 0.0))
        drawn += alpha[..., None] * np.array([*ink.line[:3], 1.0])
    soft = ndimage.gaussian_filter(drawn, (SOFTNESS, SOFTNESS, 0.0))
    picture[window] = np.clip(soft[1:-1, 1:-1], 0.0, 1.0)
    return picture


def _edges(ids: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Return the pixels that have a neighbour of another ID."""
    edge = np.zeros(ids.shape, np.bool_)
    down, right = ids[1:] != ids[:-1], ids[:, 1:] != ids[:, :-1]
    edge[1:] |= down
    edge[:-1] |= down
    edge[:, 1:] |= right
    edge[:, :-1] |= right
    return edge


# Shifts around the circle; with 12 an outline of 1.5 pixels has no corners.
DIRECTIONS = 12


@dataclass(frozen=True)
class Silhouette:
    """An outline and a shadow around what an image shows; colours straight, lengths in pixels.

    Parameters
    ----------
    outline, shadow : (r, g, b, a)
        Straight colours.
    """

    outline: RGBA = (1.0, 1.0, 1.0, 0.85)
    outline_width: float = 1.5
    shadow: RGBA = (0.0, 0.0, 0.0, 0.5)
    shadow_offset: tuple[float, float] = (2.0, 3.0)
    shadow_size: float = 7.0

    @property
    def margin(self) -> int:
        """How many pixels it reaches beyond the image."""
        reach = max(self.outline_width, self.shadow_size + max(map(abs, self.shadow_offset)))
        return int(np.ceil(reach))


def decorated(rgba: NDArray[np.float32], silhouette: Silhouette) -> NDArray[np.float32]:
    """Lay outline and shadow under an image.

    Parameters
    ----------
    rgba : (h, w, 4) ndarray of float32
        Premultiplied; outside it nothing is.
    silhouette : Silhouette
        Offsets count to the right and down.

    Returns
    -------
    (h + 2 m, w + 2 m, 4) ndarray of float32
        Premultiplied, m = `silhouette.margin` pixels wider on every side.

    Notes
    -----
    The outline is the most alpha found at its width in twelve directions, the shadow alpha
    blurred by a Gaussian cut at two deviations. Done by a shader, this cost the 36 texture reads
    on every pixel of every quad, decorated or not: software rasterisers run both sides of every
    branch.
    """
    from scipy import ndimage

    m = silhouette.margin
    picture = np.pad(rgba, ((m, m), (m, m), (0, 0)))
    alpha = np.ascontiguousarray(picture[..., 3])
    ring = np.zeros_like(alpha)
    for angle in np.arange(DIRECTIONS) * (2 * np.pi / DIRECTIONS):
        way = silhouette.outline_width * np.array([np.sin(angle), np.cos(angle)])
        np.maximum(ring, ndimage.shift(alpha, way, order=1, prefilter=False), out=ring)
    right, down = silhouette.shadow_offset
    blurred = ndimage.gaussian_filter(alpha, silhouette.shadow_size / 2, truncate=2.0)
    shade = ndimage.shift(blurred, (down, right), order=1, prefilter=False)
    under = _flat(silhouette.outline, ring)
    # Outline over shadow, the object over both.
    under += (1.0 - under[..., 3:]) * _flat(silhouette.shadow, shade)
    whole: NDArray[np.float32] = picture + (1.0 - alpha[..., None]) * under
    return whole.astype(np.float32, copy=False)


def _flat(color: RGBA, strength: NDArray[np.float32]) -> NDArray[np.float32]:
    straight = np.array([*color[:3], 1.0], dtype=np.float32)
    return straight * (np.float32(color[3]) * strength)[..., None]
