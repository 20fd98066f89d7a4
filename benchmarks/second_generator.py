"""A second, independent generator of packed things, to test on what nothing was tuned for.

It shares no code and no idea with `napari_unpack.simulation`: bodies are implicit solids of five
families, densities are drawn from overlapping ranges and never repeat, and packing is a search by
correlation for the place of most contact, not a fall.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks.second_solids import Solid, draw_solid

Mask = NDArray[np.bool_]
FACES = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])


@dataclass(frozen=True, eq=False)
class SecondBag:
    """A scan and its truth, named as in `simulate_bag`.

    Parameters
    ----------
    volume : (Z, Y, X) ndarray of uint16
        CT number + 1000, blurred and noisy.
    labels : (Z, Y, X) ndarray of uint16
        Object IDs from 1. A hollow body and all in it are one object.
    spacing : (float, float, float)
        mm, z y x.
    objects : pandas.DataFrame
        By `id`: kind (superquadric, tube, polyhedron, shell, plate, wrap), group (bulk, sheet,
        liquid, metal), density, voxels.
    """

    volume: NDArray[np.uint16]
    labels: NDArray[np.uint16]
    spacing: tuple[float, float, float]
    objects: pd.DataFrame


def second_bag(
    seed: int, shape: tuple[int, int, int] = (120, 128, 144), count: int = 28
) -> SecondBag:
    """Pack a bag and scan it.

    Parameters
    ----------
    seed : int
        Of everything random.
    shape : (int, int, int)
        Of the volume, z y x, voxels of 1 mm; at least 48 each.
    count : int
        How many objects; fewer where there is no room.

    Returns
    -------
    SecondBag

    Notes
    -----
    Every body goes where it touches most of what is there already, among the places that it
    overlaps by no more than it may be dented; found at a quarter of the resolution by
    correlation, then by single steps. Soft bodies give way to those placed before.
    """
    rng = np.random.default_rng([seed, 2])
    labels = np.zeros(shape, np.uint16)
    density = np.zeros(shape, np.float32)
    rows: list[tuple[str, str, float]] = []
    for _ in range(3 * count):
        if len(rows) == count:
            break
        if rows and rng.random() < 0.09:
            placed = _wrap(labels, density, len(rows) + 1, rng)
            rows += [("wrap", "sheet", placed)] if placed else []
            continue
        solid = draw_solid(rng, min(shape) / 120)
        if _put(labels, density, solid, len(rows) + 1, rng):
            rows.append((solid.kind, solid.group, solid.density))
    table = pd.DataFrame(
        rows, columns=["kind", "group", "density"], index=pd.RangeIndex(1, len(rows) + 1, name="id")
    )
    table["voxels"] = np.bincount(labels.ravel(), minlength=len(rows) + 1)[1:]
    return SecondBag(_scan(density, rng), labels, (1.0, 1.0, 1.0), table)


def touching(labels: NDArray[np.uint16]) -> pd.DataFrame:
    """Return the faces and the share of them that touch other objects, by object.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of uint16
        From 1, 0 is background; the volume's border counts as background.

    Returns
    -------
    pandas.DataFrame
        By `id`: faces (voxel faces towards anything else), shared (those towards an object),
        share.
    """
    padded = np.pad(labels, 1)
    top = int(labels.max()) + 1
    faces, shared = np.zeros(top, np.int64), np.zeros(top, np.int64)
    for axis in range(3):
        a = np.moveaxis(padded, axis, 0)[:-1].ravel()
        b = np.moveaxis(padded, axis, 0)[1:].ravel()
        for one, other in ((a, b), (b, a)):
            outer = one != other
            faces += np.bincount(one[outer], minlength=top)
            shared += np.bincount(one[outer & (other > 0)], minlength=top)
    index = pd.RangeIndex(1, top, name="id")
    share = shared[1:] / np.maximum(faces[1:], 1)
    return pd.DataFrame({"faces": faces[1:], "shared": shared[1:], "share": share}, index=index)


def _put(
    labels: NDArray[np.uint16],
    density: NDArray[np.float32],
    solid: Solid,
    name: int,
    rng: np.random.Generator,
) -> bool:
    place = _most_contact(labels > 0, solid, rng)
    if place is None:
        return False
    place = _settled(labels, solid, place)
    window = tuple(slice(p, p + n) for p, n in zip(place, solid.mask.shape, strict=True))
    own = solid.mask & (labels[window] == 0)
    pieces, found = ndimage.label(own)
    if found > 1:
        own = pieces == 1 + np.bincount(pieces.ravel())[1:].argmax()
    if own.sum() < 0.7 * solid.mask.sum():
        return False
    labels[window][own] = name
    density[window][own] = solid.filling[own]
    return True


def _most_contact(
    taken: Mask, solid: Solid, rng: np.random.Generator, step: int = 4
) -> NDArray[np.intp] | None:
    """Return the corner at which a solid touches most, None where it has no room."""
    coarse = _pooled(taken, step)
    small = _pooled(solid.mask, step)
    room = np.array(coarse.shape) - small.shape + 1
    if (room < 1).any():
        return None
    near = ndimage.binary_dilation(coarse) & ~coarse
    spectrum = np.conj(np.fft.rfftn(small, coarse.shape, axes=(0, 1, 2)))

    def meeting(other: Mask) -> NDArray[np.float64]:
        sums = np.fft.irfftn(np.fft.rfftn(other) * spectrum, coarse.shape, axes=(0, 1, 2))
        # Counts: rounding makes the choice the same on every machine.
        return np.rint(sums[: room[0], : room[1], : room[2]])

    overlap, contact = meeting(coarse), meeting(near)
    size = float(small.sum())
    middle = np.array([0.5, 0.8, 0.5]) * (room - 1)
    far = np.sqrt(
        sum(
            ((g - m) / max(r, 1)) ** 2
            for g, m, r in zip(np.indices(room), middle, room, strict=True)
        )
    )
    value = rng.uniform(0.2, 1.0) * contact / size - 0.6 * far + rng.uniform(0, 0.2, far.shape)
    value[overlap > (0.22 if solid.soft else 0.10) * size] = -np.inf
    best = int(value.argmax())
    if not np.isfinite(value.flat[best]):
        return None
    corner = np.array(np.unravel_index(best, value.shape)) * step
    return np.asarray(np.minimum(corner, np.array(taken.shape) - solid.mask.shape))


def _settled(labels: NDArray[np.uint16], solid: Solid, place: NDArray[np.intp]) -> NDArray[np.intp]:
    """Step out of what a solid cuts too deep into, and up to what it nearly touches."""
    allowed = (0.04 if solid.soft else 0.0) * solid.mask.sum()
    points = np.argwhere(solid.mask)
    rim = np.argwhere(ndimage.binary_dilation(np.pad(solid.mask, 1)) & ~np.pad(solid.mask, 1)) - 1
    bound = np.array(labels.shape)

    def judged(at: NDArray[np.intp]) -> tuple[float, float]:
        if (at < 0).any() or (at + solid.mask.shape > bound).any():
            return (-np.inf, 0.0)
        cut = (labels[tuple((points + at).T)] > 0).sum()
        around = rim + at
        around = around[((around >= 0) & (around < bound)).all(axis=1)]
        touch = (labels[tuple(around.T)] > 0).sum()
        return (-max(float(cut) - allowed, 0.0), float(touch))

    best, now = place, judged(place)
    for _ in range(12):
        scored = [(judged(best + f), tuple(best + f)) for f in FACES]
        top, where = max(scored)
        if top <= now:
            break
        now, best = top, np.array(where)
    return best


def _wrap(
    labels: NDArray[np.uint16], density: NDArray[np.float32], name: int, rng: np.random.Generator
) -> float:
    """Wrap a sheet around part of an object; return its density, 0 where it has no room."""
    inner = int(rng.integers(1, name))
    box = ndimage.find_objects(labels)[inner - 1]
    window = tuple(slice(max(s.start - 6, 0), s.stop + 6) for s in box)
    around = labels[window]
    outside = ndimage.distance_transform_edt(around != inner)
    points = np.argwhere(around == inner)
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    heights = np.tensordot(normal, np.indices(around.shape), 1)
    cut = np.quantile(points @ normal, rng.uniform(0.3, 0.6))
    sheet = (outside > 0) & (outside <= rng.uniform(2.2, 4.2)) & (around == 0) & (heights > cut)
    pieces, found = ndimage.label(sheet)
    if not found:
        return 0.0
    sizes = np.bincount(pieces.ravel())[1:]
    if sizes.max() < max(400, 0.6 * sizes.sum()):
        return 0.0
    own = pieces == 1 + sizes.argmax()
    value = float(rng.uniform(300, 1300))
    around[own] = name
    density[window][own] = value
    return value


def _pooled(mask: Mask, step: int) -> Mask:
    """Return which blocks are at least half full."""
    padded = np.pad(mask, [(0, -n % step) for n in mask.shape])
    a, b, c = (n // step for n in padded.shape)
    blocks = padded.reshape(a, step, b, step, c, step).sum(axis=(1, 3, 5))
    return np.asarray(2 * blocks >= step**3)


def _scan(density: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.uint16]:
    blurred = ndimage.gaussian_filter(density, rng.uniform(0.5, 0.9))
    grain = rng.uniform(1.1, 1.8)
    rough = ndimage.gaussian_filter(rng.standard_normal(density.shape, dtype=np.float32), grain)
    noise = rng.uniform(10, 20) * rough / rough.std()
    noise += rng.uniform(8, 18) * rng.standard_normal(density.shape, dtype=np.float32)
    return np.clip(np.rint(blurred + noise), 0, 32000).astype(np.uint16)
