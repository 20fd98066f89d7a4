"""Where candidate cuts come from: distance trees, sheets, density steps, and the lattice.

Each source proposes cuts of a region in blocks: trees where the shape or its density is narrowest,
sheets where something thin lies on something thick, density steps between regions of one density,
and the lattice where the isoperimetric potential has cuts of least area.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cc3d
import edt
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_cdt, gaussian_filter

from napari_unpack.geometry.relabeling import numbered
from napari_unpack.segmentation.common.flooding import flood
from napari_unpack.segmentation.common.mask_components import mask_components
from napari_unpack.segmentation.common.measures import chamfer_depth
from napari_unpack.segmentation.common.region import Region
from napari_unpack.segmentation.isoperimetric.distance_tree import (
    isoperimetric_ratio,
    significant_minima,
    tree_sweep,
    two_sides,
)
from napari_unpack.segmentation.isoperimetric.lattice import Lattice
from napari_unpack.segmentation.isoperimetric.multiresolution import ReducedRegion, coarsened

# Of a region's reduced copy: the lattice's iterations grow with its diameter.
MOST_BLOCKS = 30_000


@dataclass(frozen=True, eq=False)
class PreparedRegion:
    """What every source of candidates works on.

    Parameters
    ----------
    region : Region
        6-connected.
    smallest : float
        No part is smaller than this, mm^3.
    depth : (Z, Y, X) ndarray of float32
        Distance to the outside, mm.
    coarse : ReducedRegion
        The same in at most 30,000 blocks.
    """

    region: Region
    smallest: float
    depth: NDArray[np.float32]
    coarse: ReducedRegion

    @staticmethod
    def of(region: Region, smallest: float) -> PreparedRegion:
        """Prepare a region.

        Parameters
        ----------
        region : Region
            6-connected.
        smallest : float
            mm^3.
        """
        depth = chamfer_depth(region.mask, region.spacing)
        small = coarsened(region.mask, depth, region.density, region.spacing, MOST_BLOCKS)
        return PreparedRegion(region, smallest, depth, small)

    @property
    def fewest(self) -> int:
        """The smallest part in blocks."""
        return max(1, int(np.ceil(self.smallest / float(np.prod(self.coarse.spacing)))))


# Its source, and the parts of the blocks.
Proposals = Iterator[tuple[str, NDArray[np.int32]]]


def _largest_steps(values: NDArray[np.float32], mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return the largest step of every voxel to a face neighbour, both inside a mask."""
    steps = np.zeros(mask.shape, np.float32)
    for axis in range(3):
        along, inside = np.moveaxis(values, axis, 0), np.moveaxis(mask, axis, 0)
        here = np.moveaxis(steps, axis, 0)
        step = np.where(inside[1:] & inside[:-1], np.abs(along[1:] - along[:-1]), 0)
        here[1:] = np.maximum(here[1:], step)
        here[:-1] = np.maximum(here[:-1], step)
    return steps


