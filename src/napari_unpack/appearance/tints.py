"""Tints of hues: the paper's HSV circle, a perceptually even ring, and a colour-blind-safe ring."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

# sRGB of the ring's colours: dark yellow sides go through red, dark blue ones through violet, so
# that they are colourful to those who see all hues.
_ANCHORS = (
    (0.84, 0.20, 0.12),
    (1.00, 0.58, 0.05),
    (1.00, 0.92, 0.20),
    (0.80, 0.98, 0.72),
    (0.40, 0.82, 1.00),
    (0.20, 0.47, 0.98),
    (0.30, 0.20, 0.78),
    (0.52, 0.12, 0.45),
)

PROTANOPIA = (
    (0.152286, 1.052583, -0.204868),
    (0.114503, 0.786281, 0.099216),
    (-0.003882, -0.048116, 1.051998),
)
DEUTERANOPIA = (
    (0.367322, 0.860646, -0.227968),
    (0.280085, 0.672501, 0.047413),
    (-0.011820, 0.042940, 0.968881),
)
_FINE = 1440
_RING = 360


def safe_to_rgb(hue: ArrayLike) -> NDArray[np.float64]:
    """Return (..., 3) sRGB of hues in [0, 1) on a ring without confusions of red and green.

    Notes
    -----
    To dichromats colours differ in two ways only, light or dark and yellow or blue, so a circle
    of hues at one lightness folds onto a line, and opposite sides of it coincide. This ring is
    a circle in their plane instead: it goes from red (to them dark yellow) over light yellow,
    white and light blue to dark blue and back through a dark neutral. Lightness is thus a part
    of the colour. Equal steps of hue are equal steps of the mean of what protanopes and
    deuteranopes see, simulated by the matrices of Machado, Oliveira and Fernandes 2009
    (severity 1), measured in CIELAB.
    """
    return _on_ring(_safe_ring(), hue)


def _on_ring(ring: NDArray[np.float64], hue: ArrayLike) -> NDArray[np.float64]:
    # Linear between neighbours, so that hues a little apart are never one colour.
    position = np.asarray(hue, dtype=np.float64) % 1.0 * _RING
    low = np.floor(position).astype(int) % _RING
    part = (position - np.floor(position))[..., None]
    return (1.0 - part) * ring[low] + part * ring[(low + 1) % _RING]


@lru_cache(maxsize=1)
def _safe_ring() -> NDArray[np.float64]:
    """Return the (360, 3) sRGB colours of the ring, evenly apart to dichromats."""
    from scipy.interpolate import CubicSpline

    closed = np.array([*_ANCHORS, _ANCHORS[0]])
    spline = CubicSpline(np.linspace(0, 1, len(closed)), closed, bc_type="periodic")
    colors = np.clip(spline(np.linspace(0, 1, _FINE + 1)), 0.0, 1.0)
    steps = np.mean(
        [
            np.linalg.norm(np.diff(_cielab(_seen(colors, np.array(matrix))), axis=0), axis=1)
            for matrix in (PROTANOPIA, DEUTERANOPIA)
        ],
        axis=0,
    )
    way = np.concatenate([[0.0], np.cumsum(steps)])
    places = np.arange(_RING) / _RING * way[-1]
    return np.stack([np.interp(places, way, colors[:, k]) for k in range(3)], axis=1)


def _seen(srgb: NDArray[np.float64], matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return linear RGB as a dichromat sees it."""
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return np.clip(linear @ matrix.T, 0.0, 1.0)


