"""Long thin supports under a bag: scanner tables, belts and trays, which touch everything."""

from __future__ import annotations

import edt
import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.checks import Spacing
from napari_unpack.segmentation.pads import pad_and_beyond

MOST = 0.4
"""Share of all matter that supports are at most; more of it is no support but the bag."""


def find_supports(
    matter: NDArray[np.bool_],
    spacing: Spacing,
    thickness: float = 12.0,
    width: float = 120.0,
    persistence: float = 0.8,
) -> NDArray[np.bool_]:
    """Find thin things of constant cross-section that run the whole length of the volume.

    Parameters
    ----------
    matter : (Z, Y, X) ndarray of bool
        Foreground.
    spacing : (float, float, float)
        Voxel size z y x, mm.
    thickness : float
        A support's walls are at most this thick, mm.
    width : float
        Its cross-section is at least this wide, mm, and so is its length.
    persistence : float
        Fraction of the slices along its axis in which a point of its cross-section is matter.

    Returns
    -------
    (Z, Y, X) ndarray of bool
        Voxels of supports.

    Notes
    -----
    A table or belt is a prism along the direction of travel: seen along that axis it is a set of
    pixels that are matter in nearly every slice, and packed things are not. Along each axis the
    persistent pixels are grouped, kept where nine in ten are thin and the group is wide, joined
    by what else is prismatic inside them (a foam core), by a pad and all beyond (see `pads`), and
    grown a little into their partial-volume rim. Three passes over the volume. A tilted or short
    support is not found by this; it is left to splitting.
    """
    found = np.zeros(matter.shape, np.bool_)
    for axis in range(3):
        length = matter.shape[axis] * spacing[axis]
        others = [a for a in range(3) if a != axis]
        extent = max(matter.shape[a] * spacing[a] for a in others)
        if length < width or extent < 1.5 * width:
            continue
        plane = (spacing[others[0]], spacing[others[1]])
        share = matter.mean(axis=axis, dtype=np.float32)
        section = _thin_and_wide(share, persistence, plane, thickness, width)
        if not _leaves_the_scan(section, matter, axis):
            continue
        section = _with_cores(section, share)
        section |= _beyond(section, share, plane)
        if float(share[section].sum()) <= MOST * float(share.sum()):
            found |= np.expand_dims(section, axis)
    return found & matter if found.any() else found


def _leaves_the_scan(
    section: NDArray[np.bool_], matter: NDArray[np.bool_], axis: int, slices: int = 2
) -> bool:
    """Tell whether most of a cross-section is matter at both ends of the scan.

    A table or belt is longer than what is scanned of it; the wall of a carton in a bag is not.
    """
    if not section.any():
        return False
    ends = np.moveaxis(matter, axis, 0)
    return all(
        float(np.any(end, axis=0)[section].mean()) >= 0.5 for end in (ends[:slices], ends[-slices:])
    )


def _beyond(
    section: NDArray[np.bool_], share: NDArray[np.float32], spacing: tuple[float, float]
) -> NDArray[np.bool_]:
    rows, columns = (np.flatnonzero(section.any(axis=a)) for a in (1, 0))
    if np.ptp(columns) * spacing[1] >= np.ptp(rows) * spacing[0]:
        return pad_and_beyond(share, section, spacing)
    return pad_and_beyond(share.T, section.T, spacing[::-1]).T


def _thin_and_wide(
    share: NDArray[np.float32],
    persistence: float,
    spacing: tuple[float, float],
    thickness: float,
    width: float,
) -> NDArray[np.bool_]:
    """Return the pixels of persistent thin pieces, with what is half as persistent beside them."""
    import cc3d
    from scipy.ndimage import binary_dilation

    section = share >= persistence
    pieces, count = cc3d.connected_components(section, connectivity=8, return_N=True)
    keep = np.zeros(count + 1, np.bool_)
    depth = edt.edt(section, anisotropy=spacing, black_border=False)
    for piece in range(1, count + 1):
        rows, columns = np.nonzero(pieces == piece)
        spans = (np.ptp(rows) * spacing[0], np.ptp(columns) * spacing[1])
        if max(spans) >= width:
            keep[piece] = 2 * np.quantile(depth[rows, columns], 0.9) <= thickness
    return np.asarray(
        binary_dilation(keep[pieces], np.ones((3, 3)), iterations=4, mask=share >= persistence / 2)
    )


def _with_cores(
    section: NDArray[np.bool_], share: NDArray[np.float32], doubt: float = 0.2
) -> NDArray[np.bool_]:
    """Add the holes of a support's cross-section that are the same in nearly every slice."""
    import cc3d
    from scipy.ndimage import binary_closing, binary_dilation

    walls = binary_closing(np.pad(section, 4), np.ones((3, 3)), iterations=3)[4:-4, 4:-4]
    holes, count = cc3d.connected_components(~walls, connectivity=4, return_N=True)
    changes = np.minimum(share, 1 - share)
    rim = np.zeros(count + 1, np.bool_)
    for edge in (holes[0], holes[-1], holes[:, 0], holes[:, -1]):
        rim[edge] = True
    pixels = np.maximum(np.bincount(holes.reshape(-1), minlength=count + 1), 1)
    mean = np.bincount(holes.reshape(-1), changes.reshape(-1), count + 1) / pixels
    core = ~rim & (mean <= doubt)
    core[0] = False
    cores = binary_dilation(core[holes], np.ones((3, 3)), iterations=2)
    return np.asarray(section | (cores & walls) | core[holes])
