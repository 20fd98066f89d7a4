"""A ring of colours that people who confuse red and green can tell apart."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
"""sRGB of the ring's colours: dark yellow sides go through red, dark blue ones through violet,
so that they are colourful to those who see all hues."""

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
    position = np.asarray(hue, dtype=np.float64) % 1.0 * _RING
    low = np.floor(position).astype(int) % _RING
    part = (position - np.floor(position))[..., None]
    ring = _ring()
    return (1.0 - part) * ring[low] + part * ring[(low + 1) % _RING]


@lru_cache(maxsize=1)
def _ring() -> NDArray[np.float64]:
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