def _cielab(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return CIELAB of linear sRGB, white at D65."""
    xyz = (
        linear
        @ np.array(
            [
                [0.433953, 0.376219, 0.189828],
                [0.212671, 0.715160, 0.072169],
                [0.017758, 0.109477, 0.872765],
            ]
        ).T
    )
    f = np.where(xyz > 216 / 24389, np.cbrt(xyz), (24389 / 27 * xyz + 16) / 116)
    x, y, z = np.moveaxis(f, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


Mode = Literal["perceptual", "safe", "hsv"]
MODES: tuple[Mode, ...] = get_args(Mode)


Rgba = tuple[float, float, float, float]

# Opacity as people choose it, raised to this, is that of a voxel: what matters for translucency
# lies near zero, so the opacity curve is drawn on the same scale.
OPACITY_POWER = 3


def tints_of(
    hues: Mapping[int, float],
    max_id: int,
    mode: Mode = "perceptual",
    colors: Mapping[int, Rgba] | None = None,
) -> NDArray[np.float32]:
    """Make the table of tints a ray caster multiplies on.

    Parameters
    ----------
    hues : mapping of int to float
        Hue in [0, 1) by ID.
    max_id : int
        Largest ID of the table.
    mode : {"perceptual", "safe", "hsv"}
        `hsv` is the paper's, with S = V = 1; `safe` serves people who confuse red and green.
    colors : mapping of int to (float, float, float, float), optional
        Straight RGBA by ID of the objects that a person gave a colour, in place of their hue's.

    Returns
    -------
    (max_id + 1, 4) ndarray of float32
        Straight RGBA by ID with alpha 1, but for own colours that are translucent; zero, that is
        invisible, for 0 and for IDs without a hue.

    Raises
    ------
    ValueError
        If an ID is outside 1 to `max_id` or the mode is unknown.
    """
    if mode not in _RINGS:
        raise ValueError(f"mode must be one of {', '.join(MODES)}, got {mode!r}")
    table = np.zeros((max_id + 1, 4), dtype=np.float32)
    if not hues:
        return table
    shown = list(hues)
    if min(shown) < 1 or max(shown) > max_id:
        raise ValueError(f"hues must be of IDs 1 to {max_id}, got {min(shown)} to {max(shown)}")
    table[shown, :3] = _RINGS[mode](list(hues.values()))
    table[shown, 3] = 1.0
    own = colors or {}
    for i in own.keys() & hues.keys():
        *rgb, opacity = own[i]
        table[i] = *rgb, opacity**OPACITY_POWER
    return table


# Straight RGBA of matter without a label: grey, and so thin that objects are seen through it.
UNLABELLED_TINT = (0.8, 0.8, 0.8, 0.3)

# Opacity per voxel that an object alone has at its mean density at least.
LEGIBLE_OPACITY = 0.2
# Above it noise inside a faint object would be as visible as the object.
MOST_OPACITY_GAIN = 8.0


def packed_tints(
    hues: Mapping[int, float],
    max_id: int,
    mode: Mode,
    show_unlabelled: bool = False,
    colors: Mapping[int, Rgba] | None = None,
) -> NDArray[np.float32]:
    """Return the (max_id + 1, 4) straight RGBA tints of what is packed by ID, else 0; read-only.

    Parameters
    ----------
    hues : mapping of int to float
        Hue in [0, 1) by ID, of the packed objects alone.
    max_id : int
        Largest ID of the table.
    mode : {"perceptual", "safe", "hsv"}
        How hues become tints.
    show_unlabelled : bool
        Whether row 0, matter without a label, is visible.
    colors : mapping of int to (float, float, float, float), optional
        As for `tints_of`.
    """
    table = tints_of(hues, max_id, mode=mode, colors=colors)
    if show_unlabelled:
        table[0] = UNLABELLED_TINT
    # Renderers share it between threads and compare it with the table drawn last.
    table.flags.writeable = False
    return table


def legible_tint(
    hue: float, mode: Mode, opacity: float | None = None, color: Rgba | None = None
) -> NDArray[np.float32]:
    """Return the tint of an object that is shown alone.

    Parameters
    ----------
    hue : float
        In [0, 1).
    mode : {"perceptual", "safe", "hsv"}
        How hues become tints.
    opacity : float, optional
        Per voxel, at the object's mean density. None where the object has a transfer function
        of its own, which is not to be corrected, or no density that is known.
    color : (float, float, float, float), optional
        Straight RGBA that a person gave it.

    Returns
    -------
    (4,) ndarray of float32
        Straight RGBA. Alpha is above 1 where the opacity is too small to make the object out.
    """
    tint = tints_of({1: hue}, 1, mode=mode, colors={} if color is None else {1: color})[1]
    if opacity is not None:
        tint[3] *= np.clip(LEGIBLE_OPACITY / max(opacity, 1e-6), 1.0, MOST_OPACITY_GAIN)
    return tint


def nearest_hue(color: Rgba, mode: Mode) -> float:
    """Return the hue in [0, 1) that looks most like a colour.

    Parameters
    ----------
    color : (float, float, float, float)
        Straight RGBA.
    mode : {"perceptual", "safe", "hsv"}
        How hues become tints.
    """
    ring = _RINGS[mode](np.arange(_RING) / _RING)
    return int(np.square(ring - np.array(color[:3])).sum(axis=1).argmin()) / _RING


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
    return _on_ring(_even_ring(), hue)


_RED = 27.0 / 360.0


@lru_cache(maxsize=1)
def _even_ring() -> NDArray[np.float64]:
    """Return the (360, 3) sRGB colours of the ring, smooth around the circle."""
    angles = (np.arange(_RING) / _RING + _RED) % 1.0 * 2 * np.pi
    lightness = np.linspace(0.6, 0.86, 27)
    chroma = np.linspace(0.0, 0.32, 161)
    rgb = _oklch_to_linear(lightness[:, None, None], chroma[None, :, None], angles[None, None, :])
    # The most colourful point of every hue inside sRGB, by search: it has no closed form.
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
    # A ring has no ends, so it is continued at both.
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
