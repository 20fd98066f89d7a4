"""Phones, cameras, cables and other devices."""

from __future__ import annotations

import numpy as np

from napari_unpack.simulation.blueprint import BACK, FLAT, SIDE, Blueprint, Kind
from napari_unpack.simulation.clay import (
    ACROSS,
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
    ring = 0.42 * L - tube
    clay = Clay()
    clay.start(helix(ring, tube, 2.05 * tube, turns)).paint("PVC")
    clay.paint("copper strands", inset=0.62 * tube)
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


KINDS = (
    Kind("phone", _phone, (0.27, 0.32), 0.9),
    Kind("camera", _camera, (0.28, 0.34), 1.0),
    Kind("cable", _cable, (0.24, 0.30), 1.0),
    Kind("headphones", _headphones, (0.36, 0.42), 0.8),
    Kind("hair dryer", _hair_dryer, (0.42, 0.48), 0.8),
    Kind("torch", _torch, (0.30, 0.36), 0.6),
    Kind("game controller", _game_controller, (0.30, 0.34), 0.6),
)