def density_candidates(prepared: PreparedRegion) -> Proposals:
    """Propose to split where densities differ.

    Yields "materials" (Otsu's two classes, then three, of the voxels off the rim) and "basins" (a
    watershed of the gradient from its calm places).
    """
    # Slow to import, and needed by one method alone.
    from skimage.filters import threshold_multiotsu

    small = prepared.coarse
    weight = gaussian_filter(small.mask.astype(np.float32), 0.7)
    smooth = gaussian_filter(np.where(small.mask, small.density, 0), 0.7)
    smooth = np.where(small.mask, smooth / np.maximum(weight, 1e-3), 0).astype(np.float32)
    inner = small.mask & (small.depth > 1.5 * max(small.spacing))
    if np.count_nonzero(inner) < 2 * prepared.fewest:
        return
    slope = _largest_steps(smooth, small.mask)
    low, high = np.quantile(smooth[inner], [0.01, 0.99])
    settle = np.clip(slope / max(float(np.quantile(slope[inner], 0.99)), 1e-6), 0, 1)
    if high > low + 0.02 * abs(float(high)):
        values = np.clip(smooth[inner], low, high)
        for classes in (2, 3):
            try:
                levels = threshold_multiotsu(values, classes, nbins=64)
            except ValueError:
                continue
            kinds = np.where(inner, np.digitize(smooth, levels) + 1, 0).astype(np.int32)
            sides = _grown(kinds, small.mask, prepared.fewest // 2, settle)
            if sides.max() > 1:
                yield "materials", sides
    calm = inner & (slope < np.quantile(slope[inner], 0.4))
    sides = _grown(calm.astype(np.int32), small.mask, max(prepared.fewest // 4, 8), settle)
    if 1 < sides.max() <= 12:
        yield "basins", sides


def _grown(
    kinds: NDArray[np.int32], mask: NDArray[np.bool_], fewest: int, settle: NDArray[np.floating]
) -> NDArray[np.int32]:
    """Take the large components of every kind, and flood the rest of the mask from them."""
    pieces, count = cc3d.connected_components(kinds, connectivity=6, return_N=True)
    sizes = np.bincount(pieces.reshape(-1), minlength=count + 1)
    large = sizes >= max(fewest, 1)
    large[0] = False
    return flood(numbered(large)[pieces], mask, (255 * settle).astype(np.uint8))


# Cuts of each lattice at most.
LATTICE_CUTS = 2


def lattice_candidates(prepared: PreparedRegion) -> Proposals:
    """Propose minima of the isoperimetric ratio, as "lattice" and, with steps, "lattice, density".

    Notes
    -----
    Grady & Schwartz 2006: L0 x0 = 1 with the ground taken out, swept.
    Deviation: the ground is the block furthest from the middle of the shape rather than the one of
    largest degree, which on a binary lattice is any inner one; a ground in the middle makes level
    sets that are shells around it, one at an end makes them cross the shape.
    """
    small = prepared.coarse
    for source, density in (("lattice", None), ("lattice, density", small.density)):
        lattice = Lattice.of(small.mask, small.spacing, density)
        places = np.stack(np.unravel_index(lattice.where, small.mask.shape), axis=1)
        apart = (places - places.mean(axis=0)) * np.array(small.spacing)
        ground = np.array([int(np.argmax(np.square(apart).sum(axis=1)))])
        potential = lattice.potential(ground, np.zeros(1), 1.0, 1e-3, 500)
        order, cut = lattice.sweep(potential, weighted=density is not None)
        for sides in _lowest_cuts(prepared, lattice.where[order], cut, LATTICE_CUTS):
            yield source, sides


# Factor by which the ratio rises between two minima that both count.
SIGNIFICANT_RISE = 1.1


def _lowest_cuts(
    prepared: PreparedRegion, order: NDArray[np.int64], cut: NDArray[np.float64], most: int
) -> Iterator[NDArray[np.int32]]:
    """Yield both sides at the significant minima of the ratio of a sweep."""
    small, last = prepared.coarse, len(order) - prepared.fewest
    ratio = isoperimetric_ratio(cut, float(np.prod(small.spacing)))
    for k in significant_minima(ratio, prepared.fewest, last, SIGNIFICANT_RISE, most):
        yield two_sides(order, k, small.mask.shape)


# Half thicknesses that count as thin, against the largest depth.
THIN_SHARES = (0.35, 0.65)
# Times its half thickness that a thin part extends at least.
WIDE = 6.0


def sheet_candidates(prepared: PreparedRegion) -> Proposals:
    """Propose, as "sheet", to take thin parts off thick ones."""
    # Thin is what an opening takes away: no ball of the half thickness fits there. Under a thick
    # thing that rests on it a flat sheet goes on: what lies between its two faces is its own.
    small = prepared.coarse
    deepest = float(small.depth.max())
    for share in THIN_SHARES:
        half = share * deepest
        core = small.mask & (small.depth > half)
        if not core.any():
            continue
        away = edt.edt(~core, anisotropy=small.spacing, black_border=False)
        thin = small.mask & (away > half + max(small.spacing))
        sides = _with_sheets(core, thin, small.mask, small.spacing, half, prepared.fewest)
        if sides is not None:
            yield "sheet", sides


def _with_sheets(
    core: NDArray[np.bool_],
    thin: NDArray[np.bool_],
    mask: NDArray[np.bool_],
    spacing: tuple[float, float, float],
    half: float,
    fewest: int,
) -> NDArray[np.int32] | None:
    """Flood from the thick core and from every wide thin piece; None where there is no such."""
    pieces, count = mask_components(thin)
    sizes = np.bincount(pieces.reshape(-1), minlength=count + 1)
    seeds = core.astype(np.int32)
    name = 1
    for k in np.flatnonzero(sizes[1:] >= fewest) + 1:
        points = np.argwhere(pieces == k) * np.array(spacing)
        if np.linalg.norm(np.ptp(points, axis=0)) < WIDE * half:
            continue
        name += 1
        seeds[pieces == k] = name
        seeds[_slab(points, mask, spacing, half)] = name
    return flood(seeds, mask) if name > 1 else None


def _slab(
    points: NDArray[np.float64],
    mask: NDArray[np.bool_],
    spacing: tuple[float, float, float],
    half: float,
) -> NDArray[np.bool_]:
    """Return the voxels of a mask between both faces of a flat sheet; none where it is bent."""
    center = points.mean(axis=0)
    axes = np.linalg.svd(np.cov((points - center).T))[0]
    local = (points - center) @ axes
    low, high = np.quantile(local, 0.01, axis=0), np.quantile(local, 0.99, axis=0)
    inside = np.zeros(mask.shape, np.bool_)
    if high[2] - low[2] > 3 * half:
        return inside
    edge = min(spacing) / 2
    places = np.argwhere(mask)
    heights = (places * np.array(spacing) - center) @ axes
    held = ((heights >= low - edge) & (heights <= high + edge)).all(axis=1)
    inside[tuple(places[held].T)] = True
    return inside


CUTS_OF_EACH_TREE = 3


def tree_candidates(prepared: PreparedRegion) -> Proposals:
    """Propose the significant minima of the ratio along several distance trees.

    Yields "tree", "tree, wide" (distance conductance), "tree, city-block", "tree, edges" (distance
    to the outside or to a density edge), "tree, valleys" (distance times density).
    """
    # Density edges are where the step between blocks exceeds four times its median and a twentieth
    # of the median density.
    small = prepared.coarse
    for source, depth, conductance in _fields(prepared):
        sweep = tree_sweep(small.mask, depth, small.spacing, conductance)
        for sides in _lowest_cuts(prepared, *sweep, CUTS_OF_EACH_TREE):
            yield source, sides


def _fields(prepared: PreparedRegion) -> Iterator[tuple[str, NDArray[np.float32], str]]:
    """Yield the source, the depth that a tree grows along, and the conductance of its edges."""
    small = prepared.coarse
    yield "tree", small.depth, "unit"
    yield "tree, wide", small.depth, "distance"
    yield "tree, city-block", _city_block(small.mask, small.spacing), "unit"
    values = small.density[small.mask]
    low, middle = np.quantile(values, [0.05, 0.5])
    edges = _edges(small.density, small.mask, float(middle))
    if edges.any():
        aware = chamfer_depth(small.mask & ~edges, small.spacing)
        yield "tree, edges", np.minimum(aware, small.depth), "unit"
    lift = np.clip((small.density - low) / max(float(middle - low), 1e-6), 0.0, 2.0)
    yield "tree, valleys", (small.depth * lift).astype(np.float32), "unit"


def _edges(
    density: NDArray[np.float32], mask: NDArray[np.bool_], middle: float
) -> NDArray[np.bool_]:
    step = _largest_steps(density, mask)
    typical = float(np.median(step[mask]))
    return np.asarray(mask & (step > max(4 * typical, 0.05 * abs(middle))))


def _city_block(
    mask: NDArray[np.bool_], spacing: tuple[float, float, float]
) -> NDArray[np.float32]:
    padded = np.pad(mask, 1)
    steps = distance_transform_cdt(padded, metric="taxicab")[1:-1, 1:-1, 1:-1]
    return steps.astype(np.float32) * np.float32(min(spacing))
