"""The kinds of things that travellers pack, how long they are and how often they are met."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from napari_unpack.simulation import (
    kinds_clothing,
    kinds_containers,
    kinds_devices,
    kinds_household,
    kinds_metalware,
    kinds_toys,
)
from napari_unpack.simulation.blueprint import Blueprint

Builder = Callable[[np.random.Generator, float, float], Blueprint]


@dataclass(frozen=True)
class Kind:
    """A kind of object.

    Parameters
    ----------
    name : str
        As it stands in the table of objects.
    build : callable
        Models one of a given length; None for cloth, which is draped.
    lengths : (float, float)
        Longest extent, as a share of the bag's.
    often : float
        How often it is met, against the others.
    """

    name: str
    build: Builder | None
    lengths: tuple[float, float]
    often: float


KINDS = (
    Kind("bottle", kinds_containers.bottle, (0.40, 0.50), 1.6),
    Kind("spray can", kinds_containers.spray_can, (0.32, 0.38), 0.9),
    Kind("tin", kinds_containers.tin, (0.20, 0.26), 1.0),
    Kind("mug", kinds_containers.mug, (0.22, 0.26), 0.9),
    Kind("tube", kinds_containers.tube, (0.28, 0.34), 0.8),
    Kind("jar", kinds_containers.pill_box, (0.18, 0.23), 0.5),
    Kind("carton", kinds_containers.carton, (0.34, 0.44), 1.3),
    Kind("pouch", kinds_containers.pouch, (0.26, 0.32), 1.0),
    Kind("case", kinds_containers.spectacle_case, (0.30, 0.34), 0.6),
    Kind("soap", kinds_household.soap, (0.18, 0.23), 1.0),
    Kind("candle", kinds_household.candle, (0.26, 0.36), 1.0),
    Kind("book", kinds_household.book, (0.38, 0.50), 1.4),
    Kind("banana", kinds_household.banana, (0.30, 0.36), 0.6),
    Kind("apple", kinds_household.apple, (0.16, 0.20), 0.6),
    Kind("hairbrush", kinds_household.hairbrush, (0.40, 0.46), 0.9),
    Kind("umbrella", kinds_household.umbrella, (0.52, 0.62), 0.9),
    Kind("phone", kinds_devices.phone, (0.27, 0.32), 0.9),
    Kind("camera", kinds_devices.camera, (0.28, 0.34), 1.0),
    Kind("cable", kinds_devices.cable, (0.24, 0.30), 1.0),
    Kind("headphones", kinds_devices.headphones, (0.36, 0.42), 0.8),
    Kind("hair dryer", kinds_devices.hair_dryer, (0.42, 0.48), 0.8),
    Kind("torch", kinds_devices.torch, (0.30, 0.36), 0.6),
    Kind("game controller", kinds_devices.game_controller, (0.30, 0.34), 0.6),
    Kind("teddy", kinds_toys.teddy, (0.46, 0.56), 1.1),
    Kind("doll", kinds_toys.doll, (0.44, 0.52), 0.8),
    Kind("duck", kinds_toys.duck, (0.24, 0.28), 0.6),
    Kind("toy car", kinds_toys.toy_car, (0.30, 0.36), 0.9),
    Kind("ball", kinds_toys.sports_ball, (0.26, 0.32), 0.6),
    Kind("top", kinds_toys.stacking_top, (0.20, 0.24), 0.4),
    Kind("scissors", kinds_metalware.scissors, (0.30, 0.36), 0.9),
    Kind("keys", kinds_metalware.keys, (0.24, 0.28), 0.9),
    Kind("cutlery", kinds_metalware.cutlery, (0.30, 0.34), 0.9),
    Kind("spanner", kinds_metalware.spanner, (0.28, 0.34), 0.5),
    Kind("hanger", kinds_metalware.clothes_hanger, (0.48, 0.54), 0.4),
    Kind("boot", kinds_clothing.boot, (0.44, 0.50), 1.1),
    Kind("shoe", kinds_clothing.shoe, (0.42, 0.48), 1.0),
    Kind("socks", kinds_clothing.socks, (0.22, 0.26), 1.0),
    Kind("towel", kinds_clothing.rolled_towel, (0.42, 0.50), 0.8),
    Kind("belt", kinds_clothing.belt, (0.24, 0.28), 0.6),
    Kind("sweater", None, (0.56, 0.66), 1.2),
    Kind("trousers", None, (0.54, 0.64), 1.0),
    Kind("scarf", None, (0.50, 0.62), 0.7),
)
"""All kinds but coins, which come in pouches."""
