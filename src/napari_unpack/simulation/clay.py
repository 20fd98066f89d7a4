"""Modelling of objects: solids are joined, cut and painted into a program that a kernel runs."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.simulation import primitives as solid
from napari_unpack.simulation.materials import MATERIAL_INDEX

ROW = 23
"""Numbers of a step: verb, solid, fillet, place (3), rotation (9), numbers (6), two radii."""
# The order matters: `program` and the kernel tell shaping from painting by `<= CLIP`.
START, JOIN, CUT, CLIP, PAINT, CARVE = 0, 1, 2, 3, 4, 5
PLAIN, KNIT, LAYERS, CRUMPLED, RINGS, ROLLED, GRAINS = 0, 1, 2, 3, 4, 5, 6


@dataclass(frozen=True)
class Solid:
    """A solid of `primitives`.

    Parameters
    ----------
    code : int
        Which solid.
    numbers : tuple of float
        What `primitives.solid_distance` takes for it, mm and radians.
    reach : (float, float, float)
        Half edges of the box that holds it, mm, z y x.
    """

    code: int
    numbers: tuple[float, ...]
    reach: tuple[float, float, float]


def ellipsoid(rz: float, ry: float, rx: float) -> Solid:
    """Return an ellipsoid of three radii.

    Parameters
    ----------
    rz, ry, rx : float
        Radii, mm.
    """
    return Solid(solid.ELLIPSOID, (rz, ry, rx), (rz, ry, rx))


def ball(r: float) -> Solid:
    """Return a ball."""
    return ellipsoid(r, r, r)


def box(hz: float, hy: float, hx: float, rounding: float = 0.0) -> Solid:
    """Return a box of three half edges, its corners rounded off.

    Parameters
    ----------
    hz, hy, hx : float
        Half edges, mm.
    rounding : float
        Radius of the edges, mm.
    """
    # A rounding wider than the box would turn its distance inside out.
    return Solid(solid.BOX, (hz, hy, hx, min(rounding, hz, hy, hx)), (hz, hy, hx))


def cylinder(r: float, half: float, rounding: float = 0.0) -> Solid:
    """Return a cylinder along x.

    Parameters
    ----------
    r, half : float
        Radius and half length, mm.
    rounding : float
        Radius of its rims, mm.
    """
    return Solid(solid.CYLINDER, (r, half, min(rounding, r, half)), (r, r, half))


def round_cone(r1: float, r2: float, half: float) -> Solid:
    """Return two balls along x and what spans them; a capsule where the radii are one.

    Parameters
    ----------
    r1, r2 : float
        Radii of the balls at -x and +x, mm.
    half : float
        Half the distance of their centres, mm.
    """
    r = max(r1, r2)
    return Solid(solid.ROUND_CONE, (r1, r2, half), (r, r, half + r))


def arc(
    ring: float, tube: float, half_angle: float = np.pi, taper: float = 0.0, flat: float = 1.0
) -> Solid:
    """Return a piece of a ring that lies in z and x, centred on +x; thinner to its ends.

    Parameters
    ----------
    ring, tube : float
        Radii of the ring and of its tube, mm.
    half_angle : float
        To both sides of +x, radians.
    taper : float
        Share of the tube that is lost towards the ends.
    flat : float
        How much flatter than wide the tube is, along y.
    """
    reach = ring + tube
    numbers = (ring, tube, min(half_angle, np.pi), taper, flat)
    return Solid(solid.ARC, numbers, (reach, tube / flat, reach))


def helix(ring: float, tube: float, pitch: float, turns: float) -> Solid:
    """Return a coil about y.

    Parameters
    ----------
    ring, tube, pitch : float
        Radii of the coil and of its tube, and the rise of a turn, mm.
    turns : float
        How many turns.
    """
    reach = ring + tube
    return Solid(solid.HELIX, (ring, tube, pitch, turns), (reach, turns * pitch / 2 + tube, reach))


def slab(normal: ArrayLike) -> Solid:
    """Return the half-space below a plane through the solid's origin; for cutting only."""
    z, y, x = np.asarray(normal, dtype=np.float64) / np.linalg.norm(normal)
    # No reach: it is never joined, so it widens no box.
    return Solid(solid.SLAB, (float(z), float(y), float(x)), (0.0, 0.0, 0.0))


def sole(r1: float, r2: float, half: float, height: float, rounding: float = 0.0) -> Solid:
    """Return two circles in z and x and what spans them, `height` to both sides along y.

    Parameters
    ----------
    r1, r2 : float
        Radii of the circles at -x and +x, mm.
    half : float
        Half the distance of their centres, mm.
    height, rounding : float
        Half height, and radius of its edges, mm.
    """
    r = max(r1, r2)
    numbers = (r1, r2, half, height, min(rounding, height))
    return Solid(solid.SOLE, numbers, (r, height, half + r))


