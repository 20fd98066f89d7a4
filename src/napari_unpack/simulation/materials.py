"""What objects are made of: CT numbers at about 70 keV and mass densities."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True)
class Material:
    """One material.

    Parameters
    ----------
    name : str
        As it stands in the table of objects.
    value : float
        CT number + 1000: air 0, water 1000, clipped at 32000.
    density : float
        Grams per cubic centimetre.
    """

    name: str
    value: float
    density: float


_TABLE = (
    Material("air", 1, 0.0012),
    Material("cotton", 423, 0.45),
    Material("wool", 360, 0.38),
    Material("denim", 520, 0.55),
    Material("plush", 390, 0.41),
    Material("foam", 120, 0.12),
    Material("cardboard", 620, 0.65),
    Material("wood", 565, 0.60),
    Material("paper", 753, 0.80),
    Material("leather", 841, 0.90),
    Material("tea", 480, 0.45),
    Material("ethanol", 779, 0.79),
    Material("wax", 884, 0.90),
    Material("rubber", 892, 0.93),
    Material("polypropylene", 886, 0.905),
    Material("polyethylene", 930, 0.95),
    Material("water", 1000, 1.0),
    Material("cosmetic", 1020, 1.01),
    Material("fruit", 985, 0.96),
    Material("food", 1060, 1.06),
    Material("soap", 1046, 1.05),
    Material("nylon", 1087, 1.14),
    Material("ABS", 1010, 1.05),
    Material("PET", 1265, 1.38),
    Material("sugar", 1501, 1.59),
    Material("PVC", 1916, 1.38),
    Material("circuit board", 2300, 1.85),
    Material("glass", 2956, 2.50),
    Material("ceramic", 2750, 2.40),
    Material("battery", 3600, 2.60),
    Material("aluminium", 3221, 2.70),
    Material("copper strands", 5200, 2.00),
    Material("steel sheet", 5600, 1.4),
    # Clipped: solid metal lies above 32000 at 70 keV, and no format here holds more.
    Material("steel", 32000, 7.87),
    Material("brass", 32000, 8.50),
)

MATERIALS = MappingProxyType({material.name: material for material in _TABLE})
"""Every material by name.

Values are those of 70 keV, by the mixture rule on the element tables of NIST. Thin
sheet steel and stranded copper stand lower than solid metal: walls of a fraction of a voxel are
modelled as a voxel of less.
"""

MATERIAL_INDEX = MappingProxyType({material.name: i for i, material in enumerate(_TABLE)})
"""The row of every material in `MATERIALS`, which programs refer to."""
