"""What a scanner makes of a bag: blur, noise and streaks, added to the image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from napari_unpack.simulation.streaks import add_streaks

HIGHEST = 32000
"""CT numbers + 1000 are clipped here, as CONVENTIONS.md says: metal saturates scanners too."""

FWHM_PER_SIGMA = 2.3548
"""Full width at half maximum of a Gaussian, in standard deviations: 2 sqrt(2 ln 2)."""


def check_least(scanner: object, **least: float) -> None:
    """Raise `ValueError` where a setting of a scanner is less than this, or not finite.

    Parameters
    ----------
    scanner : object
        Whose settings are checked.
    **least : float
        The least value of each setting.

    Raises
    ------
    ValueError
        If a setting is less, or not finite.
    """
    for name, limit in least.items():
        value = getattr(scanner, name)
        if not np.isfinite(value) or value < limit:
            raise ValueError(f"{name} of the scanner must be {limit:g} or more, got {value!r}")


@dataclass(frozen=True)
class Scanner:
    """Settings of a scanner.

    Parameters
    ----------
    blur : float
        Full width at half maximum of the point spread, voxels.
    noise : float
        Standard deviation of the noise, CT numbers. It is as coarse as the point spread.
    streaks : float
        Strength of metal's streaks, CT numbers; 0 for none.
    starvation : float
        Noise on the densest rays, as a share of the streaks.

    Raises
    ------
    ValueError
        If one is negative or not finite, or the blur wider than 6 voxels.
    """

    blur: float = 1.3
    noise: float = 16.0
    streaks: float = 70.0
    starvation: float = 0.25

    def __post_init__(self) -> None:
        check_least(self, blur=0.0, noise=0.0, streaks=0.0, starvation=0.0)
        if self.blur > 6:
            raise ValueError(f"blur of the scanner must be 6 voxels or less, got {self.blur!r}")

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
            CT number + 1000, sharp and without noise. Changed.
        rng : numpy.random.Generator
            Of the noise.
        spacing : (float, float, float)
            mm, z y x; changes nothing: this scanner thinks in voxels.

        Notes
        -----
        White noise is added before the blur, as much more of it as the blur takes away, so that
        one pass gives both the point spread and the noise's correlation.
        """
        np.clip(density, 0, HIGHEST, out=density)
        # Before blur and noise: the scanner blurs what it reconstructs, errors included.
        add_streaks(density, self.streaks, self.starvation, rng)
        kernel = gaussian(self.blur / FWHM_PER_SIGMA)
        # A pass scales white noise by the root of the kernel's sum of squares; there are three.
        gain = self.noise / float((kernel**2).sum()) ** 1.5
        # Slice by slice: noise of the whole volume at once would double the memory.
        for z in range(density.shape[0]):
            density[z] += gain * rng.standard_normal(density.shape[1:], dtype=np.float32)
        for axis in range(3):
            ndimage.correlate1d(density, kernel, axis=axis, output=density, mode="nearest")
        np.clip(density, 0, HIGHEST, out=density)
        np.rint(density, out=density)
        return density.astype(np.uint16)


def gaussian(sigma: float) -> NDArray[np.float64]:
    """Return a normalised Gaussian of some voxels' standard deviation, cut at three."""
    reach = int(np.ceil(3 * sigma))
    offsets = np.arange(-reach, reach + 1)
    weights: NDArray[np.float64] = np.exp(-0.5 * (offsets / max(sigma, 1e-6)) ** 2)
    return weights / weights.sum()
