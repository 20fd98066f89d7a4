"""From hues to tints: the paper's HSV circle, and a ring that looks even to the eye."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import lru_cache
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.appearance.safe_ring import safe_to_rgb

Mode = Literal["perceptual", "safe", "hsv"]
MODES: tuple[Mode, ...] = get_args(Mode)


def tints_of(
    hues: Mapping[int, float],
    max_id: int,
    hidden: Collection[int] = (),
    mode: Mode = "perceptual",
) -> NDArray[np.float32]:
    """Make the table of tints a ray caster multiplies on.

    Parameters
    ----------
    hues : mapping of int to float
        Hue in [0, 1) by ID.
    max_id : int
        Largest ID of the table.
    hidden : collection of int
        IDs to be left out of the picture.
    mode : {"perceptual", "safe", "hsv"}
        `hsv` is the paper's, with S = V = 1; `safe` serves people who confuse red and green.

    Returns
    -------
    (max_id + 1, 4) ndarray of float32
        Straight RGBA by ID with alpha 1; zero, that is invisible, for 0, for what is hidden and
        for IDs without a hue.

    Raises
    ------
    ValueError
        If an ID is outside 1 to `max_id` or the mode is unknown.
    """
    if mode not in _RINGS:
        raise ValueError(f"mode must be one of {', '.join(MODES)}, got {mode!r}")
    table = np.zeros((max_id + 1, 4), dtype=np.float32)
    left_out = set(hidden)
    shown = [i for i in hues if i not in left_out]
    if not shown:
        return table
    if min(shown) < 1 or max(shown) > max_id:
        raise ValueError(f"hues must be of IDs 1 to {max_id}, got {min(shown)} to {max(shown)}")
    values = np.array([hues[i] for i in shown])
    table[shown, :3] = _RINGS[mode](values)
    table[shown, 3] = 1.0
    return table


def hsv_to_rgb(hue: ArrayLike) -> NDArray[np.float64]:
    """Return (..., 3) RGB of hues in [0, 1) at full saturation and value."""
    shift = np.asarray(hue, dtype=np.float64)[..., None] * 6.0 + np.array([0.0, 4.0, 2.0])
    return np.clip(np.abs(shift % 6.0 - 3.0) - 1.0, 0.0, 1.0)


def perceptual_to_rgb(hue: ArrayLike) -> NDArray[np.float64]:
    """Return (..., 3) sRGB of hues in [0, 1) on a ring of even steps.

    Notes
    -----
    The angle is that of OKLCH (Ottosson 2020), turned so that 0 is red as in HSV. Lightness and
    chroma are not constant: a ring of constant chroma inside sRGB is bounded by its poorest hue
    and comes out pastel. They lean towards each hue's most colourful point in sRGB, within a
    band of lightness so that no object looks lit differently.
    """
    position = np.asarray(hue, dtype=np.float64) % 1.0 * _RING
    low = np.floor(position).astype(int) % _RING
    part = (position - np.floor(position))[..., None]
    ring = _ring()
    return (1.0 - part) * ring[low] + part * ring[(low + 1) % _RING]


_RING = 360
_RED = 27.0 / 360.0


@lru_cache(maxsize=1)
def _ring() -> NDArray[np.float64]:
    """Return the (360, 3) sRGB colours of the ring, smooth around the circle."""
    angles = (np.arange(_RING) / _RING + _RED) % 1.0 * 2 * np.pi
    lightness = np.linspace(0.6, 0.86, 27)
    chroma = np.linspace(0.0, 0.32, 161)
    rgb = _oklch_to_linear(lightness[:, None, None], chroma[None, :, None], angles[None, None, :])
    inside = ((rgb >= -1e-4) & (rgb <= 1 + 1e-4)).all(axis=-1)
    most = chroma[inside.cumprod(axis=1).sum(axis=1) - 1]
    # The lightness at which the hue has most chroma, held near the middle of the band.
    score = most - 0.35 * np.abs(lightness - 0.74)[:, None]
    best = lightness[score.argmax(axis=0)]
    best = _smoothed(best)
    rows = np.abs(lightness[:, None] - best).argmin(axis=0)
    reach = np.minimum(most[rows, np.arange(_RING)], 0.2)
    linear = _oklch_to_linear(best, _smoothed(0.96 * reach), angles)
    linear = np.clip(linear, 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def _smoothed(values: NDArray[np.float64]) -> NDArray[np.float64]:
    width = 25
    padded = np.concatenate([values[-width:], values, values[:width]])
    kernel = np.hanning(2 * width + 1)
    return np.convolve(padded, kernel / kernel.sum(), mode="valid")


def _oklch_to_linear(
    lightness: ArrayLike, chroma: ArrayLike, angle: ArrayLike
) -> NDArray[np.float64]:
    """Return (..., 3) linear sRGB of OKLCH colours; outside [0, 1] where out of gamut."""
    light, strong, turn = np.broadcast_arrays(lightness, chroma, angle)
    a, b = strong * np.cos(turn), strong * np.sin(turn)
    cube = [
        light + 0.3963377774 * a + 0.2158037573 * b,
        light - 0.1055613458 * a - 0.0638541728 * b,
        light - 0.0894841775 * a - 1.2914855480 * b,
    ]
    lms = np.stack(cube, axis=-1) ** 3
    matrix = np.array(
        [
            [4.0767416621, -3.3077115913, 0.2309699292],
            [-1.2684380046, 2.6097574011, -0.3413193965],
            [-0.0041960863, -0.7034186147, 1.7076147010],
        ]
    )
    return np.asarray(lms @ matrix.T)


_RINGS = {"perceptual": perceptual_to_rgb, "safe": safe_to_rgb, "hsv": hsv_to_rgb}
