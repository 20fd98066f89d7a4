"""Clothes that give way: laid over what is in the bag, they follow it, folds and all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from napari_unpack.simulation.materials import MATERIALS
from napari_unpack.simulation.stacking import BLOCKED, Stack

Plane = NDArray[np.float64]


@dataclass(frozen=True)
class Cloth:
    """A piece of clothing.

    Parameters
    ----------
    kind, name, material : str
        For the table of objects.
    length : float
        Longest extent, mm.
    thickness : float
        Of all its layers together, mm.
    """

    kind: str
    name: str
    material: str
    length: float
    thickness: float


@dataclass(frozen=True, eq=False)
class Draped:
    """A piece of clothing where it lies.

    Parameters
    ----------
    inside : (Z, Y, X) ndarray of bool
        Its voxels, in a box of its own.
    density : (Z, Y, X) ndarray of float32
        CT number + 1000 times the share of each voxel that is covered.
    corner : (int, int, int)
        First voxel of the box, z y x.
    grams : float
        Mass.
    """

    inside: NDArray[np.bool_]
    density: NDArray[np.float32]
    corner: tuple[int, int, int]
    grams: float


def tailor(rng: np.random.Generator, kind: str, length: float, wall: float) -> Cloth:
    """Return a sweater, trousers or scarf of a given length (mm).

    Parameters
    ----------
    rng : numpy.random.Generator
        Chooses the thickness.
    kind : {"sweater", "trousers", "scarf"}
        What it is.
    length, wall : float
        Longest extent, and the thinnest wall that is resolved, mm.
    """
    material = {"sweater": "wool", "trousers": "denim", "scarf": "cotton"}[kind]
    name = {"sweater": "knitted sweater", "trousers": "jeans", "scarf": "scarf"}[kind]
    # Folded clothes are a tenth of their length thick; thinner than 3 walls the layers vanish.
    thickness = max(length * rng.uniform(0.10, 0.15), 3.0 * wall)
    return Cloth(kind, name, material, length, thickness)


def drape(
    rng: np.random.Generator, cloth: Cloth, stack: Stack, spacing: NDArray[np.float64]
) -> Draped | None:
    """Lay a piece of clothing on the stack where it lies lowest; None where it fits nowhere.

    Parameters
    ----------
    rng : numpy.random.Generator
        Chooses places to try, and the folds.
    cloth : Cloth
        What is laid.
    stack : Stack
        What it is laid on. Not changed.
    spacing : (3,) ndarray of float64, mm z y x
    """
    # Twenty places are judged at a few points; only the four best are laid, which is slow.
    tries = [_place(rng, cloth, stack, spacing) for _ in range(20)]
    laid = [(cost, place) for cost, place in tries if np.isfinite(cost)]
    for _, (z, x, angle) in sorted(laid, key=lambda pair: pair[0])[:4]:
        draped = _lay(rng, cloth, stack, spacing, z, x, angle)
        if draped is not None:
            return draped
    return None


def _place(
    rng: np.random.Generator, cloth: Cloth, stack: Stack, spacing: NDArray[np.float64]
) -> tuple[float, tuple[float, float, float]]:
    # A place to try, and how high what lies there is, seen at a few points.
    open_columns = np.argwhere(stack.height > BLOCKED)
    low, high = open_columns.min(axis=0), open_columns.max(axis=0)
    # Within the box of open columns: elsewhere the lid or the rounded edge is in the way.
    z, x = rng.uniform(low, high)
    # People lay clothes square to the bag, nearly.
    angle = rng.choice([0.0, 90.0, 180.0, 270.0]) + rng.normal(0.0, 9.0)
    # Every third column: a garment covers hundreds, and twenty places are looked at.
    step = 3
    zz, xx = np.mgrid[0 : stack.height.shape[0] : step, 0 : stack.height.shape[1] : step]
    covered = _outline(cloth, (zz - z) * spacing[0], (xx - x) * spacing[2], angle) < 0
    rows = stack.height[::step, ::step][covered]
    if len(rows) == 0 or rows.min() <= BLOCKED:
        return np.inf, (z, x, angle)
    # A low place is good; an uneven one would leave hollows below the cloth.
    rise = float(stack.height.max() - rows.mean())
    return rise + 0.4 * float(rows.std()), (z, x, angle)


def _lay(
    rng: np.random.Generator,
    cloth: Cloth,
    stack: Stack,
    spacing: NDArray[np.float64],
    z: float,
    x: float,
    angle: float,
) -> Draped | None:
    zz, xx = np.mgrid[0 : stack.height.shape[0], 0 : stack.height.shape[1]].astype(np.float64)
    dz, dx = (zz - z) * spacing[0], (xx - x) * spacing[2]
    edge = _outline(cloth, dz, dx, angle)
    covered = edge < 0
    box = ndimage.find_objects(covered.astype(np.int8))[0]
    covered, edge, ground = covered[box], edge[box], stack.height[box]
    if ground[covered].min() <= BLOCKED:
        return None
    # Columns outside the room count as the floor, or the cloth would be pulled up the wall.
    floor = int(ground[covered].max())
    under = _sag(np.where(ground > BLOCKED, ground, floor).astype(np.float64), cloth, spacing)
    thick = _relief(rng, cloth, edge, dz[box], dx[box], angle) / spacing[1]
    # Never into what lies there: labels must not overlap by a voxel.
    under = np.minimum(under, ground)
    over = under - thick
    if (over < stack.ceiling[box])[covered].any():
        return None
    top, bottom = int(np.floor(over[covered].min())) - 1, int(np.ceil(under[covered].max()))
    rows = np.arange(top, bottom)[None, :, None]
    surface, base = over[:, None, :], under[:, None, :] - 0.5
    shown = covered[:, None, :]
    # One row of overlap less below: cloth that rests on a thing takes none of its voxels.
    inside = (rows > surface - 0.5) & (rows < base) & shown
    cover = np.clip(np.minimum(rows - surface + 0.5, base - rows) + 0.5, 0.0, 1.0) * shown
    weave = _weave(rng, (base - rows) / np.maximum(thick, 1.0)[:, None, :], spacing)
    material = MATERIALS[cloth.material]
    density = (material.value * cover * weave).astype(np.float32)
    grams = material.density * float(cover.sum()) * float(np.prod(spacing)) / 1000.0
    return Draped(inside, density, (box[0].start, top, box[1].start), grams)


def _sag(ground: Plane, cloth: Cloth, spacing: NDArray[np.float64]) -> Plane:
    # What cloth does to the ground: it bridges narrow gaps and rounds off edges, resting on
    # the highest points.
    # A quarter of its length is what stiff folded cloth spans; odd, so that it is centred.
    span = [max(int(0.26 * cloth.length / spacing[axis]) | 1, 3) for axis in (0, 2)]
    bridged = ndimage.grey_opening(ground, size=span, mode="nearest")
    sigma = [0.06 * cloth.length / spacing[axis] for axis in (0, 2)]
    smooth: Plane = ndimage.gaussian_filter(bridged, sigma, mode="nearest")
    under = np.minimum(smooth, ground)
    # Down again by whole rows, so that it touches what it lies on.
    return under + np.floor((ground - under).min())


def _relief(
    rng: np.random.Generator, cloth: Cloth, edge: Plane, dz: Plane, dx: Plane, angle: float
) -> Plane:
    # Thickness in mm: rounded hems, folds that run across, ribs that run along.
    u, v = _along(dz, dx, angle)
    # Round within 0.7 of the thickness of the edge: a folded hem is no cliff.
    deep = np.clip(-edge / (0.7 * cloth.thickness), 0.0, 1.0)
    profile = np.sqrt(np.maximum(1.0 - (1.0 - deep) ** 2, 0.0))
    a, b, c = rng.uniform(0, 2 * np.pi, 3)
    size = cloth.length
    folds = np.sin(2 * np.pi * (2.2 * u / size + 0.7 * np.sin(5 * v / size + a)) + b)
    folds += 0.6 * np.sin(2 * np.pi * (1.3 * v / size + 0.8 * np.sin(7 * u / size + c)))
    ribs = np.cos(2 * np.pi * v / max(0.045 * size, 3.0))
    hem = np.exp(-(((-edge - 0.05 * size) / (0.02 * size)) ** 2))
    relief = 1.0 + 0.16 * folds - 0.16 * hem
    if cloth.kind == "sweater":
        relief += 0.09 * ribs
    if cloth.kind == "trousers":
        seam = np.exp(-(((np.abs(v) - 0.1 * size) / (0.012 * size)) ** 2))
        relief += 0.12 * seam
    # Folds may not thin it to nothing: it would break into pieces.
    return cloth.thickness * profile * np.maximum(relief, 0.35)


def _weave(
    rng: np.random.Generator, share: Plane, spacing: NDArray[np.float64]
) -> NDArray[np.float32]:
    # Layers with loose cloth between them, and the yarn's own unevenness.
    # Three layers through the thickness, as folded clothes show.
    layers = np.cos(2 * np.pi * 3.0 * share)
    yarn = rng.standard_normal(share.shape, dtype=np.float32)
    # The same in mm along every axis, or the yarn would show the voxel's shape.
    yarn = ndimage.gaussian_filter(yarn, 0.8 / (spacing / spacing.min()))
    yarn /= max(float(yarn.std()), 1e-6)
    return np.clip(1.0 - 0.18 * layers + 0.12 * yarn, 0.3, 1.7).astype(np.float32)


def _along(dz: Plane, dx: Plane, angle: float) -> tuple[Plane, Plane]:
    cosine, sine = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return cosine * dx + sine * dz, cosine * dz - sine * dx


def _outline(cloth: Cloth, dz: Plane, dx: Plane, angle: float) -> Plane:
    # Signed distance (mm) from the garment's outline as it lies, u along it, v across.
    u, v = _along(dz, dx, angle)
    size = cloth.length
    # Garments are symmetric: one sleeve or leg is made, and mirrored.
    w = np.abs(v)
    if cloth.kind == "sweater":
        body = _rounded(u - 0.03 * size, v, 0.42 * size, 0.20 * size, 0.06 * size)
        sleeve = _strip(u, w, (-0.33, 0.16), (0.12, 0.34), size) - 0.075 * size
        neck = np.hypot(u + 0.43 * size, v) - 0.085 * size
        return np.maximum(np.minimum(body, sleeve), -neck)
    if cloth.kind == "trousers":
        hips = _rounded(u + 0.33 * size, v, 0.15 * size, 0.19 * size, 0.03 * size)
        leg = _strip(u, w, (-0.25, 0.1), (0.38, 0.125), size) - 0.09 * size
        return np.minimum(hips, leg)
    band = v - 0.07 * size * np.sin(2 * np.pi * 1.1 * u / size)
    return np.maximum(np.abs(band) - 0.11 * size, np.abs(u) - 0.5 * size)


def _rounded(u: Plane, v: Plane, half_u: float, half_v: float, rounding: float) -> Plane:
    a, b = np.abs(u) - half_u + rounding, np.abs(v) - half_v + rounding
    outside = np.hypot(np.maximum(a, 0), np.maximum(b, 0))
    return outside + np.minimum(np.maximum(a, b), 0) - rounding


def _strip(
    u: Plane, v: Plane, start: tuple[float, float], stop: tuple[float, float], size: float
) -> Plane:
    # Distance from a line between two points, given as shares of the length.
    (a, b), (c, d) = start, stop
    along = np.array([c - a, d - b]) * size
    pu, pv = u - a * size, v - b * size
    share = np.clip((pu * along[0] + pv * along[1]) / (along @ along), 0.0, 1.0)
    return np.hypot(pu - share * along[0], pv - share * along[1])
