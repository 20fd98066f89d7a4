"""Soap, candles, books, fruit, brushes and umbrellas."""

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
    round_cone,
    sole,
    turned,
)


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
    Kind("soap", _soap, (0.18, 0.23), 1.0),
    Kind("candle", _candle, (0.26, 0.36), 1.0),
    Kind("book", _book, (0.38, 0.50), 1.4),
    Kind("banana", _banana, (0.30, 0.36), 0.6),
    Kind("apple", _apple, (0.16, 0.20), 0.6),
    Kind("hairbrush", _hairbrush, (0.40, 0.46), 0.9),
    Kind("umbrella", _umbrella, (0.52, 0.62), 0.9),
)
