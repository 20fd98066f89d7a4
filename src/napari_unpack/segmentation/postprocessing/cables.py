"""Cables, cords and chains: threads that wind through lighter things and come apart there."""

from __future__ import annotations

import edt
import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.kernels import njit
from napari_unpack.segmentation.common.array_source import grown, strides_of
from napari_unpack.segmentation.common.density_regions import SOLID_METAL, DensityScale
from napari_unpack.segmentation.common.mask_components import mask_components
from napari_unpack.segmentation.foreground.methods import typical_knee
from napari_unpack.tasks import SILENT, Share

# Log density from which a thread lies, up to solid metal: several tools and keys touch, and none
# of them winds. The foreground's median lies at 1.6.
DENSE = 2.2
# The log density bends by so much a voxel^2 across a thread, along two directions; along the third
# by less than half of it.
SHARP = 0.3
# Voxels from the middle line of a thread to its surface at most.
RADIUS = 2.5
# Share of an object that is thread where it is a cable, and below which a cable merely winds
# through it.
MOSTLY, HARDLY = 0.35, 0.3
# The share that is thread of all in an object that is as dense, around it, unless it is the rim or
# the edge of something.
ALONE = 0.6
# Voxels of middle line.
FEWEST = 60
# Voxels of a middle line: more than the end of a strand that lies across another has.
LEAST_SHARED_LINE = 20


def gather_cables(
    labels: NDArray[np.int32],
    density: NDArray[np.generic],
    scale: DensityScale | None = None,
    share: Share = SILENT,
) -> NDArray[np.int32]:
    """Give cables what belongs to them of the objects they wind through.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Objects 1, 2, ...; 0 background. Not changed.
    density : (Z, Y, X) ndarray
    scale : DensityScale, optional
        How densities are compared; by default as the median of what is labelled says.
    share : Share

    Notes
    -----
    Threads are where the Hessian of the log density, at a scale of one voxel, has two large
    negative eigenvalues and a small one (Sato et al., Medical Image Analysis 2(2) 1998). Those
    whose middle lines are two voxels apart are one bundle. A bundle changes nothing unless an
    object is mostly thread of it: the rim of a can and the edge of a box are threads too.
    """
    compared = scale or scale_of(labels, density)
    if compared is None:
        return labels
    lifted = np.zeros(density.shape, np.float32)
    _lift(density, compared.air, compared.knee, lifted)
    share(0.2)
    found = _find_threads(lifted)
    share(0.5)
    if len(found) < FEWEST:
        return labels
    lines = np.zeros(lifted.shape, np.bool_)
    lines.reshape(-1)[found] = True
    wide = np.zeros_like(lines)
    # No line lies on the volume's border.
    wide.reshape(-1)[found[:, None] + _offsets(lines.shape, 1)] = True
    bundles, _ = mask_components(wide)
    boxes = label_boxes(bundles)
    one, other = bundles.reshape(-1)[found], labels.reshape(-1)[found]
    middles = np.bincount(one, minlength=int(bundles.max()) + 1)
    sizes = np.bincount(labels.reshape(-1))
    result = labels.copy()
    for name in share.part(0.6, 1.0).over(boxes.ids[middles[boxes.ids] >= FEWEST].tolist()):
        of = other[one == name]
        # A thread has no more than some 20 voxels to one of its middle line.
        lined = np.bincount(of, minlength=len(sizes)) > MOSTLY / 20 * sizes
        if not lined[1:].any():
            continue
        box = grown(boxes.slices(name), 3, labels.shape)
        mine = lines[box] & (bundles[box] == name)
        given = _given(labels[box], lifted[box], mine, sizes)
        result[box] = np.where(given > 0, given, result[box])
    return result