def bristles(hz: float, hx: float, pitch: float, r: float, half: float) -> Solid:
    """Return upright pins on a grid.

    Parameters
    ----------
    hz, hx, pitch : float
        Half edges of the grid and distance of its pins, mm.
    r, half : float
        Radius and half length of a pin, mm.
    """
    return Solid(solid.BRISTLES, (hz, hx, pitch, r, half), (hz + r, half + r, hx + r))


def pleats(r1: float, r2: float, half: float, folds: int, depth: float) -> Solid:
    """Return a pleated cone along x.

    Parameters
    ----------
    r1, r2, half : float
        Radii at -x and +x, and half length, mm.
    folds, depth : int, float
        Number of pleats, and their depth, mm.
    """
    r = max(r1, r2) + depth
    return Solid(solid.PLEATS, (r1, r2, half, float(folds), depth), (r, r, half))


def ribs(r: float, half: float, rounding: float, pitch: float, depth: float) -> Solid:
    """Return a cylinder along x with hoops round it.

    Parameters
    ----------
    r, half, rounding : float
        Of the cylinder, mm.
    pitch, depth : float
        Distance of the hoops, and how far they stand out, mm.
    """
    reach = r + depth
    return Solid(solid.RIBS, (r, half, rounding, pitch, depth), (reach, reach, half))


def loft(
    near: tuple[float, float], far: tuple[float, float], half: float, rounding: float = 0.0
) -> Solid:
    """Return what spans an ellipse (rz, ry) at -x and another at +x.

    Parameters
    ----------
    near, far : (float, float)
        Radii (rz, ry) of both ellipses, mm.
    half, rounding : float
        Half length, and radius of the rims, mm.
    """
    reach = (max(near[0], far[0]), max(near[1], far[1]), half)
    return Solid(solid.LOFT, (*near, *far, half, rounding), reach)


def turned(axis: str, degrees: float) -> NDArray[np.float64]:
    """Return the rotation about z, y or x that carries the next axis towards the one after.

    Parameters
    ----------
    axis : {"z", "y", "x"}
        What is turned about.
    degrees : float
        How far.
    """
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

    Parameters
    ----------
    rows : list of (ROW,) ndarray
        The program, one row a step.
    lower, upper : (3,) ndarray of float64
        The box of what was joined, mm.
    """

    rows: list[NDArray[np.float64]] = field(default_factory=list)
    lower: NDArray[np.float64] = field(default_factory=lambda: np.full(3, np.inf))
    upper: NDArray[np.float64] = field(default_factory=lambda: np.full(3, -np.inf))

    def start(self, form: Solid, at: ArrayLike = (0, 0, 0), turn: Turn = None) -> Clay:
        """Begin a new lump with a solid at a place, turned.

        Parameters
        ----------
        form : Solid
            What it begins with.
        at : (float, float, float)
            Where its origin stands, mm, z y x.
        turn : (3, 3) ndarray, optional
            Its rotation.
        """
        return self._shape(START, form, at, turn, 0.0)

    def join(
        self, form: Solid, at: ArrayLike = (0, 0, 0), turn: Turn = None, soft: float = 0.0
    ) -> Clay:
        """Join a solid to the lump, with a fillet of `soft` mm.

        Parameters
        ----------
        form, at, turn : see `start`
        soft : float
            Radius of the fillet where both meet, mm.
        """
        return self._shape(JOIN, form, at, turn, soft)

    def cut(
        self, form: Solid, at: ArrayLike = (0, 0, 0), turn: Turn = None, soft: float = 0.0
    ) -> Clay:
        """Take a solid away from the lump.

        Parameters
        ----------
        form, at, turn, soft : see `join`
        """
        return self._shape(CUT, form, at, turn, soft)

    def clip(
        self, form: Solid, at: ArrayLike = (0, 0, 0), turn: Turn = None, soft: float = 0.0
    ) -> Clay:
        """Keep what the lump and a solid share.

        Parameters
        ----------
        form, at, turn, soft : see `join`
        """
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

    def carve(self) -> Clay:
        """Empty the lump: air that does not belong to the object."""
        row = np.zeros(ROW)
        row[0] = CARVE
        row[1] = MATERIAL_INDEX["air"]
        self.rows.append(row)
        return self

    def program(self) -> NDArray[np.float64]:
        """Return the rows written so far, (N, ROW) float64."""
        program = np.array(self.rows)
        # Fillets pull the surface out, and two can meet: twice the widest is safe to skip at.
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
        # Transposed: the kernel turns points into the solid's frame, not the solid into the world.
        row[6:15] = rotation.T.ravel()
        row[15 : 15 + len(form.numbers)] = form.numbers
        # A half-space reaches everywhere, so it is never too far to matter.
        row[21] = np.linalg.norm(form.reach) if form.code != solid.SLAB else np.inf
        self.rows.append(row)
        # Cutting and clipping only take away: the box stays right without them.
        if verb in (START, JOIN):
            # Corners of the turned solid: fillets stay within the box of what they join.
            for signs in product((-1.0, 1.0), repeat=3):
                corner = place + rotation @ (np.array(signs) * form.reach)
                np.minimum(self.lower, corner, out=self.lower)
                np.maximum(self.upper, corner, out=self.upper)
        return self
