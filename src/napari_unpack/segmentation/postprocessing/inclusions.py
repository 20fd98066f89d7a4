"""Small dense things in soft ones: buttons, zip pulls, keys and coins in cloth, a metal box."""

from __future__ import annotations

import cc3d
import edt
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion
from scipy.spatial import ConvexHull

from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.kernels import njit
from napari_unpack.segmentation.common.array_source import grown
from napari_unpack.segmentation.common.convex_hull import mask_corners, solidity
from napari_unpack.segmentation.common.density_regions import DensityScale
from napari_unpack.segmentation.common.merging import absorb_small
from napari_unpack.segmentation.common.region import MIN_OBJECT_VOXELS
from napari_unpack.segmentation.common.validation import Spacing, proportions
from napari_unpack.segmentation.postprocessing.cables import scale_of
from napari_unpack.tasks import SILENT, Share

# Of log density, 64 to a factor of e.
BINS = 1024

LIGHT, SOFT = 0.6, (5.0, 12.0)
"""Soft is what has so much of the density that 92 % of objects' voxels are below, within knees:
cloth, paper and foam, but not leather, wood and plastic, in which metal is a motor, a battery or a
hinge."""

# A piece lies in an object, its host, without being a part of it.
# Times the upper quartile of its host, above air, from which a voxel may be of a piece; times that,
# where nothing has been found to be an object.
CORE, LOST = 5.0, 1.5
# Times the upper quartile of its host nearby that the median of a piece is.
CONTRAST = 7.0
# Share of what lies around a piece that may be half as dense as it.
AROUND = 0.1
# Voxels from a piece between which its host is looked at; closer it is blurred.
NEAR, FAR = 2.5, 8.0
# Voxels from the middle of a piece to its surface at least: streaks and crusts are flat.
THICK = 1.4
# Share of its host that lies elsewhere.
REST = 0.2
# Share of its convex hull that a piece fills where nothing has been found to be an object.
COMPACT = 0.4
# Voxels of a piece.
FEWEST = 27
# Share of its convex hull's surface that a piece covers, and of its volume that it does not fill,
# if all inside belongs to it.
WALLED = 0.6
# So many times what a large piece was taken from is looked at anew.
ROUNDS = 3


def separate_inclusions(
    labels: NDArray[np.int32],
    density: NDArray[np.generic],
    spacing: Spacing,
    smallest: float,
    share: Share = SILENT,
) -> NDArray[np.int32]:
    """Make objects, with labels after all others, of what is dense inside something soft.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Objects 1, 2, ...; 0 background. Not changed.
    density : (Z, Y, X) ndarray
    spacing : (float, float, float) of mm, z y x
    smallest : float
        mm^3, below which what is left of a host joins a neighbour; pieces are kept down to a
        quarter of it.
    share : Share
    """
    # The core of a piece is what stands out against its own host. A piece ends at half the density
    # of its core, and is one if that is a step all round and its host is soft nearby: a battery in
    # the plastic of a radio has plastic around it, the rim of a can has the can, a plug has its
    # cable. A piece that is a wall, such as a metal box, takes in what its convex hull holds.
    scale = scale_of(labels, density)
    if scale is None:
        return labels
    softest = _softest(labels, density, scale)
    voxel = float(np.prod(spacing))
    least = max(FEWEST, smallest / 4 / voxel)
    result = labels
    open_to = np.ones(int(labels.max()) + 1, np.bool_)
    edges = proportions(spacing)
    for n in range(ROUNDS):
        before, turn = int(result.max()), share.part(1 - 0.5**n, 1 - 0.5 ** (n + 1))
        taken, hollowed = _taken(result, density, edges, scale, open_to, least, softest, turn)
        result = np.where(taken > 0, taken, result)
        if not len(hollowed):
            break
        pieces = int(result.max())
        result = _in_pieces(result, hollowed)
        kept = np.arange(int(result.max()) + 1) <= pieces
        result = absorb_small(result, spacing, max(smallest, MIN_OBJECT_VOXELS * voxel), kept)
        open_to = ~kept
        open_to[hollowed] = True
        open_to[before + 1 : pieces + 1] = False
    return result


