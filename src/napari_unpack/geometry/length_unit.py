"""How lengths and volumes are told to people, in mm, µm or voxels, and how densities are."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

MICRO = "\N{MICRO SIGN}m"
# Many keyboards have the letter, which looks the same.
GREEK_MICRO = "\N{GREEK SMALL LETTER MU}m"
UNITS = ("mm", MICRO, "voxels")

SIZE_ASSUMED = re.compile(r"\b(mm|rows|thickness) was assumed")
"""In what the readers of `io` say of a file without a voxel size, distance of slices or unit."""

# A volume of so many mm³ and more is told in cm³: bags are, and small parts are not.
LARGE_MM3 = 1000.0


@dataclass(frozen=True)
class LengthUnit:
    """A unit, and how many of it a session's millimetre is.

    Parameters
    ----------
    name : {"mm", "µm", "voxels"}
    per_mm : float
        1 for a scan whose numbers are in mm, or are to be read as µm: a file may say mm and
        mean µm. 1000 where a scan in µm was converted.

    Raises
    ------
    ValueError
        If there is no such unit, or the factor is not positive.
    """

    name: str = "mm"
    per_mm: float = 1.0

    def __post_init__(self) -> None:
        """Refuse what is no unit."""
        if self.name == GREEK_MICRO:
            object.__setattr__(self, "name", MICRO)
        if self.name not in UNITS:
            raise ValueError(f"unit must be one of {', '.join(UNITS)}, got {self.name!r}")
        if not 0 < self.per_mm < float("inf"):
            raise ValueError(f"per_mm must be a positive number, got {self.per_mm!r}")

    @classmethod
    def voxels(cls, spacing: ArrayLike) -> LengthUnit:
        """Return the edge of a cube as large as a voxel, whose size is in mm, z y x."""
        return cls("voxels", float(np.prod(np.asarray(spacing, np.float64))) ** (-1 / 3))

    @property
    def true_mm(self) -> float:
        """True millimetres of a session's millimetre; voxels are as large as the session says."""
        return self.per_mm / 1000 if self.name == MICRO else self.per_mm if self.name == "mm" else 1

    def edges(self, mm: Iterable[float]) -> str:
        """Write lengths given in the session's mm, without the unit: 25 × 6 × 2, 42 × 30 × 0.4."""
        lengths = [length * self.per_mm for length in mm]
        longest = max(lengths, default=0.0)
        # Two digits of the longest at least: a tenth of a micrometre is not 0.000 mm.
        places = max(0, 1 - math.floor(math.log10(longest))) if 0 < longest < math.inf else 3
        return " × ".join(_rounded(length, places) for length in lengths)

    def volume_unit(self, largest_mm3: float) -> VolumeUnit:
        """Return the unit of volumes up to a largest, which is in the session's mm³."""
        if self.name == "voxels":
            return VolumeUnit("voxels", "in voxels", self.per_mm**3)
        if self.name == "mm" and largest_mm3 * self.per_mm**3 >= LARGE_MM3:
            return VolumeUnit("cm³", "in cubic centimetres", self.per_mm**3 / 1000)
        words = "in cubic millimetres" if self.name == "mm" else "in cubic micrometres"
        return VolumeUnit(f"{self.name}³", words, self.per_mm**3)


MM = LengthUnit()


def _rounded(length: float, places: int) -> str:
    text = f"{length:.{places}f}"
    # A thin sheet is not 0 thick: its one digit, and no exponent.
    if length > 0 and not float(text):
        return np.format_float_positional(length, precision=1, fractional=False, trim="-")
    return text


def density_text(density: float) -> str:
    """Write a density: whole, or two digits of a small one, as scans scaled to 0 to 1 have."""
    return f"{density:.0f}" if abs(density) >= 10 else f"{density:.2g}"


@dataclass(frozen=True)
class VolumeUnit:
    """A unit of volumes.

    Parameters
    ----------
    name, words : str
        "cm³", and "in cubic centimetres".
    per_mm3 : float
        How many of it a session's mm³ is.
    """

    name: str
    words: str
    per_mm3: float

    def text(self, mm3: float) -> str:
        """Write a volume given in the session's mm³, without the unit."""
        volume = mm3 * self.per_mm3
        if self.name == "voxels" or volume >= 100:
            return f"{volume:.0f}"
        return f"{volume:.1f}" if volume >= 1 else f"{volume:.2g}"


def assumed_besides_size(assumed: Iterable[str]) -> tuple[str, ...]:
    """Return what readers still assume of a file once somebody has said how large its voxels are.

    Parameters
    ----------
    assumed : iterable of str
        As of a `Scan`.
    """
    return tuple(said for said in assumed if not SIZE_ASSUMED.search(said))
