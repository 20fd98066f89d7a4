"""Parallel-beam projection of a slice and its filtered back-projection."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from napari_unpack.kernels import njit

Plane = NDArray[np.float32]


@dataclass(frozen=True)
class ParallelBeam:
    """A detector that goes half around a slice.

    Parameters
    ----------
    views : int
        Directions, evenly over 180 degrees.
    detectors : int
        Cells, centred on the middle of the slice.
    pitch : float
        Distance of cells, mm.
    spacing : (float, float)
        Pixel size of the slice, mm, y x.
    """

    views: int
    detectors: int
    pitch: float
    spacing: tuple[float, float]

    @classmethod
    def around(
        cls, shape: tuple[int, int], spacing: tuple[float, float], views: int | None = None
    ) -> ParallelBeam:
        """Return a detector that sees all of a slice, with cells of its finer pixels' size.

        Parameters
        ----------
        shape : (int, int)
            Of the slice, y x.
        spacing : (float, float)
            mm, y x.
        views : int, optional
            By default so many that neighbouring ones differ by a pixel at the rim.
        """
        pitch = min(spacing)
        diagonal = math.hypot(shape[0] * spacing[0], shape[1] * spacing[1])
        # Odd, so that one cell looks through the middle; the spare ones let interpolation read on.
        detectors = 2 * math.ceil(diagonal / pitch / 2) + 3
        return cls(views or math.ceil(math.pi / 2 * detectors), detectors, pitch, spacing)

    def project(self, plane: Plane) -> NDArray[np.float64]:
        """Return the (views, detectors) line integrals of a (Y, X) slice, value times mm.

        Notes
        -----
        Joseph's method: one interpolated sample in each row or column, whichever the ray crosses
        more steeply. Time is views times detectors times pixels along an edge.
        """
        sinogram = np.zeros((self.views, self.detectors))
        _project(np.ascontiguousarray(plane, np.float32), sinogram, self.pitch, *self.spacing)
        return sinogram

    def reconstruct(self, sinogram: NDArray[np.float64], shape: tuple[int, int]) -> Plane:
        """Return the slice of line integrals, value per mm.

        Parameters
        ----------
        sinogram : (views, detectors) ndarray of float64
            Line integrals.
        shape : (int, int)
            Of the slice, y x.

        Notes
        -----
        Ram-Lak, taken from its samples in space so that the mean is right (Kak & Slaney 1988,
        eq. 3.61), times a Hann window; linear interpolation between cells.
        """
        # Twice the detectors and a power of two: no wrap-around of the filter, a fast transform.
        size = 1 << (2 * self.detectors - 1).bit_length()
        n = np.fft.fftfreq(size, 1 / size)
        kernel = np.zeros(size)
        # Sampled in space, the ramp keeps its small value at 0: a plain ramp would lose the mean.
        kernel[0] = 0.25
        odd = n % 2 != 0
        kernel[odd] = -1.0 / (np.pi * n[odd]) ** 2
        ramp = np.real(np.fft.rfft(kernel)) / self.pitch
        hann = 0.5 + 0.5 * np.cos(np.linspace(0, np.pi, len(ramp)))
        spectrum = np.fft.rfft(sinogram, size, axis=1) * (ramp * hann)
        filtered = np.fft.irfft(spectrum, size, axis=1)[:, : self.detectors]
        plane = np.zeros(shape, np.float32)
        _back_project(np.ascontiguousarray(filtered), plane, self.pitch, *self.spacing)
        return plane


@njit(cache=True, nogil=True)
def _project(plane, sinogram, pitch, dy, dx):  # type: ignore[no-untyped-def]
    height, width = plane.shape
    views, detectors = sinogram.shape
    middle_y, middle_x = (height - 1) / 2, (width - 1) / 2
    # The inner sum runs along memory either way.
    columns = np.ascontiguousarray(plane.T)
    for view in range(views):
        angle = math.pi * (view + 0.5) / views
        cosine, sine = math.cos(angle), math.sin(angle)
        along_x = abs(sine) * dx >= abs(cosine) * dy
        for cell in range(detectors):
            s = (cell - (detectors - 1) / 2) * pitch
            if along_x:
                at = (s + middle_x * dx * cosine) / (sine * dy) + middle_y
                total = _along(columns, at, -cosine * dx / (sine * dy)) * dx / abs(sine)
            else:
                at = (s + middle_y * dy * sine) / (cosine * dx) + middle_x
                total = _along(plane, at, -sine * dy / (cosine * dx)) * dy / abs(cosine)
            sinogram[view, cell] = total


@njit(cache=True, nogil=True)
def _along(lines, at, slope):  # type: ignore[no-untyped-def]
    """Sum what a ray meets in every line, from position `at` in the first, linearly between."""
    count, length = lines.shape
    total = 0.0
    for line in range(count):
        low = math.floor(at)
        share = at - low
        index = int(low)
        if 0 <= index < length:
            total += lines[line, index] * (1.0 - share)
        if 0 <= index + 1 < length:
            total += lines[line, index + 1] * share
        at += slope
    return total


@njit(cache=True, nogil=True)
def _back_project(filtered, plane, pitch, dy, dx):  # type: ignore[no-untyped-def]
    height, width = plane.shape
    views, detectors = filtered.shape
    middle_y, middle_x = (height - 1) / 2, (width - 1) / 2
    # In float64: hundreds of views of either sign nearly cancel where there is air.
    sums = np.zeros((height, width))
    for view in range(views):
        angle = math.pi * (view + 0.5) / views
        cosine, sine = math.cos(angle), math.sin(angle)
        for y in range(height):
            at = ((y - middle_y) * dy * sine - middle_x * dx * cosine) / pitch
            at += (detectors - 1) / 2
            for x in range(width):
                cell = int(at)
                share = at - cell
                sums[y, x] += filtered[view, cell] * (1.0 - share)
                sums[y, x] += filtered[view, cell + 1] * share
                at += cosine * dx / pitch
    for y in range(height):
        for x in range(width):
            plane[y, x] = sums[y, x] * math.pi / views