def _softest(labels: NDArray[np.int32], density: NDArray[np.generic], scale: DensityScale) -> float:
    """Return the density above air up to which a host is soft, in whatever unit densities are."""
    values = density[labels > 0][:: max(1, labels.size // 1_000_000)].astype(np.float64)
    # Of a bag that is mostly cloth the median is low, of one that is all cloth what is dense too.
    bright = float(np.nanquantile(values, 0.92)) - scale.air
    return float(np.clip(LIGHT * bright, *np.multiply(SOFT, scale.knee)))


def _taken(
    labels: NDArray[np.int32],
    density: NDArray[np.generic],
    edges: Spacing,
    scale: DensityScale,
    open_to: NDArray[np.bool_],
    least: float,
    softest: float,
    share: Share,
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return the new labels of what is taken out, and the hosts that lost much of themselves."""
    sizes = np.bincount(labels.reshape(-1), minlength=len(open_to))
    share(0.05)
    quartiles = _quartiles(labels, density, scale.air, scale.knee, len(sizes))
    share(0.2)
    levels, kinds = _levels(quartiles, sizes, open_to, softest)
    dense = np.zeros(labels.shape, np.int32)
    _find_cores(labels, density, levels + scale.air, kinds, dense)
    cores = cc3d.connected_components(dense, connectivity=26)
    share(0.4)
    found = label_boxes(cores)
    taken, count = np.zeros_like(labels), int(labels.max())
    lost = np.zeros(len(sizes))
    for name in share.part(0.5, 1.0).over(found.ids[found.counts >= least / 3].tolist()):
        place = found.slices(name)
        mine = labels[place][cores[place] == name]
        host = int(np.bincount(mine).argmax())
        for reach in (4, int(FAR) + 4):
            box = grown(place, reach, labels.shape)
            own = kinds[labels[box]] == kinds[host]
            # A piece may also end in background.
            allowed = own | (labels[box] == 0)
            values = density[box].astype(np.float32) - np.float32(scale.air)
            solid = _solid(cores[box] == name, values, allowed, edges)
            if solid is None:
                break
        if solid is None:
            continue
        # The frame of the bag is background too; a compact thing is not the frame.
        if not host and solidity(solid, edges) < COMPACT:
            continue
        contrast = CONTRAST if host else CORE
        beside = own & (values > 2 * scale.knee)
        bright = values[cores[box] == name]
        if not _stands_out(solid, bright, values, beside, contrast, edges, softest):
            continue
        piece = allowed & _walled(solid) & (taken[box] == 0)
        gone = np.bincount(labels[box][piece], minlength=len(sizes))
        whole = gone[1:] > (1 - REST) * sizes[1:]
        if gone.sum() < least or (whole & (sizes[1:] > 0)).any():
            continue
        count += 1
        lost += gone
        taken[box][piece] = count
    hollowed = np.flatnonzero(lost > 0.1 * np.maximum(sizes, 1))
    return taken, hollowed[hollowed > 0]


def _solid(
    core: NDArray[np.bool_],
    values: NDArray[np.float32],
    allowed: NDArray[np.bool_],
    edges: Spacing,
) -> NDArray[np.bool_] | None:
    """Return a core grown to half the density of the piece; None if that is no step, or flat."""
    solid = core
    # The core may be the brightest part alone: what it grows to says how dense the piece is.
    for _ in range(2):
        bright = values >= float(np.median(values[solid])) / 2
        solid = binary_dilation(core, iterations=2, mask=bright & allowed) | core
    if edt.edt(solid, anisotropy=edges, black_border=False).max() < THICK:
        return None
    away = edt.edt(~solid, anisotropy=edges, black_border=False)
    around = (away > NEAR) & (away <= NEAR + 1.5)
    if not around.any() or bright[around].mean() > AROUND:
        return None
    return np.asarray(solid)


def _stands_out(
    solid: NDArray[np.bool_],
    core: NDArray[np.float32],
    values: NDArray[np.float32],
    host: NDArray[np.bool_],
    contrast: float,
    edges: Spacing,
    softest: float,
) -> bool:
    """Return whether the host of a piece is soft beside it, and the piece much denser."""
    away = edt.edt(~solid, anisotropy=edges, black_border=False)
    beside = values[host & (away > NEAR) & (away <= FAR)]
    if len(beside) < FEWEST:
        return False
    typical = float(np.quantile(beside, 0.75))
    return typical <= softest and float(np.median(core)) >= contrast * typical


def _walled(solid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return what a piece's convex hull holds if the piece is most of the hull's surface."""
    hull = ConvexHull(mask_corners(solid, np.zeros(3), (1.0, 1.0, 1.0)))
    grid = np.moveaxis(np.indices(solid.shape, np.float32), 0, -1)
    inside = np.ones(solid.shape, np.bool_)
    for plane in hull.equations.astype(np.float32):
        # The hull is one of voxels with their corners.
        inside &= grid @ plane[:3] <= -plane[3] - np.float32(0.4)
    skin = inside & ~binary_erosion(inside)
    covered = binary_dilation(solid, iterations=2)[skin].mean()
    hollow = np.count_nonzero(solid) < WALLED * np.count_nonzero(inside)
    return inside | solid if hollow and covered >= WALLED else solid


def _levels(
    quartiles: NDArray[np.float64],
    sizes: NDArray[np.int64],
    open_to: NDArray[np.bool_],
    softest: float,
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return by label how far above air a core begins, and what hosts count as one."""
    levels = CORE * np.minimum(quartiles, softest)
    soft = (quartiles < softest) & (sizes > 0)
    soft[0] = False
    around = np.average(levels[soft], weights=sizes[soft]) if soft.any() else np.inf
    levels[0] = LOST * around
    levels[~open_to] = np.inf
    soft[0] = True
    return levels, np.where(soft, 0, np.arange(len(soft))).astype(np.int32)


def _in_pieces(labels: NDArray[np.int32], hosts: NDArray[np.int64]) -> NDArray[np.int32]:
    """Give each connected part of some objects a label of its own, the largest keeping its."""
    result, top = labels.copy(), int(labels.max())
    boxes = label_boxes(labels)
    for host in hosts.tolist():
        if host not in boxes.ids:
            continue
        box = boxes.slices(host)
        parts = cc3d.connected_components(labels[box] == host, connectivity=6).astype(np.int32)
        counts = np.bincount(parts.reshape(-1))
        counts[0] = 0
        names = np.arange(len(counts), dtype=np.int32) + top
        names[counts.argmax()] = host
        result[box] = np.where(parts > 0, names[parts], result[box])
        top = int(names.max())
    return result


def _quartiles(
    labels: NDArray[np.int32], density: NDArray[np.generic], air: float, knee: float, count: int
) -> NDArray[np.float64]:
    """Return the upper quartile of every label's density above air, by label; 0 for none."""
    bins = np.zeros((count, BINS), np.int32)
    _count_densities(labels, density, air, knee, bins)
    seen = bins.cumsum(axis=1, dtype=np.int32)
    reached = (seen >= 0.75 * seen[:, -1:]).argmax(axis=1)
    found = knee * np.expm1((reached + 0.5) / 64)
    found[0] = 0
    return np.asarray(found, np.float64)


@njit(cache=True, nogil=True)
def _count_densities(labels, density, air, knee, bins):  # type: ignore[no-untyped-def]
    """Count log densities above air, label by label."""
    for z in range(labels.shape[0]):
        for y in range(labels.shape[1]):
            for x in range(labels.shape[2]):
                name = labels[z, y, x]
                if name == 0:
                    continue
                rise = np.float64(density[z, y, x]) - air
                place = 0
                if rise > 0:
                    place = min(int(64 * np.log1p(rise / knee)), BINS - 1)
                bins[name, place] += 1


@njit(cache=True, nogil=True)
def _find_cores(labels, density, levels, kinds, found):  # type: ignore[no-untyped-def]
    """Write the kind of host of every voxel that is dense enough for a core, plus 1."""
    for z in range(labels.shape[0]):
        for y in range(labels.shape[1]):
            for x in range(labels.shape[2]):
                name = labels[z, y, x]
                if density[z, y, x] >= levels[name]:
                    found[z, y, x] = kinds[name] + 1
