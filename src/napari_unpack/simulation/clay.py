"""Modelling of objects: solids are joined, cut and painted into a program that a kernel runs."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.simulation import primitives as solid
from napari_unpack.simulation.materials import MATERIAL_INDEX

ROW = 23
START, JOIN, CUT, CLIP, PAINT, CARVE = 0, 1, 2, 3, 4, 5
PLAIN, KNIT, LAYERS, CRUMPLED, RINGS, ROLLED, GRAINS = 0, 1, 2, 3, 4, 5, 6


@dataclass(frozen=True)
class Solid:
    """A solid of `primitives`: its code, its numbers and half the box that holds it."""

    code: int
    numbers: tuple[float, ...]
    reach: tuple[float, float, float]


def ellipsoid(rz: float, ry: float, rx: float) -> Solid:
    """Return an ellipsoid of three radii."""
    return Solid(solid.ELLIPSOID, (rz, ry, rx), (rz, ry, rx))


def ball(r: float) -> Solid:
    """Return a ball."""
    return ellipsoid(r, r, r)


def box(hz: float, hy: float, hx: float, rounding: float = 0.0) -> Solid:
    """Return a box of three half edges, its corners rounded off."""
    return Solid(solid.BOX, (hz, hy, hx, min(rounding, hz, hy, hx)), (hz, hy, hx))


def cylinder(r: float, half: float, rounding: float = 0.0) -> Solid:
    """Return a cylinder along x."""
    return Solid(solid.CYLINDER, (r, half, min(rounding, r, half)), (r, r, half))


def round_cone(r1: float, r2: float, half: float) -> Solid:
    """Return two balls along x and what spans them; a capsule where the radii are one."""
    r = max(r1, r2)
    return Solid(solid.ROUND_CONE, (r1, r2, half), (r, r, half + r))


def arc(
    ring: float, tube: float, half_angle: float = np.pi, taper: float = 0.0, flat: float = 1.0
) -> Solid:
    """Return a piece of a ring that lies in z and x, centred on +x; thinner to its ends."""
    reach = ring + tube
    numbers = (ring, tube, min(half_angle, np.pi), taper, flat)
    return Solid(solid.ARC, numbers, (reach, tube / flat, reach))


def helix(ring: float, tube: float, pitch: float, turns: float) -> Solid:
    """Return a coil about y."""
    reach = ring + tube
    return Solid(solid.HELIX, (ring, tube, pitch, turns), (reach, turns * pitch / 2 + tube, reach))


def slab(normal: ArrayLike) -> Solid:
    """Return the half-space below a plane through the solid's origin; for cutting only."""
    z, y, x = np.asarray(normal, dtype=np.float64) / np.linalg.norm(normal)
    return Solid(solid.SLAB, (float(z), float(y), float(x)), (0.0, 0.0, 0.0))


def sole(r1: float, r2: float, half: float, height: float, rounding: float = 0.0) -> Solid:
    """Return two circles in z and x and what spans them, `height` to both sides along y."""
    r = max(r1, r2)
    numbers = (r1, r2, half, height, min(rounding, height))
    return Solid(solid.SOLE, numbers, (r, height, half + r))


def bristles(hz: float, hx: float, pitch: float, r: float, half: float) -> Solid:
    """Return upright pins on a grid."""
    return Solid(solid.BRISTLES, (hz, hx, pitch, r, half), (hz + r, half + r, hx + r))


def pleats(r1: float, r2: float, half: float, folds: int, depth: float) -> Solid:
    """Return a pleated cone along x."""
    r = max(r1, r2) + depth
    return Solid(solid.PLEATS, (r1, r2, half, float(folds), depth), (r, r, half))


def ribs(r: float, half: float, rounding: float, pitch: float, depth: float) -> Solid:
    """Return a cylinder along x with hoops round it."""
    reach = r + depth
    return Solid(solid.RIBS, (r, half, rounding, pitch, depth), (reach, reach, half))


def loft(
    near: tuple[float, float], far: tuple[float, float], half: float, rounding: float = 0.0
) -> Solid:
    """Return what spans an ellipse (rz, ry) at -x and another at +x."""
    reach = (max(near[0], far[0]), max(near[1], far[1]), half)
    return Solid(solid.LOFT, (*near, *far, half, rounding), reach)


def turned(axis: str, degrees: float) -> NDArray[np.float64]:
    """Return the rotation about z, y or x that carries the next axis towards the one after."""
    first, second = {"z": (1, 2), "y": (2, 0), "x": (0, 1)}[axis]
    angle = np.radians(degrees)
    matrix = np.eye(3)
    matrix[first, first] = matrix[second, second] = np.cos(angle)
    matrix[second, first] = np.sin(angle)
    matrix[first, second] = -np.sin(angle)
    return matrix