def scale_of(labels: NDArray[np.int32], density: NDArray[np.generic]) -> DensityScale | None:
    """Return how densities compare, by what is labelled; None where nothing is, or everything.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        0 is background.
    density : (Z, Y, X) ndarray
    """
    thin = tuple(slice(None, None, max(1, n // 128)) for n in labels.shape)
    around = density[thin][labels[thin] == 0].astype(np.float64)
    around = around[np.isfinite(around)]
    if not len(around) or not labels.any():
        return None
    air = float(np.median(around))
    return DensityScale(air, typical_knee(density, labels > 0, air))


def _given(
    labels: NDArray[np.int32],
    lifted: NDArray[np.float32],
    lines: NDArray[np.bool_],
    sizes: NDArray[np.int64],
) -> NDArray[np.int32]:
    """Return the cable that each voxel around one bundle goes to, 0 where nothing changes."""
    nothing = np.zeros_like(labels)
    # Half as dense as the middle of the thread.
    level = float(np.median(lifted[lines])) - float(np.log(2))
    if level > SOLID_METAL:
        return nothing
    bright = lifted >= level
    near = edt.edt(~lines, black_border=False)
    thread = (near <= RADIUS) & bright
    count = len(sizes)
    # With its insulation, whose blurred rim is not as bright.
    whole = thread | (near <= 1)
    shares = np.bincount(labels[whole], minlength=count) / np.maximum(sizes, 1)
    glowing = np.bincount(labels[bright], minlength=count)
    own = np.bincount(labels[thread], minlength=count) >= ALONE * glowing
    own[0] = False
    cables = np.flatnonzero(own & (shares >= MOSTLY))
    if not len(cables):
        return nothing
    hosts = own & (shares < HARDLY)
    # Of background only whole threads, not the blurred rim of the cable.
    lost = (labels == 0) & (edt.edt(~(lines & (labels == 0)), black_border=False) <= RADIUS)
    keeper = int(cables[np.argmax(sizes[cables])])
    strands = (near <= RADIUS) & np.isin(labels, _going_on(labels, lines, cables, keeper))
    taken = (whole & hosts[labels]) | (thread & lost) | strands
    return np.where(taken, np.int32(keeper), nothing)


def _going_on(
    labels: NDArray[np.int32], lines: NDArray[np.bool_], cables: NDArray[np.int64], keeper: int
) -> NDArray[np.int64]:
    """Return the cables most of whose middle lines go on in another: strands of one cable."""
    # Lines of cables that merely touch lie two radii apart, and are not connected.
    threads, _ = mask_components(lines)
    kept = np.bincount(threads[lines & (labels == keeper)], minlength=int(threads.max()) + 1)
    others = [int(w) for w in cables if w != keeper]
    shared = {w: kept[threads[lines & (labels == w)]] >= LEAST_SHARED_LINE for w in others}
    return np.array([w for w in others if shared[w].mean() > 0.5], np.int64)


def _offsets(shape: tuple[int, ...], reach: int) -> NDArray[np.int64]:
    """Return how far a cube of (2 reach + 1)^3 voxels reaches in a flat volume, (N,)."""
    strides = strides_of(shape)
    t = np.arange(-reach, reach + 1)
    around: NDArray[np.int64] = (
        strides[0] * t[:, None, None] + strides[1] * t[:, None] + strides[2] * t
    ).reshape(-1)
    return around


def _find_threads(lifted: NDArray[np.float32]) -> NDArray[np.int64]:
    """Return where in a flat volume the middle lines of threads lie, by the Hessian."""
    marked, sharp = np.zeros(lifted.shape, np.bool_), np.float32(SHARP)
    _mark_ridges(lifted, np.float32(DENSE), sharp, REACH, marked)
    places = np.flatnonzero(marked)
    bends = np.zeros((len(places), 6), np.float32)
    around = _offsets(lifted.shape, REACH)
    _bend(lifted.reshape(-1), places, around, _kernels().reshape(6, -1), bends)
    # Few are left by their trace, which is that of the eigenvalues.
    steep = bends[:, 0] + bends[:, 1] + bends[:, 2] <= -1.5 * sharp
    places, bends = places[steep], bends[steep].astype(np.float64)
    _, middle, most = np.linalg.eigvalsh(bends[:, HESSIAN]).T
    return places[(middle < -sharp) & (np.abs(most) < -0.5 * middle)]


# Voxels to every side at which a Gaussian of one voxel has ended.
REACH = 3
# Where zz, yy, xx, zy, zx, yx lie in the matrix.
HESSIAN = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])


def _kernels() -> NDArray[np.float32]:
    """Return the second derivatives of a Gaussian along zz, yy, xx, zy, zx, yx, (6, n, n, n)."""
    t = np.arange(-REACH, REACH + 1.0)
    g = np.exp(-(t**2) / 2)
    g /= g.sum()
    first = t * g
    second = (t**2 - 1) * g
    second -= g * second.sum()
    lines = (g, first, second)
    orders = ((2, 0, 0), (0, 2, 0), (0, 0, 2), (1, 1, 0), (1, 0, 1), (0, 1, 1))
    made = [np.einsum("i,j,k->ijk", *(lines[o] for o in order)) for order in orders]
    return np.stack(made).astype(np.float32)


@njit(cache=True, nogil=True)
def _lift(density, air, knee, lifted):  # type: ignore[no-untyped-def]
    """Write the log density to an array of zeros."""
    depth, height, width = density.shape
    for z in range(depth):
        for y in range(height):
            for x in range(width):
                rise = np.float64(density[z, y, x]) - air
                if rise > 0:
                    lifted[z, y, x] = np.log1p(min(rise / knee, 1e30))


@njit(cache=True, nogil=True)
def _mark_ridges(values, dense, sharp, reach, marked):  # type: ignore[no-untyped-def]
    """Mark what is dense and falls on both sides along one axis at least: cheap to ask."""
    depth, height, width = values.shape
    for z in range(reach, depth - reach):
        for y in range(reach, height - reach):
            for x in range(reach, width - reach):
                if values[z, y, x] < dense:
                    continue
                here = 2 * values[z, y, x]
                marked[z, y, x] = (
                    here - values[z - 2, y, x] - values[z + 2, y, x] > sharp
                    or here - values[z, y - 2, x] - values[z, y + 2, x] > sharp
                    or here - values[z, y, x - 2] - values[z, y, x + 2] > sharp
                )


@njit(cache=True, nogil=True)
def _bend(values, places, around, kernels, bends):  # type: ignore[no-untyped-def]
    """Write the second derivatives at places of a flat volume to rows of zeros."""
    for n in range(len(places)):
        for k in range(len(around)):
            value = values[places[n] + around[k]]
            for axes in range(6):
                bends[n, axes] += value * kernels[axes, k]
