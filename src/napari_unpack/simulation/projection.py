"""A scanner that counts photons and reconstructs from rays.

Beam hardening, photon starvation and the streaks of metal come out of the physics, slice by
slice, instead of being painted on.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from napari_unpack.simulation.scanner import FWHM_PER_SIGMA, HIGHEST, check_least, gaussian
from napari_unpack.simulation.tomography import ParallelBeam
from napari_unpack.thread_count import thread_count

ENERGIES = np.array([50.0, 70.0, 100.0])
"""Of the spectrum's three bins, keV: a filtered 130 kV tube in short."""

SHARES = np.array([0.34, 0.40, 0.26])
"""Of the photons, by bin."""

WATER = np.array([0.02269, 0.01930, 0.01707])
"""Attenuation of water at these energies, 1/mm (NIST)."""

REFERENCE = 1
"""The bin whose energy the CT numbers of `materials` belong to: 70 keV."""

# Shares are interpolated over the logarithm of the value, between plastics, PVC, aluminium, steel.
_VALUES = np.log([1300.0, 1900.0, 3200.0, 32000.0])
_PHOTOELECTRIC = np.array([0.0, 0.25, 0.28, 0.80])


@dataclass(frozen=True)
class ProjectionScanner:
    """Settings of a scanner that is simulated ray by ray.

    Parameters
    ----------
    photons : float
        The dose: photons a detector cell counts in air in one view.
    electronic : float
        Standard deviation of the electronics' noise, photons.
    views : int, optional
        Directions over 180 degrees; by default as many as the slice's size needs.
    thickness : float
        Full width at half maximum of the slice profile, voxels.

    Raises
    ------
    ValueError
        If one is out of range.

    Notes
    -----
    Parallel beam, three energies, detectors that add up energy. What a voxel is made of is told
    from its CT number at 70 keV: up to 1300 (+ 1000 HU) it attenuates like so much water at every
    energy; above, a growing share p of its attenuation falls with the cube of the energy, chosen
    to give aluminium and steel their values at 60, 70 and 80 keV (NIST element tables) to
    2 %. Signals are corrected for the hardening of water, as scanners do, so that metal alone
    shows it.
    """

    photons: float = 4e4
    electronic: float = 12.0
    views: int | None = None
    thickness: float = 1.2

    def __post_init__(self) -> None:
        check_least(self, photons=1.0, electronic=0.0, thickness=0.0)
        if self.views is not None:
            check_least(self, views=1)

    def scan(
        self,
        density: NDArray[np.float32],
        rng: np.random.Generator,
        spacing: tuple[float, float, float] = (1.0, 1.0, 1.0),
    ) -> NDArray[np.uint16]:
        """Return a scan of a volume: CT number + 1000, clipped to [0, 32000].

        Parameters
        ----------
        density : (Z, Y, X) ndarray of float32
            CT number + 1000 at 70 keV, sharp and without noise. Changed.
        rng : numpy.random.Generator
            Of the noise.
        spacing : (float, float, float) of mm, z y x

        Notes
        -----
        Time is slices times views times pixels; 96 x 160 x 160 takes some 10 s.
        """
        np.clip(density, 0, HIGHEST, out=density)
        if self.thickness:
            profile = gaussian(self.thickness / FWHM_PER_SIGMA)
            ndimage.correlate1d(density, profile, axis=0, output=density, mode="nearest")
        height, width = density.shape[1:]
        beam = ParallelBeam.around((height, width), (spacing[1], spacing[2]), self.views)
        # One for every slice: the noise does not depend on which thread comes first.
        generators = rng.spawn(len(density))
        scanned = np.empty(density.shape, np.uint16)

        def work(z: int) -> None:
            lines = self._measured(density[z], beam, generators[z])
            plane = beam.reconstruct(lines, (height, width)) * (1000.0 / WATER[REFERENCE])
            scanned[z] = np.clip(np.rint(plane), 0, HIGHEST)

        with ThreadPoolExecutor(thread_count(), "unpack") as pool:
            list(pool.map(work, range(len(density))))
        return scanned

    def _measured(
        self, plane: NDArray[np.float32], beam: ParallelBeam, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Return what a slice's line integrals are taken for, (views, detectors)."""
        share = photoelectric_share(plane)
        relative = (plane / 1000).astype(np.float32)
        like_water = beam.project(relative * (1 - share))
        # Projection is what takes time, and most slices hold no metal.
        like_metal = beam.project(relative * share) if share.any() else 0.0 * like_water
        # The photoelectric part falls with the cube of the energy; water's own is in WATER.
        growth = (ENERGIES[REFERENCE] / ENERGIES) ** 3 * WATER[REFERENCE]
        # Before the photons: the detector adds this noise whatever it counts.
        signal = self.electronic * ENERGIES[REFERENCE] * rng.standard_normal(like_water.shape)
        for energy, part, water, metal in zip(ENERGIES, SHARES, WATER, growth, strict=True):
            expected = self.photons * part * np.exp(-water * like_water - metal * like_metal)
            signal += energy * rng.poisson(expected)
        # Nothing is counted behind much metal: a single photon stands in, and makes a streak.
        signal = np.maximum(signal, ENERGIES[REFERENCE])
        air = self.photons * float(SHARES @ ENERGIES)
        return _corrected_for_water(np.log(air / signal))


def photoelectric_share(value: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return which share of attenuation at 70 keV falls with the cube of the energy, float32.

    Of CT numbers + 1000, beyond what water has itself: 0 for organic things, 0.28 aluminium, 0.8
    steel.
    """
    share = np.interp(np.log(np.maximum(value, 1.0)), _VALUES, _PHOTOELECTRIC)
    return share.astype(np.float32)


def _corrected_for_water(lines: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return attenuations as if of one energy, exact for water of any thickness."""
    # Nothing is counted behind 1.5 m of water; the curve is smooth, so steps of 1 mm do.
    thickness = np.linspace(0.0, 1500.0, 1501)
    weights = SHARES * ENERGIES / (SHARES @ ENERGIES)
    seen = -np.log(np.exp(-thickness[:, None] * WATER) @ weights)
    # Air may measure a little below nothing, and must, or its noise would not average out.
    below = lines * (WATER[REFERENCE] / (weights @ WATER))
    above = np.interp(lines, seen, thickness * WATER[REFERENCE])
    return np.where(lines < 0, below, above)