Turn = NDArray[np.float64] | None
STANDING = turned("z", 90.0)
"""Turns a solid whose axis is x to stand along y."""
ACROSS = turned("y", 90.0)
"""Turns a solid whose axis is x to lie along z."""


@dataclass
class Clay:
    """A lump in the making, and the program written so far.

    The lump is what was last started, joined, cut and clipped; `paint` gives it a material and
    adds it to the object, later paint covering earlier. The frame is z, y, x in mm, y down.
    """

    rows: list[NDArray[np.float64]] = field(default_factory=list)
    lower: NDArray[np.float64] = field(default_factory=lambda: np.full(3, np.inf))
    upper: NDArray[np.float64] = field(default_factory=lambda: np.full(3, -np.inf))

    def start(self, form: Solid, at: ArrayLike = (0, 0, 0), turn: Turn = None) -> Clay:
        """Begin a new lump with a solid at a place, turned."""
        return self._shape(START, form, at, turn, 0.0)

    def join(
        self, form: Solid, at: ArrayLike = (0, 0, 0), turn: Turn = None, soft: float = 0.0
    ) -> Clay:
        """Join a solid to the lump, with a fillet of `soft` mm."""
        return self._shape(JOIN, form, at, turn, soft)

    def cut(
        self, form: Solid, at: ArrayLike = (0, 0, 0), turn: Turn = None, soft: float = 0.0
    ) -> Clay:
        """Take a solid away from the lump."""
        return self._shape(CUT, form, at, turn, soft)

    def clip(
        self, form: Solid, at: ArrayLike = (0, 0, 0), turn: Turn = None, soft: float = 0.0
    ) -> Clay:
        """Keep what the lump and a solid share."""
        return self._shape(CLIP, form, at, turn, soft)

    def paint(
        self,
        material: str,
        inset: float = 0.0,
        fill: float = 1.0,
        texture: int = PLAIN,
        grain: float = 3.0,
        depth: float = 0.2,
    ) -> Clay:
        """Give the lump a material.

        Parameters
        ----------
        material : str
            A name of `MATERIALS`.
        inset : float
            Paint only what lies deeper than this, mm: the inside of a wall.
        fill : float
            Share of the painted volume that is filled, from below; what is above stays.
        texture : int
            PLAIN, KNIT, LAYERS (sheets along y), CRUMPLED, RINGS (about x), ROLLED (a spiral
            about x) or GRAINS.
        grain : float
            Period of the texture, mm.
        depth : float
            Amplitude of the texture, a share of the density.
        """
        row = np.zeros(ROW)
        row[0] = PAINT
        row[1:7] = MATERIAL_INDEX[material], inset, fill, texture, grain, depth
        self.rows.append(row)
        return self

    def carve(self, inset: float = 0.0) -> Clay:
        """Empty the lump: air that does not belong to the object."""
        row = np.zeros(ROW)
        row[0] = CARVE
        row[1:3] = MATERIAL_INDEX["air"], inset
        self.rows.append(row)
        return self

    def program(self) -> NDArray[np.float64]:
        """Return the rows written so far, (N, ROW) float64."""
        program = np.array(self.rows)
        shaping = program[:, 0] <= CLIP
        starts = np.flatnonzero(program[:, 0] == START)
        for first, last in zip(starts, [*starts[1:], len(program)], strict=True):
            group = program[first:last]
            program[first, 22] = 2.0 * group[shaping[first:last], 2].max()
        return program

    def _shape(self, verb: int, form: Solid, at: ArrayLike, turn: Turn, soft: float) -> Clay:
        rotation = np.eye(3) if turn is None else np.asarray(turn, dtype=np.float64)
        place = np.asarray(at, dtype=np.float64)
        row = np.zeros(ROW)
        row[0], row[1], row[2] = verb, form.code, soft
        row[3:6] = place
        row[6:15] = rotation.T.ravel()
        row[15 : 15 + len(form.numbers)] = form.numbers
        row[21] = np.linalg.norm(form.reach) if form.code != solid.SLAB else np.inf
        self.rows.append(row)
        if verb in (START, JOIN):
            for signs in product((-1.0, 1.0), repeat=3):
                corner = place + rotation @ (np.array(signs) * form.reach)
                np.minimum(self.lower, corner, out=self.lower)
                np.maximum(self.upper, corner, out=self.upper)
        return self
