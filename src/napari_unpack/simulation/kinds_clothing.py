"""Boots, shoes, rolled socks, belts and towels.

Clothes that give way to what they lie on are made in `draping`.
"""

from __future__ import annotations

import numpy as np

from napari_unpack.simulation.blueprint import FLAT, SIDE, Blueprint, Kind
from napari_unpack.simulation.clay import (
    ACROSS,
    KNIT,
    ROLLED,
    STANDING,
    Clay,
    arc,
    box,
    cylinder,
    ellipsoid,
    helix,
    loft,
    ribs,
    round_cone,
    slab,
    sole,
    turned,
)


def _boot(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a laced boot, its open shaft empty: welt, heel, tread and laces."""
    skin = max(0.028 * L, 1.4 * wall)
    clay = Clay()
    clay.start(round_cone(0.135 * L, 0.12 * L, 0.25 * L), (0, 0.29 * L, 0.03 * L), turned("z", 3.0))
    shaft = loft((0.145 * L, 0.17 * L), (0.15 * L, 0.185 * L), 0.38 * L, 0.01 * L)
    clay.join(shaft, (0, -0.09 * L, -0.2 * L), STANDING, soft=0.14 * L)
    clay.join(ellipsoid(0.13 * L, 0.115 * L, 0.12 * L), (0, 0.3 * L, 0.32 * L), soft=0.03 * L)
    clay.join(arc(0.155 * L, 0.03 * L), (0, -0.45 * L, -0.2 * L), soft=0.02 * L)
    clay.cut(slab((0, -1, 0)), (0, 0.405 * L, 0))
    clay.paint("leather")
    hollow = loft(
        (0.145 * L - skin, 0.17 * L - skin), (0.15 * L - skin, 0.185 * L - skin), 0.44 * L
    )
    clay.start(round_cone(0.135 * L - skin, 0.12 * L - skin, 0.26 * L), (0, 0.285 * L, 0.03 * L))
    clay.join(hollow, (0, -0.16 * L, -0.2 * L), STANDING, soft=0.13 * L)
    clay.cut(slab((0, -1, 0)), (0, 0.39 * L - skin, 0)).carve()
    clay.start(sole(0.125 * L, 0.145 * L, 0.28 * L, 0.025 * L, 0.008 * L), (0, 0.42 * L, 0.04 * L))
    clay.join(sole(0.12 * L, 0.12 * L, 0.05 * L, 0.04 * L), (0, 0.46 * L, -0.22 * L))
    for x in (0.08, 0.15, 0.22, 0.29):
        clay.join(box(0.11 * L, 0.03 * L, 0.02 * L, 0.01 * L), (0, 0.44 * L, x * L))
    clay.paint("rubber")
    for i in range(5):
        y, x = (0.13 - 0.115 * i) * L, (-0.02 + 0.045 * max(0.0, 1 - i / 1.5)) * L
        clay.start(round_cone(0.02 * L, 0.02 * L, 0.075 * L), (0, y, x), ACROSS @ turned("z", 8.0))
        clay.paint("cotton")
    return Blueprint("boot", "boot", "leather", clay, (SIDE, SIDE.T, FLAT))


def _shoe(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a running shoe: thick sole, toe cap, tongue, laces and an open collar."""
    skin = max(0.024 * L, 1.4 * wall)
    clay = Clay()
    clay.start(round_cone(0.14 * L, 0.115 * L, 0.31 * L), (0, 0.0, 0.02 * L), turned("z", 4.0))
    collar = loft((0.1 * L, 0.15 * L), (0.085 * L, 0.12 * L), 0.1 * L, 0.02 * L)
    clay.join(collar, (0, -0.12 * L, -0.24 * L), STANDING @ turned("z", -6.0), soft=0.1 * L)
    clay.join(
        loft((0.06 * L, 0.025 * L), (0.05 * L, 0.02 * L), 0.09 * L, 0.01 * L),
        (0, -0.2 * L, -0.08 * L),
        turned("z", 235.0),
        soft=0.02 * L,
    )
    clay.cut(slab((0, -1, 0)), (0, 0.06 * L, 0)).paint("cotton", texture=KNIT, grain=5, depth=0.15)
    clay.start(round_cone(0.14 * L - skin, 0.115 * L - skin, 0.31 * L), (0, 0, 0.02 * L))
    inner = loft((0.1 * L - skin, 0.15 * L - skin), (0.085 * L - skin, 0.12 * L - skin), 0.16 * L)
    clay.join(inner, (0, -0.16 * L, -0.24 * L), STANDING, soft=0.07 * L)
    clay.cut(slab((0, -1, 0)), (0, 0.05 * L - skin, 0)).carve()
    clay.start(sole(0.13 * L, 0.14 * L, 0.34 * L, 0.035 * L, 0.02 * L), (0, 0.085 * L, 0.01 * L))
    clay.join(sole(0.12 * L, 0.12 * L, 0.1 * L, 0.03 * L), (0, 0.12 * L, -0.24 * L), soft=0.03 * L)
    clay.cut(box(0.3 * L, 0.008 * L, 0.6 * L), (0, 0.165 * L, 0)).paint("rubber")
    for i in range(4):
        x, y = (-0.02 + 0.065 * i) * L, (-0.148 + 0.012 * i) * L
        clay.start(round_cone(0.018 * L, 0.018 * L, 0.065 * L), (0, y, x), ACROSS).paint("nylon")
    return Blueprint("shoe", "running shoe", "rubber", clay, (FLAT, SIDE, SIDE.T))


def _socks(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a pair of socks rolled up, the cuff folded over the roll."""
    r = L * rng.uniform(0.33, 0.38)
    clay = Clay()
    clay.start(ribs(r, 0.44 * L, 0.16 * L, 0.075 * L, 0.005 * L))
    clay.join(box(0.12 * L, 0.09 * L, 0.4 * L, 0.08 * L), (0.6 * r, 0.55 * r, 0), soft=0.06 * L)
    clay.cut(round_cone(0.03 * L, 0.1 * L, 0.1 * L), (0, 0, 0.42 * L), soft=0.05 * L)
    clay.join(arc(0.75 * r, 0.1 * L), (0, 0, -0.36 * L), STANDING, soft=0.05 * L)
    clay.paint("cotton", texture=ROLLED, grain=max(0.13 * L, 3 * wall), depth=0.35)
    return Blueprint("socks", "rolled socks", "cotton", clay, (FLAT,))


def _rolled_towel(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a rolled towel: a spiral of terry cloth and its loose edge."""
    r = L * rng.uniform(0.17, 0.2)
    clay = Clay()
    clay.start(cylinder(r, 0.49 * L, 0.04 * L))
    clay.join(box(0.1 * L, 0.022 * L, 0.48 * L, 0.02 * L), (0.09 * L, 0.94 * r, 0), soft=0.03 * L)
    for x in (-0.2, 0.22):
        clay.cut(arc(1.05 * r, 0.02 * L), (0, 0, x * L), STANDING, soft=0.04 * L)
    for side in (-1, 1):
        coil = helix(0.55 * r, 0.018 * L, 1e-3, 1.0)
        clay.cut(coil, (0, 0, side * 0.49 * L), STANDING)
        clay.cut(arc(0.25 * r, 0.018 * L), (0, 0, side * 0.49 * L), STANDING)
    clay.paint("cotton", texture=ROLLED, grain=max(0.07 * L, 3 * wall), depth=0.4)
    return Blueprint("towel", "rolled towel", "cotton", clay, (FLAT,))


def _belt(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a rolled leather belt with its buckle."""
    thick = max(0.02 * L, wall)
    half = 0.14 * L
    clay = Clay()
    for i in range(3):
        ring = (0.43 - 0.11 * i) * L
        clay.start(cylinder(ring, half, 0.2 * thick), turn=STANDING)
        clay.cut(cylinder(ring - 2 * thick, 2 * half), turn=STANDING)
        clay.paint("leather")
        if i < 2:
            step = box(0.06 * L, half * 0.98, thick)
            clay.start(step, (0.03 * L, 0, ring - 0.065 * L), turned("y", 35.0)).paint("leather")
    clay.start(
        box(0.05 * L + half * 0.6, half * 1.25, 0.02 * L, 0.01 * L), (-0.02 * L, 0, 0.43 * L)
    )
    clay.cut(box(half * 0.6, half * 0.85, 0.1 * L), (-0.02 * L, 0, 0.54 * L))
    clay.join(box(0.012 * L + half * 0.6, 0.02 * L, 0.016 * L), (-0.02 * L, 0, 0.44 * L))
    clay.paint("brass")
    return Blueprint("belt", "rolled belt", "leather", clay, (FLAT,))


KINDS = (
    Kind("boot", _boot, (0.44, 0.50), 1.1),
    Kind("shoe", _shoe, (0.42, 0.48), 1.0),
    Kind("socks", _socks, (0.22, 0.26), 1.0),
    Kind("towel", _rolled_towel, (0.42, 0.50), 0.8),
    Kind("belt", _belt, (0.24, 0.28), 0.6),
)
