"""Teddies, dolls, ducks, cars and balls."""

from __future__ import annotations

import numpy as np

from napari_unpack.simulation.blueprint import FLAT, SIDE, Blueprint, Kind
from napari_unpack.simulation.clay import (
    ACROSS,
    CRUMPLED,
    RINGS,
    STANDING,
    Clay,
    arc,
    ball,
    box,
    cylinder,
    ellipsoid,
    loft,
    round_cone,
    turned,
)


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


KINDS = (
    Kind("teddy", _teddy, (0.46, 0.56), 1.1),
    Kind("doll", _doll, (0.44, 0.52), 0.8),
    Kind("duck", _duck, (0.24, 0.28), 0.6),
    Kind("toy car", _toy_car, (0.30, 0.36), 0.9),
    Kind("ball", _sports_ball, (0.26, 0.32), 0.6),
    Kind("top", _stacking_top, (0.20, 0.24), 0.4),
)
