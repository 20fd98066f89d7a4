"""What the scanner puts into a volume: a round field of view, a table or belt, and its pad.

Beyond the round field of view nothing was measured. Tables, belts and trays are long, thin, and
touch everything; a pad is a soft thin outline between the table and the bag.
"""

from __future__ import annotations

import cc3d
import edt
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_dilation, maximum_filter1d

from napari_unpack.kernels import njit
from napari_unpack.segmentation.common.mask_components import mask_components
from napari_unpack.segmentation.common.validation import Spacing

# Voxels around a table that are its blur: a scan blurs its edges over two.
SUPPORT_RIM = 3

# A field of view is round where at least this share of the corners holds one same value.
PADDED = 0.98
# Pixels within this of the circle's edge are not trusted.
CIRCLE_RIM = 3.5


def measured_section(density: NDArray[np.generic]) -> NDArray[np.bool_] | None:
    """Return the pixels of a slice that the scanner measured, where its field of view is round.

    Parameters
    ----------
    density : (Z, Y, X) ndarray

    Returns
    -------
    (Y, X) ndarray of bool or None
        None where the field of view is not round.
    """
    # Reconstructions fill the corners outside the circle inscribed in the slice with a constant,
    # and the last pixels of the circle hold the jump to it: a ring through all slices. At most 32
    # slices are looked at.
    _, height, width = density.shape
    if height != width or height < 32:
        return None
    y, x = np.ogrid[:height, :width]
    middle = (width - 1) / 2
    radius = np.hypot(y - middle, x - middle)
    slices = density[:: max(1, len(density) // 32)]
    if slices.dtype.kind == "f":
        # What was not measured is a constant too.
        slices = np.nan_to_num(slices, nan=-np.inf, posinf=np.inf, neginf=-np.inf)
    corners = slices[:, radius > middle + 2.5]
    same = corners == corners.reshape(-1)[0]
    if same.mean() < PADDED or not _noisy_all_round(slices, radius, corners.reshape(-1)[0]):
        return None
    return np.asarray(radius <= middle - CIRCLE_RIM)


def _noisy_all_round(
    slices: NDArray[np.generic], radius: NDArray[np.float64], padding: np.generic
) -> bool:
    """Return whether every sixteenth of the circle's outermost pixels differs from the padding."""
    middle = (radius.shape[1] - 1) / 2
    rows, columns = np.nonzero((radius < middle) & (radius > middle - 12))
    differs = (slices[:, rows, columns] != padding).mean(axis=0)
    sector = ((np.arctan2(rows - middle, columns - middle) / np.pi + 1) * 8).astype(int) % 16
    share = np.bincount(sector, differs, 16) / np.maximum(np.bincount(sector, minlength=16), 1)
    return float(share.min()) > 0.05


# mm between the table and the outline of a pad, at most.
THICKEST_PAD = 40.0
# Share of the slices in which the outline of a pad is foreground where it is clear.
CLEAR = 0.55
# Share of what lies under a clear outline that is foreground, at most.
EMPTINESS = 0.25


def _pad_and_beyond(
    share: NDArray[np.float32], table: NDArray[np.bool_], spacing: tuple[float, float]
) -> NDArray[np.bool_]:
    """Find the cross-section of a table's pad, and of all that lies behind it or the table."""
    # `share` is the share of slices in which a pixel of the cross-section is foreground. A pad's
    # outline is the most persistent line that moves at most one pixel a column, found by dynamic
    # programming: under the bag's weight it wanders from slice to slice, so that a threshold would
    # lose it there.
    if not table.any():
        return np.zeros_like(table)
    columns = np.flatnonzero(table.any(axis=0))
    heights = np.arange(len(table))[:, None]
    middle = heights.mean() if not share.any() else np.average(heights[:, 0], weights=share.sum(1))
    if middle > np.average(heights[:, 0], weights=table.sum(axis=1)):
        return _pad_and_beyond(share[::-1], table[::-1], spacing)[::-1]
    surface = table[:, columns].argmax(axis=0)
    reach = min(int(THICKEST_PAD / spacing[0]), int(surface.min()))
    behind = np.zeros_like(table)
    behind[:, columns] = heights >= surface
    if reach < 4 or len(columns) < 16:
        return behind
    rows = surface[None, :] - 2 - np.arange(reach - 2)[:, None]
    band = maximum_filter1d(share, 3, axis=0)[rows, columns]
    lift = _ridge(np.ascontiguousarray(band), surface)
    found = band[lift, np.arange(len(columns))]
    distinct = found >= CLEAR
    under = (np.arange(reach - 2)[:, None] < lift[None, :] - 1) & distinct
    inside = share[rows, columns][under]
    if distinct.mean() < 0.25 or not len(inside) or inside.mean() > EMPTINESS:
        return behind
    top = surface - 2 - lift - 1
    behind[:, columns] = heights >= top - 1
    return behind


@njit(cache=True, nogil=True)
def _ridge(band, surface):  # type: ignore[no-untyped-def]
    """Return the height of the path of largest sum over the columns of a band."""
    height, width = band.shape
    total = np.full((height, width), -1e9)
    came = np.zeros((height, width), np.int64)
    for k in range(height):
        total[k, 0] = band[k, 0]
    for x in range(1, width):
        slope = surface[x] - surface[x - 1]
        for k in range(height):
            for move in (0, -1, 1):
                j = k - slope + move
                if 0 <= j < height and total[j, x - 1] > total[k, x] - band[k, x]:
                    total[k, x] = total[j, x - 1] + band[k, x]
                    came[k, x] = j
    path = np.zeros(width, np.int64)
    path[-1] = np.argmax(total[:, -1])
    for x in range(width - 1, 0, -1):
        path[x - 1] = came[path[x], x]
    return path


# Share of the foreground that supports are at most; more of it is no support but the bag.
LARGEST_SUPPORT = 0.4
# mm that its walls are thick at most.
SUPPORT_THICKNESS = 12.0
# mm that its cross-section is wide at least, and that it is long.
SUPPORT_WIDTH = 120.0
# Share of the slices along its axis in which a point of its cross-section is foreground.
PERSISTENCE = 0.8


def find_supports(foreground: NDArray[np.bool_], spacing: Spacing) -> NDArray[np.bool_]:
    """Find thin things of constant cross-section that run the whole length of the volume.

    Parameters
    ----------
    foreground : (Z, Y, X) ndarray of bool
    spacing : (float, float, float) of mm, z y x
    """
    # A table or belt is a prism along the direction of travel: seen along that axis it is a set of
    # pixels that are foreground in nearly every slice, and packed things are not. Along each axis
    # the persistent pixels are grouped, kept where nine in ten are thin and the group is wide,
    # joined by what else is prismatic inside them (a foam core), by `_pad_and_beyond`, and grown a
    # little into their partial-volume rim. Three passes over the volume. A tilted or short support
    # is not found by this; it is left to splitting.
    found = np.zeros(foreground.shape, np.bool_)
    for axis in range(3):
        length = foreground.shape[axis] * spacing[axis]
        others = [a for a in range(3) if a != axis]
        extent = max(foreground.shape[a] * spacing[a] for a in others)
        if length < SUPPORT_WIDTH or extent < 1.5 * SUPPORT_WIDTH:
            continue
        plane = (spacing[others[0]], spacing[others[1]])
        share = foreground.mean(axis=axis, dtype=np.float32)
        section = _thin_and_wide(share, plane)
        if not _leaves_the_scan(section, foreground, axis):
            continue
        section = _with_cores(section, share)
        section |= _beyond(section, share, plane)
        if float(share[section].sum()) <= LARGEST_SUPPORT * float(share.sum()):
            found |= np.expand_dims(section, axis)
    return found & foreground if found.any() else found


def _leaves_the_scan(section: NDArray[np.bool_], foreground: NDArray[np.bool_], axis: int) -> bool:
    """Return whether most of a cross-section is foreground at both ends of the scan."""
    # A table or belt is longer than what is scanned of it; the wall of a carton in a bag is not.
    if not section.any():
        return False
    ends = np.moveaxis(foreground, axis, 0)
    return all(float(np.any(end, axis=0)[section].mean()) >= 0.5 for end in (ends[:2], ends[-2:]))


def _beyond(
    section: NDArray[np.bool_], share: NDArray[np.float32], spacing: tuple[float, float]
) -> NDArray[np.bool_]:
    """Find what lies behind a support, whichever way its cross-section is wide."""
    rows, columns = (np.flatnonzero(section.any(axis=a)) for a in (1, 0))
    if np.ptp(columns) * spacing[1] >= np.ptp(rows) * spacing[0]:
        return _pad_and_beyond(share, section, spacing)
    return _pad_and_beyond(share.T, section.T, spacing[::-1]).T


def _thin_and_wide(share: NDArray[np.float32], spacing: tuple[float, float]) -> NDArray[np.bool_]:
    """Return the pixels of persistent thin pieces, with what is half as persistent beside them."""
    section = share >= PERSISTENCE
    pieces, count = mask_components(section)
    keep = np.zeros(count + 1, np.bool_)
    depth = edt.edt(section, anisotropy=spacing, black_border=False)
    for piece in range(1, count + 1):
        rows, columns = np.nonzero(pieces == piece)
        spans = (np.ptp(rows) * spacing[0], np.ptp(columns) * spacing[1])
        if max(spans) >= SUPPORT_WIDTH:
            keep[piece] = 2 * np.quantile(depth[rows, columns], 0.9) <= SUPPORT_THICKNESS
    return np.asarray(
        binary_dilation(keep[pieces], np.ones((3, 3)), iterations=4, mask=share >= PERSISTENCE / 2)
    )


# Share of the slices that differ from most, on average over a hole of a support.
DOUBT = 0.2


def _with_cores(section: NDArray[np.bool_], share: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Add the holes of a support's cross-section that are the same in nearly every slice."""
    walls = binary_closing(np.pad(section, 4), np.ones((3, 3)), iterations=3)[4:-4, 4:-4]
    holes, count = cc3d.connected_components(~walls, connectivity=4, return_N=True)
    changes = np.minimum(share, 1 - share)
    rim = np.zeros(count + 1, np.bool_)
    for edge in (holes[0], holes[-1], holes[:, 0], holes[:, -1]):
        rim[edge] = True
    pixels = np.maximum(np.bincount(holes.reshape(-1), minlength=count + 1), 1)
    mean = np.bincount(holes.reshape(-1), changes.reshape(-1), count + 1) / pixels
    core = ~rim & (mean <= DOUBT)
    core[0] = False
    cores = binary_dilation(core[holes], np.ones((3, 3)), iterations=2)
    return np.asarray(section | (cores & walls) | core[holes])
