"""Phones, cameras, cables, toys, scissors, keys, cutlery, boots, shoes, belts and towels.

Clothes that give way to what they lie on are made in `draping`.
"""

from __future__ import annotations

import numpy as np

from napari_unpack.simulation.blueprint import BACK, FLAT, SIDE, Blueprint, Kind
from napari_unpack.simulation.clay import (
    ACROSS,
    CRUMPLED,
    KNIT,
    RINGS,
    ROLLED,
    STANDING,
    Clay,
    arc,
    ball,
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


def _phone(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a phone, camera side up: case, lenses, battery and board."""
    hz, hy = 0.245 * L, max(0.042 * L, 1.8 * wall)
    clay = Clay()
    clay.start(box(hz, hy, 0.5 * L, 0.05 * L)).paint("ABS")
    clay.start(box(hz - 0.02 * L, 0.35 * hy, 0.47 * L), (0, 0.55 * hy, 0)).paint("glass")
    clay.start(box(0.16 * L, 0.35 * hy, 0.22 * L), (0.03 * L, -0.05 * hy, 0.17 * L))
    clay.paint("battery")
    clay.start(box(0.2 * L, 0.25 * hy, 0.12 * L), (0, -0.1 * hy, -0.26 * L)).paint("circuit board")
    clay.start(box(0.1 * L, 0.03 * L, 0.11 * L, 0.025 * L), (-0.11 * L, -hy, -0.35 * L))
    clay.paint("aluminium")
    for z, x in ((-0.155, -0.4), (-0.155, -0.3), (-0.07, -0.35)):
        # The lenses stand out of the back, which therefore is no flat side to lie on.
        clay.start(cylinder(0.035 * L, 0.022 * L), (z * L, -hy - 0.02 * L, x * L), STANDING)
        clay.paint("glass")
    return Blueprint("phone", "phone", "ABS", clay, (FLAT,))


def _camera(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a camera on its back: body, grip, prism, lens barrel and glass."""
    clay = Clay()
    clay.start(box(0.3 * L, 0.14 * L, 0.5 * L, 0.06 * L), (0.04 * L, 0.1 * L, 0))
    clay.join(box(0.1 * L, 0.12 * L, 0.16 * L, 0.05 * L), (-0.27 * L, 0.08 * L, 0), soft=0.05 * L)
    clay.join(
        round_cone(0.09 * L, 0.09 * L, 0.16 * L),
        (0.06 * L, -0.03 * L, -0.4 * L),
        ACROSS,
        soft=0.05 * L,
    )
    clay.paint("ABS").paint("air", inset=1.6 * wall)
    clay.start(box(0.2 * L, 0.09 * L, 0.07 * L), (0.05 * L, 0.07 * L, -0.37 * L)).paint("battery")
    clay.start(box(0.22 * L, 0.7 * wall, 0.3 * L), (0.06 * L, 0.17 * L, 0.1 * L))
    clay.paint("circuit board")
    clay.start(cylinder(0.055 * L, 0.03 * L, 0.01 * L), (-0.27 * L, 0.1 * L, -0.33 * L), ACROSS)
    clay.join(cylinder(0.07 * L, 0.035 * L, 0.01 * L), (-0.27 * L, 0.1 * L, 0.34 * L), ACROSS)
    clay.paint("aluminium")
    # It points up: the camera lies on its back.
    barrel = turned("z", 90.0)
    clay.start(
        ribs(0.225 * L, 0.17 * L, 0.02 * L, 0.09 * L, 0.012 * L),
        (0.05 * L, -0.15 * L, 0.04 * L),
        barrel,
    )
    clay.cut(cylinder(0.17 * L, 0.06 * L), (0.05 * L, -0.32 * L, 0.04 * L), barrel)
    clay.paint("aluminium").paint("air", inset=2.0 * wall)
    for y in (-0.23, -0.08):
        clay.start(ellipsoid(0.16 * L, 0.035 * L, 0.16 * L), (0.05 * L, y * L, 0.04 * L))
        clay.paint("glass")
    return Blueprint("camera", "camera", "ABS", clay, (FLAT,))


def _cable(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a coiled cable with a tie and a plug."""
    tube, turns = max(0.034 * L, 1.3 * wall), float(rng.integers(3, 6))
    # The tube included, the coil is as wide as was asked for.
    ring = 0.42 * L - tube
    clay = Clay()
    clay.start(helix(ring, tube, 2.05 * tube, turns)).paint("PVC")
    # Copper inside plastic: dense core, soft rim, which segmentation must keep together.
    clay.paint("copper strands", inset=0.62 * tube)
    # The tie goes round all turns, so that the coil is one piece.
    stack = (turns + 1) * tube
    clay.start(box(0.05 * L, stack + 0.6 * tube, 2.2 * tube, 0.6 * tube), (0, 0, ring))
    clay.paint("nylon")
    clay.start(round_cone(tube, tube, 0.1 * L), (0.05 * L, stack * 0.6, -ring), ACROSS).paint("PVC")
    clay.start(box(0.06 * L, 0.05 * L, 0.045 * L, 0.012 * L), (0.17 * L, stack * 0.6, -ring))
    clay.paint("PVC")
    for x in (-0.022, 0.022):
        pin = box(0.04 * L, max(0.008 * L, 0.5 * wall), max(0.006 * L, 0.5 * wall))
        clay.start(pin, (0.27 * L, stack * 0.6, x * L - ring)).paint("brass")
    return Blueprint("cable", "cable", "PVC", clay, (FLAT, BACK))


def _headphones(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model headphones lying flat: a padded band and two cushioned cups."""
    ring, half = 0.38 * L, np.radians(100)
    clay = Clay()
    clay.start(arc(ring, 0.035 * L, half, 0.2, 0.5), (0, 0, 0)).paint("ABS")
    clay.start(arc(ring, 0.05 * L, np.radians(35), 0.3, 0.6), (0, 0, 0)).paint("leather")
    for side in (-1, 1):
        at = (side * 0.39 * L, 0, -0.22 * L)
        clay.start(cylinder(0.17 * L, 0.05 * L, 0.03 * L), at, ACROSS).paint("ABS")
        clay.paint("air", inset=1.5 * wall)
        clay.start(cylinder(0.07 * L, 0.03 * L), at, ACROSS).paint("battery")
        cushion = (side * 0.31 * L, 0, -0.22 * L)
        clay.start(arc(0.12 * L, 0.055 * L), cushion, turned("x", 90.0)).paint("leather")
        clay.paint("foam", inset=1.2 * wall)
    return Blueprint("headphones", "headphones", "ABS", clay, (FLAT,))


def _hair_dryer(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a hair dryer: barrel with nozzle and grille, and a handle."""
    r = 0.17 * L
    clay = Clay()
    clay.start(loft((0.75 * r, 0.75 * r), (r, r), 0.32 * L, 0.03 * L), (-0.22 * L, 0, 0.1 * L))
    clay.join(ball(r), (-0.22 * L, 0, 0.36 * L), soft=0.04 * L)
    clay.join(
        box(0.24 * L, 0.08 * L, 0.085 * L, 0.07 * L),
        (0.1 * L, 0, 0.26 * L),
        turned("y", 12.0),
        soft=0.06 * L,
    )
    clay.paint("ABS").paint("air", inset=1.8 * wall)
    clay.start(
        loft((0.17 * L, 0.06 * L), (0.13 * L, 0.12 * L), 0.09 * L, 0.01 * L),
        (-0.22 * L, 0, -0.31 * L),
    )
    clay.cut(box(0.14 * L, 0.03 * L, 0.1 * L), (-0.22 * L, 0, -0.36 * L)).paint("ABS")
    for ring in (0.1, 0.06, 0.02):
        clay.start(arc(ring * L, 0.014 * L), (-0.22 * L, 0, 0.53 * L), STANDING).paint("ABS")
    clay.start(cylinder(0.08 * L, 0.09 * L), (-0.22 * L, 0, 0.28 * L)).paint("copper strands")
    clay.start(helix(0.075 * L, 0.6 * wall, 0.05 * L, 4), (-0.22 * L, 0, 0.0), STANDING)
    clay.paint("steel sheet")
    clay.start(box(0.03 * L, 0.03 * L, 0.025 * L, 0.01 * L), (0.08 * L, 0, 0.165 * L)).paint("ABS")
    return Blueprint("hair dryer", "hair dryer", "ABS", clay, (FLAT, BACK))


def _torch(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a torch: a knurled body with two batteries and a flared head."""
    r = 0.085 * L
    clay = Clay()
    clay.start(ribs(r, 0.34 * L, 0.02 * L, 0.035 * L, 0.006 * L), (0, 0, 0.16 * L))
    clay.join(loft((0.17 * L, 0.17 * L), (r, r), 0.09 * L), (0, 0, -0.24 * L))
    clay.join(cylinder(0.175 * L, 0.1 * L, 0.02 * L), (0, 0, -0.4 * L))
    clay.cut(cylinder(0.14 * L, 0.03 * L), (0, 0, -0.5 * L))
    clay.paint("aluminium").paint("air", inset=1.3 * wall)
    for x in (0.02, 0.29):
        clay.start(cylinder(r - 1.6 * wall, 0.125 * L, 0.01 * L), (0, 0, x * L)).paint("battery")
    clay.start(cylinder(0.14 * L, 0.02 * L), (0, 0, -0.45 * L)).paint("glass")
    clay.start(box(0.03 * L, 0.02 * L, 0.05 * L, 0.015 * L), (0, -r, 0.1 * L)).paint("rubber")
    return Blueprint("torch", "torch", "aluminium", clay, (FLAT, SIDE))


def _game_controller(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a game controller: two grips, sticks, a cross and buttons."""
    clay = Clay()
    clay.start(box(0.17 * L, 0.09 * L, 0.36 * L, 0.08 * L), (-0.08 * L, 0, 0))
    for side in (-1, 1):
        grip = round_cone(0.12 * L, 0.085 * L, 0.15 * L)
        clay.join(
            grip,
            (0.07 * L, 0.01 * L, side * 0.35 * L),
            turned("y", 90.0 - 20.0 * side),
            soft=0.06 * L,
        )
    clay.paint("ABS").paint("air", inset=1.8 * wall)
    clay.start(box(0.1 * L, 0.6 * wall, 0.28 * L), (-0.08 * L, 0, 0)).paint("circuit board")
    clay.start(box(0.05 * L, 0.03 * L, 0.11 * L), (-0.07 * L, 0.05 * L, 0)).paint("battery")
    for side in (-1, 1):
        clay.start(cylinder(0.035 * L, 0.05 * L), (0.03 * L, -0.09 * L, side * 0.15 * L), STANDING)
        clay.join(
            cylinder(0.06 * L, 0.018 * L, 0.01 * L),
            (0.03 * L, -0.145 * L, side * 0.15 * L),
            STANDING,
        )
        clay.paint("rubber")
    clay.start(box(0.022 * L, 0.03 * L, 0.075 * L), (-0.11 * L, -0.09 * L, -0.29 * L))
    clay.join(box(0.075 * L, 0.03 * L, 0.022 * L), (-0.11 * L, -0.09 * L, -0.29 * L)).paint("ABS")
    for z, x in ((-0.17, 0.29), (-0.05, 0.29), (-0.11, 0.23), (-0.11, 0.35)):
        clay.start(cylinder(0.028 * L, 0.03 * L, 0.01 * L), (z * L, -0.09 * L, x * L), STANDING)
        clay.paint("ABS")
    return Blueprint("game controller", "game controller", "ABS", clay, (FLAT,))


def _teddy(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a teddy bear on its back: ears, muzzle, eyes, paws and soles."""
    spread = rng.uniform(20, 40)
    clay = Clay()
    clay.start(ellipsoid(0.18 * L, 0.155 * L, 0.21 * L), (0, 0, 0.08 * L))
    clay.join(ellipsoid(0.165 * L, 0.145 * L, 0.155 * L), (0, -0.02 * L, -0.25 * L), soft=0.03 * L)
    clay.join(ellipsoid(0.075 * L, 0.07 * L, 0.06 * L), (0, -0.14 * L, -0.22 * L), soft=0.02 * L)
    for side in (-1, 1):
        clay.join(
            ellipsoid(0.07 * L, 0.04 * L, 0.07 * L), (side * 0.14 * L, 0, -0.37 * L), soft=0.015 * L
        )
        clay.cut(
            ellipsoid(0.042 * L, 0.03 * L, 0.042 * L),
            (side * 0.14 * L, -0.04 * L, -0.37 * L),
            soft=0.01 * L,
        )
        arm = round_cone(0.062 * L, 0.075 * L, 0.1 * L)
        turn = turned("y", side * (90.0 - spread)) @ turned("z", 14.0)
        clay.join(arm, (side * 0.25 * L, -0.05 * L, 0.02 * L), turn, soft=0.03 * L)
        leg = round_cone(0.08 * L, 0.085 * L, 0.1 * L)
        turn = turned("y", side * 0.7 * spread)
        clay.join(leg, (side * 0.15 * L, -0.02 * L, 0.3 * L), turn, soft=0.03 * L)
        foot = ellipsoid(0.09 * L, 0.12 * L, 0.065 * L)
        clay.join(foot, (side * 0.18 * L, -0.07 * L, 0.42 * L), soft=0.02 * L)
    # All limbs are one lump before it is painted: the bear is one object, with fillets between.
    clay.paint("plush", texture=CRUMPLED, grain=5, depth=0.18)
    for side in (-1, 1):
        clay.start(ball(0.022 * L), (side * 0.065 * L, -0.145 * L, -0.295 * L)).paint("ABS")
    clay.start(ellipsoid(0.035 * L, 0.025 * L, 0.025 * L), (0, -0.2 * L, -0.24 * L)).paint("ABS")
    for side in (-1, 1):
        bow = round_cone(0.02 * L, 0.05 * L, 0.05 * L)
        clay.start(bow, (side * 0.06 * L, -0.125 * L, -0.1 * L), turned("y", side * 90.0))
        clay.paint("cotton")
    return Blueprint("teddy", "teddy bear", "plush", clay, (FLAT, turned("x", 25.0)))


def _doll(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a doll on its back: hair, face, a flared dress, arms, legs and shoes."""
    clay = Clay()
    clay.start(
        loft((0.075 * L, 0.065 * L), (0.2 * L, 0.1 * L), 0.16 * L, 0.03 * L), (0, 0, 0.04 * L)
    )
    clay.cut(arc(0.2 * L, 0.012 * L, flat=0.8), (0, 0, 0.15 * L), STANDING)
    for side in (-1, 1):
        turn = turned("y", side * rng.uniform(35, 60))
        clay.join(
            ellipsoid(0.055 * L, 0.05 * L, 0.065 * L),
            (side * 0.09 * L, 0, -0.09 * L),
            turn,
            soft=0.02 * L,
        )
    clay.paint("cotton", texture=CRUMPLED, grain=5, depth=0.15)
    clay.start(ellipsoid(0.105 * L, 0.11 * L, 0.12 * L), (0, 0, -0.27 * L))
    clay.join(cylinder(0.04 * L, 0.05 * L), (0, 0, -0.14 * L), soft=0.02 * L)
    clay.join(ball(0.02 * L), (0, -0.115 * L, -0.255 * L), soft=0.01 * L)
    for side in (-1, 1):
        clay.cut(ball(0.02 * L), (side * 0.042 * L, -0.108 * L, -0.285 * L), soft=0.01 * L)
        turn = turned("y", side * rng.uniform(35, 60))
        clay.join(round_cone(0.034 * L, 0.03 * L, 0.1 * L), (side * 0.18 * L, -0.01 * L, 0.0), turn)
        clay.join(
            round_cone(0.042 * L, 0.034 * L, 0.12 * L), (side * 0.07 * L, 0, 0.3 * L), soft=0.01 * L
        )
    clay.paint("PVC").paint("polyethylene", inset=0.6 * wall)
    clay.start(ellipsoid(0.125 * L, 0.115 * L, 0.13 * L), (0, 0.025 * L, -0.3 * L))
    clay.cut(ball(0.13 * L), (0, -0.12 * L, -0.22 * L))
    for side in (-1, 1):
        clay.join(ball(0.05 * L), (side * 0.14 * L, 0.01 * L, -0.3 * L), soft=0.02 * L)
    clay.paint("wool", texture=CRUMPLED, grain=4, depth=0.3)
    for side in (-1, 1):
        shoe = ellipsoid(0.045 * L, 0.075 * L, 0.04 * L)
        clay.start(shoe, (side * 0.07 * L, -0.035 * L, 0.455 * L)).paint("leather")
    return Blueprint("doll", "doll", "PVC", clay, (FLAT, turned("x", 20.0)))


def _duck(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a rubber duck: hollow, with a beak, wings and a tail."""
    clay = Clay()
    clay.start(ellipsoid(0.31 * L, 0.25 * L, 0.4 * L), (0, 0.16 * L, 0.06 * L))
    clay.join(ball(0.23 * L), (0, -0.22 * L, -0.2 * L), soft=0.08 * L)
    clay.join(
        round_cone(0.13 * L, 0.035 * L, 0.11 * L),
        (0, 0.02 * L, 0.4 * L),
        turned("z", 35.0),
        soft=0.1 * L,
    )
    for side in (-1, 1):
        wing = ellipsoid(0.06 * L, 0.13 * L, 0.22 * L)
        clay.join(wing, (side * 0.29 * L, 0.1 * L, 0.12 * L), turned("z", 18.0), soft=0.03 * L)
    # A flat underside, on which it rests.
    clay.cut(box(0.5 * L, 0.1 * L, 0.6 * L), (0, 0.48 * L, 0), soft=0.03 * L)
    clay.paint("PVC").paint("air", inset=1.2 * wall)
    clay.start(ellipsoid(0.13 * L, 0.035 * L, 0.12 * L), (0, -0.19 * L, -0.42 * L))
    clay.join(ellipsoid(0.1 * L, 0.03 * L, 0.09 * L), (0, -0.135 * L, -0.4 * L)).paint("PVC")
    for side in (-1, 1):
        eye = ball(0.04 * L)
        clay.start(eye, (side * 0.13 * L, -0.3 * L, -0.37 * L)).paint("PVC")
    return Blueprint("duck", "rubber duck", "PVC", clay, (FLAT, SIDE))


def _toy_car(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a toy car: body, cabin with window openings, wheels on axles, bumpers."""
    clay = Clay()
    clay.start(box(0.2 * L, 0.085 * L, 0.48 * L, 0.06 * L), (0, 0.03 * L, 0))
    clay.join(
        loft((0.17 * L, 0.15 * L), (0.17 * L, 0.17 * L), 0.25 * L, 0.1 * L),
        (0, -0.04 * L, 0.05 * L),
        soft=0.04 * L,
    )
    for side in (-1, 1):
        for x in (-0.29, 0.29):
            arch = cylinder(0.125 * L, 0.07 * L)
            clay.cut(arch, (side * 0.2 * L, 0.11 * L, x * L), ACROSS)
        for x in (-0.07, 0.16):
            pane = box(0.03 * L, 0.04 * L, 0.085 * L, 0.02 * L)
            clay.cut(pane, (side * 0.165 * L, -0.1 * L, x * L))
    clay.cut(box(0.11 * L, 0.04 * L, 0.02 * L), (0, -0.11 * L, -0.2 * L))
    clay.paint("ABS").paint("air", inset=1.5 * wall)
    for x in (-0.29, 0.29):
        clay.start(cylinder(max(0.018 * L, 0.6 * wall), 0.2 * L), (0, 0.11 * L, x * L), ACROSS)
        clay.paint("steel sheet")
        for side in (-1, 1):
            clay.start(
                cylinder(0.105 * L, 0.045 * L, 0.02 * L), (side * 0.19 * L, 0.11 * L, x * L), ACROSS
            )
            clay.cut(cylinder(0.055 * L, 0.02 * L), (side * 0.235 * L, 0.11 * L, x * L), ACROSS)
            clay.paint("rubber")
    for x in (-0.49, 0.49):
        clay.start(round_cone(0.022 * L, 0.022 * L, 0.17 * L), (0, 0.07 * L, x * L), ACROSS)
        clay.paint("aluminium")
    return Blueprint("toy car", "toy car", "ABS", clay, (FLAT, SIDE))


def _sports_ball(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a ball with the seams of a basketball, full of air."""
    r = 0.49 * L
    seam = 0.03 * L
    clay = Clay()
    clay.start(ball(r))
    clay.cut(arc(r, seam)).cut(arc(r, seam), turn=STANDING)
    for side in (-1, 1):
        clay.cut(arc(0.78 * r, seam), (side * 0.62 * r, 0, 0), turned("x", 90.0))
    clay.paint("rubber").paint("air", inset=1.8 * wall)
    # A ball has no side to lie on: any turn will do, and the seams show it.
    tilt = turned("z", rng.uniform(0, 60)) @ turned("x", rng.uniform(0, 60))
    return Blueprint("ball", "ball", "rubber", clay, (tilt,))


def _stacking_top(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a wooden spinning top."""
    clay = Clay()
    clay.start(ellipsoid(0.4 * L, 0.4 * L, 0.17 * L), (0, 0, 0.02 * L))
    clay.join(round_cone(0.12 * L, 0.02 * L, 0.2 * L), (0, 0, 0.26 * L), soft=0.12 * L)
    clay.join(cylinder(0.045 * L, 0.22 * L, 0.03 * L), (0, 0, -0.28 * L), soft=0.08 * L)
    clay.join(ball(0.07 * L), (0, 0, -0.44 * L))
    clay.cut(arc(0.39 * L, 0.02 * L), (0, 0, 0.02 * L), STANDING)
    clay.paint("wood", texture=RINGS, grain=7, depth=0.15)
    return Blueprint("top", "spinning top", "wood", clay, (turned("z", 24.0),))


def _scissors(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model scissors a little open: two blades, a pivot and two finger rings."""
    opening = rng.uniform(6.0, 16.0)
    thick = max(0.013 * L, 0.75 * wall)
    clay = Clay()
    for side in (-1, 1):
        turn = turned("y", side * opening)
        y = side * thick * 0.9

        # Defaults bind this round's turn: a plain closure would see the last one.
        def place(z: float, x: float, turn: np.ndarray = turn, y: float = y) -> np.ndarray:
            return np.array([0, y, 0.05 * L]) + turn @ np.array([z * L, 0.0, x * L])

        blade = loft((0.006 * L, thick), (0.042 * L, thick), 0.27 * L)
        clay.start(blade, place(-side * 0.02, -0.27), turn)
        clay.join(box(0.035 * L, thick, 0.09 * L, thick), place(0, 0.04), turn)
        clay.paint("steel")
        clay.start(arc(0.09 * L, 0.026 * L), place(side * 0.03, 0.28), turn)
        clay.join(
            round_cone(0.03 * L, 0.026 * L, 0.05 * L),
            place(side * 0.005, 0.15),
            turn,
            soft=0.02 * L,
        )
        clay.paint("ABS")
    clay.start(cylinder(0.026 * L, 2.4 * thick), (0, 0, 0.05 * L), STANDING).paint("steel")
    return Blueprint("scissors", "scissors", "steel", clay, (FLAT, BACK))


def _keys(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model keys on a ring: bows with holes, shafts and bits."""
    thick = max(0.026 * L, 0.75 * wall)
    clay = Clay()
    clay.start(arc(0.15 * L, max(0.022 * L, 0.8 * wall)), (0, 0, -0.34 * L)).paint("steel")
    # Opposite ways and one above the other: keys on a ring fan out, and may not overlap.
    angles = rng.uniform(12, 26) * np.array([-1.0, 1.0])
    for angle, y in zip(angles, (-1.05 * thick, 1.05 * thick), strict=True):
        turn = turned("y", float(angle))

        def place(z: float, x: float, turn: np.ndarray = turn, y: float = y) -> np.ndarray:
            return np.array([0, y, -0.34 * L]) + turn @ np.array([z * L, 0.0, x * L])

        clay.start(sole(0.13 * L, 0.11 * L, 0.03 * L, thick, 0.4 * thick), place(0, 0.25), turn)
        clay.cut(cylinder(0.045 * L, 3 * thick), place(0, 0.165), STANDING)
        clay.join(box(0.04 * L, thick, 0.24 * L, 0.3 * thick), place(0, 0.57), turn)
        for x, depth in ((0.5, 0.045), (0.6, 0.07), (0.7, 0.05), (0.78, 0.075)):
            clay.join(box(depth * L, thick, 0.025 * L), place(depth, x), turn)
        clay.paint("brass")
    return Blueprint("keys", "bunch of keys", "brass", clay, (FLAT,))


def _cutlery(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a spoon or a fork."""
    thick = max(0.012 * L, 0.8 * wall)
    clay = Clay()
    handle = loft((0.018 * L, thick), (0.05 * L, thick), 0.33 * L, 0.3 * thick)
    if rng.random() < 0.5:
        clay.start(ellipsoid(0.095 * L, 0.06 * L, 0.15 * L), (0, -0.01 * L, -0.34 * L))
        # The same shape, shifted: a bowl of even thickness.
        clay.cut(ellipsoid(0.095 * L, 0.06 * L, 0.15 * L), (0, -0.01 * L - 2 * thick, -0.34 * L))
        clay.clip(box(0.2 * L, 0.05 * L, 0.3 * L), (0, 0.03 * L, -0.34 * L))
        name = "spoon"
    else:
        clay.start(sole(0.05 * L, 0.085 * L, 0.03 * L, thick), (0, 0, -0.2 * L), turned("y", 180.0))
        for z in (-0.07, -0.023, 0.023, 0.07):
            tine = round_cone(thick, 0.016 * L, 0.1 * L)
            clay.join(tine, (z * L, -0.01 * L, -0.38 * L), turned("z", -6.0))
        name = "fork"
    clay.join(handle, (0, 0, 0.12 * L), soft=0.02 * L)
    clay.join(cylinder(0.05 * L, thick), (0, 0, 0.44 * L), STANDING)
    clay.paint("steel")
    return Blueprint("cutlery", name, "steel", clay, (FLAT, BACK))


def _spanner(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model an open-ended spanner."""
    thick = max(0.025 * L, 0.9 * wall)
    clay = Clay()
    clay.start(box(0.045 * L, thick, 0.36 * L, 0.4 * thick))
    clay.cut(box(0.022 * L, 0.3 * thick, 0.26 * L), (0, -thick, 0))
    clay.join(
        cylinder(0.13 * L, 1.2 * thick, 0.3 * thick), (0, 0, -0.36 * L), STANDING, soft=0.03 * L
    )
    clay.join(
        cylinder(0.1 * L, 1.2 * thick, 0.3 * thick), (0, 0, 0.39 * L), STANDING, soft=0.03 * L
    )
    clay.cut(
        box(0.065 * L, 0.2 * L, 0.1 * L, 0.01 * L), (0.02 * L, 0, -0.45 * L), turned("y", 15.0)
    )
    clay.cut(cylinder(0.055 * L, 0.2 * L), (0, 0, 0.39 * L), STANDING)
    clay.paint("steel")
    return Blueprint("spanner", "spanner", "steel", clay, (FLAT,))


def _clothes_hanger(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a wooden coat hanger with a wire hook."""
    thick = 0.022 * L
    clay = Clay()
    for side in (-1, 1):
        turn = turned("y", side * 72.0)
        arm = round_cone(1.3 * thick, thick, 0.24 * L)
        clay.start(arm, (side * 0.22 * L, 0, 0.12 * L), turn).paint("wood")
    clay.start(round_cone(thick, thick, 0.4 * L), (0, 0, 0.2 * L), ACROSS).paint("wood")
    wire = max(0.011 * L, 0.7 * wall)
    hook = turned("y", 120.0)
    clay.start(arc(0.07 * L, wire, np.radians(125)), (0, 0, -0.17 * L), hook)
    clay.join(cylinder(wire, 0.06 * L), (0, 0, -0.04 * L)).paint("steel")
    return Blueprint("hanger", "coat hanger", "wood", clay, (FLAT,))


def _boot(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model a laced boot, its open shaft empty: welt, heel, tread and laces."""
    # The leather must stay closed where the hollow comes near the surface.
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
    # See the boot: less would open holes between outside and hollow.
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
        # No pitch: the coil marks the end of the roll and does not go into it.
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
            # Joins one ring to the next, or the belt would be three objects.
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
    Kind("phone", _phone, (0.27, 0.32), 0.9),
    Kind("camera", _camera, (0.28, 0.34), 1.0),
    Kind("cable", _cable, (0.24, 0.30), 1.0),
    Kind("headphones", _headphones, (0.36, 0.42), 0.8),
    Kind("hair dryer", _hair_dryer, (0.42, 0.48), 0.8),
    Kind("torch", _torch, (0.30, 0.36), 0.6),
    Kind("game controller", _game_controller, (0.30, 0.34), 0.6),
    Kind("teddy", _teddy, (0.46, 0.56), 1.1),
    Kind("doll", _doll, (0.44, 0.52), 0.8),
    Kind("duck", _duck, (0.24, 0.28), 0.6),
    Kind("toy car", _toy_car, (0.30, 0.36), 0.9),
    Kind("ball", _sports_ball, (0.26, 0.32), 0.6),
    Kind("top", _stacking_top, (0.20, 0.24), 0.4),
    Kind("scissors", _scissors, (0.30, 0.36), 0.9),
    Kind("keys", _keys, (0.24, 0.28), 0.9),
    Kind("cutlery", _cutlery, (0.30, 0.34), 0.9),
    Kind("spanner", _spanner, (0.28, 0.34), 0.5),
    Kind("hanger", _clothes_hanger, (0.48, 0.54), 0.4),
    Kind("boot", _boot, (0.44, 0.50), 1.1),
    Kind("shoe", _shoe, (0.42, 0.48), 1.0),
    Kind("socks", _socks, (0.22, 0.26), 1.0),
    Kind("towel", _rolled_towel, (0.42, 0.50), 0.8),
    Kind("belt", _belt, (0.24, 0.28), 0.6),
)
