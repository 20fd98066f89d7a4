"""Scissors, keys and cutlery."""

from __future__ import annotations

import numpy as np

from napari_unpack.simulation.blueprint import BACK, FLAT, Blueprint, Kind
from napari_unpack.simulation.clay import (
    ACROSS,
    STANDING,
    Clay,
    arc,
    box,
    cylinder,
    ellipsoid,
    loft,
    round_cone,
    sole,
    turned,
)


def _scissors(rng: np.random.Generator, L: float, wall: float) -> Blueprint:
    """Model scissors a little open: two blades, a pivot and two finger rings."""
    opening = rng.uniform(6.0, 16.0)
    thick = max(0.013 * L, 0.75 * wall)
    clay = Clay()
    for side in (-1, 1):
        turn = turned("y", side * opening)
        y = side * thick * 0.9

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


KINDS = (
    Kind("scissors", _scissors, (0.30, 0.36), 0.9),
    Kind("keys", _keys, (0.24, 0.28), 0.9),
    Kind("cutlery", _cutlery, (0.30, 0.34), 0.9),
    Kind("spanner", _spanner, (0.28, 0.34), 0.5),
    Kind("hanger", _clothes_hanger, (0.48, 0.54), 0.4),
)
