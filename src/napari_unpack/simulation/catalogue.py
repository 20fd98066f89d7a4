"""All kinds of things that travellers pack."""

from __future__ import annotations

from napari_unpack.simulation import kinds_household, kinds_personal
from napari_unpack.simulation.blueprint import Kind

# The order is part of every seed's bag: kinds are drawn by their place.
KINDS = (
    *kinds_household.KINDS,
    *kinds_personal.KINDS,
    Kind("sweater", None, (0.56, 0.66), 1.2),
    Kind("trousers", None, (0.54, 0.64), 1.0),
    Kind("scarf", None, (0.50, 0.62), 0.7),
)
"""All kinds but coins, which come in pouches."""

BUILDERS = {kind.name: kind.build for kind in (*KINDS, kinds_household.COIN) if kind.build}
"""How each kind is modelled; cloth, which is draped, aside."""
