"""Streaks around metal, from the beam hardening that causes them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from napari_unpack.kernels import njit

# What counts as metal, CT number + 1000.
METAL = 4800.0
# Directions over 180 degrees; their number itself leaves fine streaks.
VIEWS = 72


def add_streaks(
    density: NDArray[np.float32], strength: float, noise: float, rng: np.random.Generator
) -> None:
    """Add the streaks of metal to every axial slice, in place.

    Parameters
    ----------
    density : (Z, Y, X) ndarray of float32
        CT number + 1000; changed. An axial slice is (Y, X).
    strength : float
        Depth in CT numbers of the dark band between two pieces of metal, roughly.
    noise : float
        Standard deviation of photon starvation on the densest ray, as a share of `strength`.
    rng : numpy.random.Generator
        Of that noise.

    Notes
    -----
    Only the metal is projected, at half resolution. A ray through p of metal measures about
    p - b p^2, because the beam hardens; so what is reconstructed by filtered back-projection of
    -p^2 (Ram-Lak) is the error, bands between metals and shine around it alike. Linear in the
    slices with metal, their pixels and the views.
    """
    if strength <= 0.0:
        return
    height, width = density.shape[1:]
    # Rays stay within an axial slice, and so do the streaks of its metal.
    slices = np.flatnonzero(density.max(axis=(1, 2)) > METAL)
    done: dict[int, NDArray[np.float32]] = {}
    for z in slices:
        # Neighbouring slices share one error: it is smooth along z, and takes half the time.
        key = int(z) // 2
        if key not in done:
            near = density[2 * key : 2 * key + 2].max(axis=0)
            done = {key: _error(np.minimum(near, 32000.0), strength, noise, rng)}
        density[z] += done[key][:height, :width]


def _error(
    image: NDArray[np.float32], strength: float, noise: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    height, width = image.shape
    padded = np.pad(image, ((0, height % 2), (0, width % 2)))
    # Half resolution: streaks are smooth, and projection costs a quarter.
    small = padded.reshape(padded.shape[0] // 2, 2, padded.shape[1] // 2, 2).mean(axis=(1, 3))
    dense = np.where(small > 0.5 * METAL, small / 32000.0, 0.0).astype(np.float32)
    reach = int(math.hypot(*dense.shape)) + 3
    sinogram = np.zeros((VIEWS, reach), np.float32)
    _project(dense, sinogram)
    # Rays through more than a few pixels of solid metal are starved alike.
    hard = 6.0 * np.minimum(sinogram, 8.0) ** 1.6
    grain = rng.standard_normal(sinogram.shape).astype(np.float32)
    error = -hard * (1.0 + noise * grain)
    error = ndimage.convolve1d(error, _ramp(reach), axis=1, mode="constant")
    back = np.zeros_like(dense)
    _back_project(error.astype(np.float32), back)
    back *= strength * math.pi / VIEWS
    # Metal itself is clipped far above; only what is around it shows the error.
    back[dense > 0.2] = 0.0
    return np.asarray(ndimage.zoom(back, 2, order=1, mode="nearest", grid_mode=True), np.float32)


def _ramp(reach: int) -> NDArray[np.float64]:
    # The Ram-Lak kernel in space, smoothed by (1, 2, 1) / 4.
    n = np.arange(-(reach // 2), reach // 2 + 1)
    odd = n % 2 == 1
    kernel = np.zeros(len(n))
    kernel[odd] = -1.0 / (np.pi * n[odd]) ** 2
    # The samples of Ram-Lak at a pitch of 1 (Kak & Slaney 1988, eq. 3.61).
    kernel[n == 0] = 0.25
    return np.convolve(kernel, [0.25, 0.5, 0.25], mode="same")


@njit(cache=True, nogil=True)
def _project(dense, sinogram):  # type: ignore[no-untyped-def]
    views, reach = sinogram.shape
    middle_y, middle_x = (dense.shape[0] - 1) / 2, (dense.shape[1] - 1) / 2
    for y in range(dense.shape[0]):
        for x in range(dense.shape[1]):
            # Metal is rare: only its pixels are projected, each into two cells.
            if dense[y, x] == 0.0:
                continue
            for view in range(views):
                # Half a step off the axes, whose views would put all of an edge into one cell.
                angle = math.pi * (view + 0.5) / views
                s = (x - middle_x) * math.cos(angle) + (y - middle_y) * math.sin(angle)
                at = s + (reach - 1) / 2
                cell = int(at)
                share = at - cell
                sinogram[view, cell] += dense[y, x] * (1.0 - share)
                sinogram[view, cell + 1] += dense[y, x] * share


@njit(cache=True, nogil=True)
def _back_project(sinogram, image):  # type: ignore[no-untyped-def]
    views, reach = sinogram.shape
    middle_y, middle_x = (image.shape[0] - 1) / 2, (image.shape[1] - 1) / 2
    for view in range(views):
        angle = math.pi * (view + 0.5) / views
        cosine, sine = math.cos(angle), math.sin(angle)
        for y in range(image.shape[0]):
            at = (y - middle_y) * sine - middle_x * cosine + (reach - 1) / 2
            for x in range(image.shape[1]):
                cell = int(at)
                share = at - cell
                image[y, x] += (
                    sinogram[view, cell] * (1.0 - share) + sinogram[view, cell + 1] * share
                )
                at += cosine
