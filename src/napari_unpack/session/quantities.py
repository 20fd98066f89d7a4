"""Lengths, volumes and angles in words: in the unit that gives a number one can read."""

from __future__ import annotations

from napari_unpack.geometry.length_unit import MICRO, MM, LengthUnit

# Units and how many of them a millimetre has, the largest first.
UNITS = (("m", 1e-3), ("mm", 1.0), (MICRO, 1e3))
# Cubes of centimetres are what luggage is measured in; those of metres are not.
CUBES = (("cm\N{SUPERSCRIPT THREE}", 1e-3), ("mm\N{SUPERSCRIPT THREE}", 1.0))
TINY_CUBE = "\N{MICRO SIGN}m\N{SUPERSCRIPT THREE}", 1e9
# Written with three digits it is 1.00.
NEARLY_ONE = 0.9995
DEGREE = "\N{DEGREE SIGN}"


def length_words(mm: float, unit: LengthUnit = MM) -> str:
    """Return a length in words, three digits of it.

    Parameters
    ----------
    mm : float
        The session's.
    unit : LengthUnit
        Whose numbers are told.
    """
    if unit.name != MM.name:
        return f"{three_digits(mm * unit.per_mm)} {unit.name}"
    mm *= unit.per_mm
    name, per_mm = next(((u, n) for u, n in UNITS if mm * n >= NEARLY_ONE), UNITS[-1])
    return f"{three_digits(mm * per_mm)} {name}"


def volume_words(mm3: float, unit: LengthUnit = MM) -> str:
    """Return a volume in words, three digits of it.

    Parameters
    ----------
    mm3 : float
        Cubes of the session's mm.
    unit : LengthUnit
        Whose numbers are told.
    """
    if unit.name != MM.name:
        volumes = unit.volume_unit(mm3)
        return f"{three_digits(mm3 * volumes.per_mm3)} {volumes.name}"
    mm3 *= unit.per_mm**3
    name, per_mm3 = next(((u, n) for u, n in CUBES if mm3 * n >= NEARLY_ONE), TINY_CUBE)
    return f"{three_digits(mm3 * per_mm3)} {name}"


def angle_words(degrees: float) -> str:
    """Return an angle in words, to a tenth of a degree."""
    return f"{degrees:.1f}{DEGREE}"


def three_digits(value: float) -> str:
    """Return a number with three digits that count, or more before the point."""
    decimals = 0 if value >= 99.95 else 1 if value >= 9.995 else 2
    return f"{value:.{decimals}f}"
