"""Bottles, tins, tubes, mugs, boxes and pouches.

Every builder takes a random generator, the object's longest extent L in mm and the thinnest wall
that the scanner resolves, and models the object lying along x, its face upwards (-y).
"""

from __future__ import annotations

import numpy as np

from napari_unpack.simulation.blueprint import (
    BACK,
    FLAT,
    SIDE,
    UPRIGHT,
    Blueprint,
    Kind,
)
from napari_unpack.simulation.clay import (
    CRUMPLED,
    GRAINS,
    KNIT,
    STANDING,
    Clay,
    arc,
    ball,
    box,
    cylinder,
    ellipsoid,
    loft,
    ribs,
    round_cone,
    turned,
)


def _bottle(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a bottle: body, shoulder, neck and screw cap, part full."""
    if rng.random() < 0.4:
        return _flask(rng, L, wall)
    r = L * rng.uniform(0.135, 0.16)
    glass = rng.random() < 0.3
    drink = "ethanol" if glass else "water"
    clay = Clay()
    clay.start(cylinder(r, 0.29 * L, 0.05 * L), (0, 0, 0.21 * L))
    clay.join(
        loft((0.05 * L, 0.05 * L), (r * 0.97, r * 0.97), 0.11 * L), (0, 0, -0.15 * L), soft=0.06 * L
    )
    clay.join(cylinder(0.052 * L, 0.1 * L), (0, 0, -0.34 * L), soft=0.02 * L)
    if not glass:
        for x in (0.08, 0.2, 0.32):
            clay.cut(arc(r + 0.012 * L, 0.026 * L), (0, 0, x * L), STANDING, soft=0.02 * L)
        clay.cut(ball(0.1 * L), (0, 0, 0.565 * L), soft=0.02 * L)
    clay.paint("glass" if glass else "PET").paint("air", inset=wall)
    clay.paint(drink, inset=wall, fill=rng.uniform(0.55, 0.85))
    clay.start(ribs(0.068 * L, 0.055 * L, 0.012 * L, 0.03 * L, 0.004 * L), (0, 0, -0.44 * L))
    clay.join(cylinder(0.078 * L, 0.01 * L, 0.004 * L), (0, 0, -0.365 * L))
    clay.paint("polypropylene")
    name = "wine bottle" if glass else "water bottle"
    return Blueprint("bottle", name, drink, clay, (FLAT,))


def _flask(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    # A shampoo bottle: an oval body and a broad flip cap.
    rz, ry = L * rng.uniform(0.2, 0.24), L * rng.uniform(0.11, 0.13)
    clay = Clay()
    clay.start(loft((rz * 0.8, ry * 0.9), (rz, ry), 0.34 * L, 0.06 * L), (0, 0, 0.16 * L))
    clay.join(cylinder(0.06 * L, 0.06 * L), (0, 0, -0.2 * L), soft=0.05 * L)
    clay.paint("polyethylene").paint("air", inset=wall)
    clay.paint("cosmetic", inset=wall, fill=rng.uniform(0.6, 0.9))
    clay.start(
        loft((0.1 * L, 0.085 * L), (0.125 * L, 0.1 * L), 0.13 * L, 0.03 * L), (0, 0, -0.37 * L)
    )
    clay.cut(arc(0.125 * L, 0.016 * L), (0, 0, -0.36 * L), STANDING)
    clay.paint("polypropylene")
    return Blueprint("bottle", "shampoo bottle", "cosmetic", clay, (FLAT, SIDE))


def _spray_can(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model an aerosol can: a seamed cylinder, a dome and a nozzle cap."""
    r = L * rng.uniform(0.13, 0.15)
    clay = Clay()
    clay.start(cylinder(r, 0.35 * L, 0.01 * L), (0, 0, 0.15 * L))
    clay.join(ellipsoid(r * 0.96, r * 0.96, 0.1 * L), (0, 0, -0.2 * L))
    clay.cut(ellipsoid(r * 0.75, r * 0.75, 0.05 * L), (0, 0, 0.5 * L))
    clay.paint("aluminium").paint("air", inset=wall)
    clay.paint("ethanol", inset=wall, fill=rng.uniform(0.4, 0.75))
    for x in (-0.19, 0.475):
        clay.start(arc(r, 0.018 * L), (0, 0, x * L), STANDING).paint("aluminium")
    clay.start(cylinder(0.075 * L, 0.09 * L, 0.03 * L), (0, 0, -0.37 * L))
    clay.join(cylinder(0.04 * L, 0.04 * L, 0.015 * L), (0, 0, -0.46 * L))
    clay.cut(ball(0.025 * L), (0, -0.05 * L, -0.45 * L))
    clay.paint("polypropylene")
    return Blueprint("spray can", "spray can", "ethanol", clay, (FLAT,))


def _tin(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a food tin: hooped and round, or flat with a pull ring."""
    clay = Clay()
    if rng.random() < 0.4:
        clay.start(box(0.34 * L, 0.11 * L, 0.5 * L, 0.1 * L))
        clay.cut(box(0.28 * L, 0.05 * L, 0.43 * L, 0.04 * L), (0, -0.13 * L, 0))
        clay.paint("steel sheet").paint("food", inset=wall, texture=GRAINS, grain=6, depth=0.08)
        clay.start(arc(0.085 * L, 0.022 * L, flat=1.4), (0, -0.1 * L, 0.24 * L))
        clay.join(box(0.03 * L, 0.02 * L, 0.06 * L), (0, -0.09 * L, 0.36 * L))
        clay.paint("steel sheet")
        return Blueprint("tin", "sardine tin", "food", clay, (FLAT,))
    r = L * rng.uniform(0.36, 0.42)
    clay.start(ribs(r, 0.47 * L, 0.02 * L, 0.12 * L, 0.007 * L))
    for x in (-0.46, 0.46):
        clay.join(arc(r, 0.035 * L), (0, 0, x * L), STANDING)
        clay.cut(cylinder(r * 0.9, 0.04 * L), (0, 0, np.sign(x) * 0.48 * L))
    clay.paint("steel sheet").paint("food", inset=wall, texture=GRAINS, grain=7, depth=0.08)
    return Blueprint("tin", "food tin", "food", clay, (FLAT, UPRIGHT))


def _mug(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a mug with a handle, open and empty."""
    r = L * rng.uniform(0.33, 0.36)
    half, rim = 0.42 * L, max(0.045 * L, wall)
    clay = Clay()
    clay.start(arc(0.22 * L, max(0.05 * L, wall), np.pi, flat=1.0), (0.3 * L, 0, 0))
    clay.cut(cylinder(r - rim, half * 2))
    clay.join(cylinder(r, half, 0.03 * L), soft=0.03 * L).paint("ceramic")
    clay.start(cylinder(r - rim, half, 0.06 * L), (0, 0, -rim * 1.4)).carve()
    return Blueprint("mug", "mug", "ceramic", clay, (turned("x", 35.0), FLAT, UPRIGHT))


def _tube(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a toothpaste tube: round at the cap, pressed flat at the end."""
    r = 0.13 * L
    clay = Clay()
    clay.start(loft((r, r), (0.2 * L, 0.022 * L), 0.36 * L, 0.01 * L), (0, 0, 0.12 * L))
    clay.join(box(0.2 * L, 0.022 * L, 0.03 * L), (0, 0, 0.47 * L))
    clay.join(loft((0.05 * L, 0.05 * L), (r, r), 0.05 * L), (0, 0, -0.27 * L))
    clay.paint("polyethylene").paint("cosmetic", inset=wall)
    clay.start(ribs(0.075 * L, 0.1 * L, 0.02 * L, 0.03 * L, 0.006 * L), (0, 0, -0.4 * L))
    clay.paint("polypropylene")
    return Blueprint("tube", "toothpaste tube", "cosmetic", clay, (FLAT, BACK))


def _pill_box(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a jar of tablets with a ribbed lid."""
    clay = Clay()
    r = 0.3 * L
    clay.start(cylinder(r, 0.36 * L, 0.06 * L), (0, 0, 0.14 * L))
    clay.paint("polyethylene").paint("air", inset=wall)
    clay.paint("sugar", inset=wall, fill=0.7, texture=GRAINS, grain=5, depth=0.5)
    clay.start(ribs(r * 1.05, 0.14 * L, 0.03 * L, 0.05 * L, 0.012 * L), (0, 0, -0.36 * L))
    clay.paint("polypropylene")
    return Blueprint("jar", "pill jar", "sugar", clay, (FLAT, UPRIGHT))


def _carton(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a taped cardboard box, full of tea or with room for separate things."""
    hz, hy, hx = L * rng.uniform(0.3, 0.38), L * rng.uniform(0.17, 0.24), 0.5 * L
    thick = max(1.2 * wall, 0.018 * L)
    roomy = rng.random() < 0.75
    clay = Clay()
    clay.start(box(hz, hy, hx, 0.01 * L))
    clay.cut(box(0.008 * L, 0.012 * L, hx), (0, -hy, 0))
    clay.paint("cardboard")
    if roomy:
        clay.paint("air", inset=thick)
    else:
        clay.paint("tea", inset=thick, texture=CRUMPLED, grain=8, depth=0.25)
    for x in (-0.5, 0.5):
        clay.start(box(0.05 * L, 0.11 * L, 0.012 * L), (0, -hy + 0.1 * L, x * L))
        clay.paint("polypropylene")
    clay.start(box(0.05 * L, max(0.01 * L, 0.5 * wall), hx), (0, -hy, 0)).paint("polypropylene")
    room = (hz - thick, hy - thick, hx - thick) if roomy else None
    name = "carton" if roomy else "box of tea"
    material = "cardboard" if roomy else "tea"
    return Blueprint("carton", name, material, clay, (FLAT,), True, room)


def _pouch(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a zipped pouch with room for coins."""
    hz, hy, hx = 0.34 * L, 0.15 * L, 0.5 * L
    thick = 1.3 * wall
    clay = Clay()
    clay.start(box(hz, hy * 0.6, hx, 0.08 * L))
    clay.join(ellipsoid(hz * 0.85, hy, hx * 0.85), soft=0.12 * L)
    clay.paint("leather", texture=KNIT, grain=6, depth=0.05).paint("air", inset=thick)
    clay.start(round_cone(0.022 * L, 0.022 * L, 0.38 * L), (-0.3 * L, -0.06 * L, 0))
    clay.join(box(0.03 * L, 0.015 * L, 0.05 * L), (-0.3 * L, -0.09 * L, 0.3 * L)).paint("ABS")
    clay.start(arc(0.06 * L, 0.018 * L), (-0.3 * L, -0.07 * L, 0.46 * L)).paint("aluminium")
    room = (hz * 0.72, hy * 0.45, hx * 0.78)
    return Blueprint("pouch", "pouch", "leather", clay, (FLAT,), True, room)


def _coin(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a coin with a raised rim."""
    clay = Clay()
    thick = max(0.07 * L, 0.9 * wall)
    clay.start(cylinder(0.5 * L, thick, 0.2 * thick), turn=STANDING).paint("brass")
    for side in (-1, 1):
        dish = cylinder(0.4 * L, 0.35 * thick)
        clay.start(dish, (0, side * thick, 0), STANDING).carve()
    return Blueprint("coin", "coin", "brass", clay, (FLAT,))


def _spectacle_case(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a closed spectacle case with the glasses' lenses seen inside."""
    clay = Clay()
    clay.start(round_cone(0.17 * L, 0.17 * L, 0.33 * L))
    clay.clip(box(0.2 * L, 0.13 * L, 0.6 * L, 0.1 * L), soft=0.05 * L)
    clay.paint("leather").paint("air", inset=1.5 * wall)
    for x in (-0.17, 0.17):
        clay.start(cylinder(0.13 * L, 0.6 * wall), (0, 0.03 * L, x * L), STANDING).paint("glass")
    clay.start(box(0.015 * L, 0.03 * L, 0.3 * L), (-0.12 * L, 0.03 * L, 0)).paint("ABS")
    return Blueprint("case", "spectacle case", "leather", clay, (FLAT, SIDE))


KINDS = (
    Kind("bottle", _bottle, (0.40, 0.50), 1.6),
    Kind("spray can", _spray_can, (0.32, 0.38), 0.9),
    Kind("tin", _tin, (0.20, 0.26), 1.0),
    Kind("mug", _mug, (0.22, 0.26), 0.9),
    Kind("tube", _tube, (0.28, 0.34), 0.8),
    Kind("jar", _pill_box, (0.18, 0.23), 0.5),
    Kind("carton", _carton, (0.34, 0.44), 1.3),
    Kind("pouch", _pouch, (0.26, 0.32), 1.0),
    Kind("case", _spectacle_case, (0.30, 0.34), 0.6),
)
COIN = Kind("coin", _coin, (0.0, 0.0), 0.0)
"""Never packed by itself: `nesting` puts coins into pouches, as large as fit."""
