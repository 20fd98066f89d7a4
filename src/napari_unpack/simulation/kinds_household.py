"""Bottles, tins, tubes, mugs, boxes, pouches, soap, candles, books, fruit, brushes, umbrellas."""

from __future__ import annotations

import numpy as np

from napari_unpack.simulation.blueprint import BACK, FLAT, SIDE, UPRIGHT, Blueprint, Kind
from napari_unpack.simulation.clay import (
    CRUMPLED,
    GRAINS,
    KNIT,
    LAYERS,
    RINGS,
    STANDING,
    Clay,
    arc,
    ball,
    box,
    bristles,
    cylinder,
    ellipsoid,
    loft,
    pleats,
    ribs,
    round_cone,
    sole,
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
        # Glass cannot be pressed into grip rings; plastic bottles have them.
        for x in (0.08, 0.2, 0.32):
            clay.cut(arc(r + 0.012 * L, 0.026 * L), (0, 0, x * L), STANDING, soft=0.02 * L)
        clay.cut(ball(0.1 * L), (0, 0, 0.565 * L), soft=0.02 * L)
    # Air first, drink over it up to its level: later paint covers earlier.
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
    # The seams stand out from the body, as on every can.
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
    # A rim thinner than the thinnest wall would break into holes on the grid.
    half, rim = 0.42 * L, max(0.045 * L, wall)
    clay = Clay()
    clay.start(arc(0.22 * L, max(0.05 * L, wall), np.pi, flat=1.0), (0.3 * L, 0, 0))
    # Before the body is joined: the handle may not reach into the hollow.
    clay.cut(cylinder(r - rim, half * 2))
    clay.join(cylinder(r, half, 0.03 * L), soft=0.03 * L).paint("ceramic")
    # Carved, not painted with air: an open hollow is not the mug's, other things may lie in it.
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
    # Coins in a pouch are small against the voxels: thinner ones would vanish.
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


def _soap(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a bar of soap: pillowed, dished and stamped."""
    hz, hy = L * rng.uniform(0.3, 0.35), L * rng.uniform(0.16, 0.2)
    clay = Clay()
    clay.start(box(hz, hy, 0.5 * L, 0.95 * hy))
    for side in (-1, 1):
        clay.cut(ellipsoid(0.8 * hz, 0.4 * hy, 0.37 * L), (0, side * 1.08 * hy, 0), soft=0.05 * L)
    clay.join(round_cone(0.04 * L, 0.04 * L, 0.16 * L), (0, -0.82 * hy, 0), soft=0.03 * L)
    clay.paint("soap")
    return Blueprint("soap", "bar of soap", "soap", clay, (FLAT, SIDE))


def _candle(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a candle with a wick: a taper or a pillar."""
    clay = Clay()
    if rng.random() < 0.5:
        r = L * rng.uniform(0.085, 0.1)
        clay.start(loft((0.75 * r, 0.75 * r), (r, r), 0.44 * L, 0.03 * L), (0, 0, 0.06 * L))
        clay.join(ellipsoid(0.6 * r, 0.6 * r, 0.07 * L), (0, 0, -0.36 * L), soft=0.03 * L)
        clay.join(arc(r, 0.02 * L), (0, 0, 0.44 * L), STANDING, soft=0.02 * L)
        wick, tip = 0.35, -0.5
    else:
        r = L * rng.uniform(0.26, 0.3)
        clay.start(cylinder(r, 0.42 * L, 0.04 * L), (0, 0, 0.08 * L))
        clay.cut(ellipsoid(0.75 * r, 0.75 * r, 0.1 * L), (0, 0, -0.36 * L), soft=0.04 * L)
        wick, tip = 0.3, -0.48
    clay.paint("wax")
    half = (wick - tip) / 2 * L
    thick = max(0.016 * L, 0.7 * wall)
    clay.start(round_cone(thick, thick, half - thick), (0, 0, tip * L + half)).paint("cotton")
    return Blueprint("candle", "candle", "wax", clay, (FLAT, UPRIGHT))


def _book(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a hardback: two boards, a round spine and a block of pages set back."""
    hz, hy, hx = L * rng.uniform(0.33, 0.38), L * rng.uniform(0.06, 0.11), 0.5 * L
    board = max(0.7 * wall, 0.009 * L)
    clay = Clay()
    for side in (-1, 1):
        clay.start(box(hz, board, hx, 0.4 * board), (0, side * (hy - board), 0))
        clay.cut(round_cone(board, board, hx), (-hz + 0.07 * L, side * hy, 0))
        clay.paint("cardboard")
    clay.start(cylinder(1.25 * hy, hx), (-hz + 0.75 * hy, 0, 0))
    # Only the outer strip of the cylinder is the spine.
    clay.clip(box(0.45 * hy, hy, hx), (-hz + 0.05 * hy, 0, 0)).paint("cardboard")
    inset = 0.028 * L
    clay.start(box(hz - inset, hy - 2 * board + 0.2 * wall, hx - inset), (inset * 0.4, 0, 0))
    clay.cut(cylinder(2.2 * hy, hx), (hz + 1.55 * hy, 0, 0))
    clay.paint("paper", texture=LAYERS, grain=max(2.2 * wall, 0.02 * L), depth=0.12)
    clay.start(box(0.05 * L, 0.4 * board, 0.2 * L), (-0.08 * L, -hy, 0)).paint("PVC")
    return Blueprint("book", "book", "paper", clay, (FLAT, BACK))


def _banana(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a banana."""
    ring, half = 0.42 * L, np.radians(66)
    clay = Clay()
    clay.start(arc(ring, 0.105 * L, half, 0.62), (0, 0, -ring))
    for side in (-1, 1):
        z, x = side * ring * np.sin(half), ring * (np.cos(half) - 1.0)
        r = 0.03 * L if side > 0 else 0.022 * L
        clay.join(round_cone(r, r, 0.05 * L), (z, 0, x), turned("y", -24.0 * side), soft=0.05 * L)
    clay.paint("fruit").paint("food", inset=0.03 * L)
    return Blueprint("banana", "banana", "fruit", clay, (FLAT, BACK))


def _apple(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model an apple with its hollow, stem and core."""
    r = 0.43 * L
    clay = Clay()
    clay.start(ball(r)).join(ball(0.62 * r), (0, -0.3 * r, 0), soft=0.4 * r)
    clay.cut(round_cone(0.02 * L, 0.16 * r, 0.2 * r), (0, -0.92 * r, 0), STANDING, soft=0.35 * r)
    clay.cut(ball(0.12 * r), (0, 1.02 * r, 0), soft=0.2 * r)
    clay.paint("fruit")
    # The core is a closed hollow, so it belongs to the apple.
    clay.start(ellipsoid(0.16 * r, 0.3 * r, 0.16 * r)).paint("air")
    stem = max(0.03 * L, 0.7 * wall)
    clay.start(round_cone(stem, stem, 0.14 * L), (0, -0.9 * r, 0), STANDING).paint("wood")
    return Blueprint("apple", "apple", "fruit", clay, (FLAT, SIDE))


def _hairbrush(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a paddle brush, bristles up."""
    pin = max(0.011 * L, 0.55 * wall)
    clay = Clay()
    clay.start(sole(0.13 * L, 0.11 * L, 0.12 * L, 0.028 * L, 0.02 * L), (0, 0.03 * L, -0.25 * L))
    clay.join(round_cone(0.035 * L, 0.045 * L, 0.26 * L), (0, 0.03 * L, 0.2 * L), soft=0.06 * L)
    clay.cut(ball(0.02 * L), (0, 0.03 * L, 0.45 * L))
    clay.paint("wood", texture=RINGS, grain=6, depth=0.12)
    clay.start(ellipsoid(0.1 * L, 0.035 * L, 0.19 * L), (0, 0.0, -0.25 * L)).paint("rubber")
    # The clip makes an oval field of a square grid of pins.
    clay.start(bristles(0.085 * L, 0.16 * L, 0.042 * L, pin, 0.07 * L), (0, -0.045 * L, -0.25 * L))
    clay.clip(ellipsoid(0.095 * L, 0.3 * L, 0.18 * L), (0, 0, -0.25 * L)).paint("nylon")
    return Blueprint("hairbrush", "hairbrush", "wood", clay, (FLAT, SIDE))


def _umbrella(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a folded umbrella with a hooked handle."""
    rod = max(0.011 * L, 0.6 * wall)
    folds = int(rng.integers(7, 9))
    clay = Clay()
    clay.start(pleats(0.035 * L, 0.115 * L, 0.31 * L, folds, 0.036 * L), (0, 0, -0.1 * L))
    clay.paint("nylon", texture=RINGS, grain=5, depth=0.3)
    clay.start(arc(0.088 * L, 0.018 * L), (0, 0, 0.05 * L), STANDING).paint("leather")
    clay.start(cylinder(rod, 0.4 * L), (0, 0, -0.08 * L)).paint("steel sheet")
    clay.start(round_cone(0.014 * L, 0.02 * L, 0.05 * L), (0, 0, -0.44 * L)).paint("ABS")
    clay.start(arc(0.075 * L, 0.026 * L, np.pi / 2), (0.075 * L, 0, 0.39 * L))
    clay.join(cylinder(0.026 * L, 0.07 * L), (0, 0, 0.32 * L))
    clay.join(ball(0.028 * L), (0.15 * L, 0, 0.385 * L))
    clay.paint("wood")
    return Blueprint("umbrella", "umbrella", "nylon", clay, (FLAT, BACK))


KINDS = (
    # Extents are shares of the bag's, so that a bag of any size holds the same things.
    Kind("bottle", _bottle, (0.40, 0.50), 1.6),
    Kind("spray can", _spray_can, (0.32, 0.38), 0.9),
    Kind("tin", _tin, (0.20, 0.26), 1.0),
    Kind("mug", _mug, (0.22, 0.26), 0.9),
    Kind("tube", _tube, (0.28, 0.34), 0.8),
    Kind("jar", _pill_box, (0.18, 0.23), 0.5),
    Kind("carton", _carton, (0.34, 0.44), 1.3),
    Kind("pouch", _pouch, (0.26, 0.32), 1.0),
    Kind("case", _spectacle_case, (0.30, 0.34), 0.6),
    Kind("soap", _soap, (0.18, 0.23), 1.0),
    Kind("candle", _candle, (0.26, 0.36), 1.0),
    Kind("book", _book, (0.38, 0.50), 1.4),
    Kind("banana", _banana, (0.30, 0.36), 0.6),
    Kind("apple", _apple, (0.16, 0.20), 0.6),
    Kind("hairbrush", _hairbrush, (0.40, 0.46), 0.9),
    Kind("umbrella", _umbrella, (0.52, 0.62), 0.9),
)
COIN = Kind("coin", _coin, (0.0, 0.0), 0.0)
"""Never packed by itself: `nesting` puts coins into pouches, as large as fit."""
