"""Objects by what a network sees: fragments between its boundaries, joined by its affinities."""

from __future__ import annotations

from dataclasses import dataclass, field

import cc3d
import edt
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from napari_unpack.segmentation.common.density_regions import MaterialScale, log_density
from napari_unpack.segmentation.common.flooding import flood
from napari_unpack.segmentation.common.merging import absorb_small
from napari_unpack.segmentation.common.region import FEWEST
from napari_unpack.segmentation.common.validation import Spacing
from napari_unpack.segmentation.foreground.bag_shell import find_shell
from napari_unpack.segmentation.foreground.methods import find_matter, typical_knee
from napari_unpack.segmentation.foreground.scanner_table import find_supports, measured_section
from napari_unpack.segmentation.learned.affinity_linkage import Bar, link
from napari_unpack.segmentation.learned.border_classifier import Scene, draw_borders
from napari_unpack.segmentation.learned.border_refinement import resolve, sharpen
from napari_unpack.segmentation.learned.boundary_network import (
    BoundaryNetwork,
    Prediction,
    Tell,
    default_boundaries,
)
from napari_unpack.segmentation.learned.fragments import cells_with, find_fragments, tie
from napari_unpack.segmentation.learned.part_merging import SeenParts, join_seen, seen_parts
from napari_unpack.segmentation.learned.part_splitting import DENSE, Pieces, part_seen, pieces_of

# Voxels from the middle of a thing to its surface; the skin of a bag is thinner.
THICK = 4.0
# Voxels.
RIM = 3
# Share of an object that rises from air by so many deviations of the noise: a cloud of specks
# or noise itself does not.
PLAIN, CONTRAST = 0.15, 2.0


@dataclass(frozen=True)
class JoinRule:
    """When the network's word is taken.

    Parameters
    ----------
    matter : float
        Probability from which a voxel is an object's.
    dense : float
        And from which one is that is dense enough to be matter by itself: what closes the wall
        of a container.
    object : float
        Mean probability of its voxels from which something is an object.
    together : Bar
        From which mean probability two fragments are joined; only what is safe, see `joining`.
    weights : (4,) tuple of float
        Of pairs of cells in that mean, by reach.
    """

    matter: float = 0.3
    dense: float = 0.1
    object: float = 0.5
    together: Bar = field(default_factory=lambda: Bar(0.4, 0.1))
    weights: tuple[float, ...] = (1.0, 2.0, 2.0, 2.0)


@dataclass(frozen=True, eq=False)
class Seen:
    """A volume taken apart a little too far, and what the network said of it.

    Parameters
    ----------
    parts : (Z, Y, X) ndarray of int32
        1, 2, ...; 0 is background, which the network takes the bag and the table for.
    measured : SeenParts
        Of them, for `joining.join_seen`.
    said : Prediction
        Of every voxel and cell.
    scale : MaterialScale
        How densities are compared.
    weights : (K,) ndarray of float64
        Of pairs of cells in a mean, by reach.
    noise : float
        Of the density from one voxel to the next, a standard deviation.
    """

    parts: NDArray[np.int32]
    measured: SeenParts
    said: Prediction
    scale: MaterialScale
    weights: NDArray[np.float64]
    noise: float


def learned_parts(
    density: NDArray[np.generic],
    spacing: Spacing,
    tell: Tell,
    *,
    foreground: str | float = "hysteresis",
    supports: bool = True,
    shell: bool = True,
    network: BoundaryNetwork | None = None,
    rule: JoinRule | None = None,
) -> Seen:
    """Take a volume apart as the network sees it, a little too far.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
        Checked density.
    spacing : (float, float, float)
        Voxel size z y x, mm.
    tell : callable
        Progress.
    foreground : str or float
        See `matter.checked_way`; it sets the scale of density, and where a number is given
        nothing below it is matter.
    supports : bool
        Leave out the scanner's table.
    shell : bool
        Leave out the bag itself.
    network : BoundaryNetwork, optional
        By default the one that ships with the package.
    rule : JoinRule, optional
        When its word is taken.

    Returns
    -------
    Seen
    """
    limits = rule or JoinRule()
    tell(0.0, "Finding matter")
    seen, levels = find_matter(density, spacing, foreground)
    scale = MaterialScale(levels.air, typical_knee(density, seen, levels.air))
    said = (network or default_boundaries()).predict(
        density, scale, lambda f, text: tell(0.05 + 0.6 * f, text)
    )
    # Whatever the network says, there is nothing far from anything.
    matter = binary_dilation(seen) & (said.matter >= 255 * limits.matter)
    matter |= seen & (said.matter >= 255 * limits.dense)
    section = measured_section(density)
    if section is not None:
        matter &= section
        seen &= section
    if supports:
        held = find_supports(seen, spacing)
        seen &= ~held
        # What is not matter by itself is a support's blurred rim there.
        held = binary_dilation(held, iterations=RIM)
        matter &= seen | ~held
    tell(0.65, "Finding fragments")
    fragments = find_fragments(said.far, cells_with(matter))
    tell(0.75, "Joining fragments")
    ties, weights = tie(fragments, said.far), np.array(limits.weights)
    owner = link(ties, np.bincount(fragments.reshape(-1)), limits.together, weights)
    tell(0.85, "Drawing borders")
    parts = resolve(owner.astype(np.int32)[fragments], matter, said.next)
    parts = _believed(parts, said.matter, 255 * limits.object)
    noise = grain(density)
    plain = np.greater(density, levels.air + CONTRAST * noise)
    parts = _believed(parts, plain.astype(np.uint8), PLAIN)
    if supports:
        parts = _believed(parts, (~held).astype(np.uint8), 0.5)
    # A sharp corner is matter even where the network doubts it.
    inside = parts > 0
    parts = flood(parts, inside | (seen & binary_dilation(inside)))
    tell(0.9, "Looking for what is left")
    parts = _with_the_rest(parts, seen, shell, spacing)
    parts, measured = seen_parts(parts, density, spacing, scale, ties, owner, weights)
    return Seen(parts, measured, said, scale, weights, noise)


def seen_objects(
    density: NDArray[np.generic],
    spacing: Spacing,
    tell: Tell,
    *,
    foreground: str | float = "hysteresis",
    supports: bool = True,
    shell: bool = True,
    smallest: float = 0.0,
    steps: bool = True,
) -> NDArray[np.int32]:
    """Take a volume apart as the network sees it, and put the parts together.

    Parameters
    ----------
    density, spacing, tell, foreground, supports, shell
        As for `learned_parts`.
    smallest : float
        As for `pipeline.segment`, mm^3.
    steps : bool
        Part objects at steps of density, draw borders there and keep small metal.

    Returns
    -------
    (Z, Y, X) ndarray of int32
        Objects; 0 is background.
    """
    seen = learned_parts(
        density, spacing, tell, foreground=foreground, supports=supports, shell=shell
    )
    if not seen.parts.any():
        return seen.parts
    tell(0.9, "Joining parts")
    voxel = float(np.prod(spacing))
    if not steps:
        labels = join_seen(seen.parts, seen.measured)
        return absorb_small(labels, spacing, max(smallest, FEWEST * voxel))
    pieces, measured = pieces_seen(density, spacing, seen)
    tell(0.93, "Joining pieces")
    labels = part_seen(pieces, measured, seen.scale)
    labels = sharpened(labels, density, seen)
    tell(0.94, "Drawing fine borders")
    scene = Scene.of(labels, density, seen.scale, seen.said.next, seen.noise)
    labels = draw_borders(labels, scene)
    metal = _dense(labels, density, seen.scale, max(smallest / 4, FEWEST * voxel) / voxel)
    return absorb_small(labels, spacing, max(smallest, FEWEST * voxel), metal)


def _dense(
    labels: NDArray[np.int32], density: NDArray[np.generic], scale: MaterialScale, least: float
) -> NDArray[np.bool_]:
    """Return which labels of at least so many voxels are metal."""
    lifted = log_density(density, labels > 0, scale).reshape(-1)
    counts = np.bincount(labels.reshape(-1))
    sums = np.bincount(labels.reshape(-1), lifted, len(counts))
    return np.asarray((counts >= least) & (sums >= np.log1p(DENSE) * counts))


def pieces_seen(
    density: NDArray[np.generic], spacing: Spacing, seen: Seen
) -> tuple[NDArray[np.int32], Pieces]:
    """Join parts, and take what becomes of them apart at its steps of density.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
        Density.
    spacing : (float, float, float)
        Voxel size z y x, mm.
    seen : Seen
        Its measurements are used up.

    Returns
    -------
    pieces : (Z, Y, X) ndarray of int32
        1, 2, ...
    measured : Pieces
        Of them, for `parting.part_seen`.
    """
    # The judge of pieces learned from borders as they are.
    labels = sharpened(join_seen(seen.parts, seen.measured), density, seen, evening=0)
    return pieces_of(labels, density, spacing, seen.scale, seen.said.far, seen.weights)


def sharpened(
    labels: NDArray[np.int32], density: NDArray[np.generic], seen: Seen, evening: int = 2
) -> NDArray[np.int32]:
    """Move the borders of labels to where the density steps; see `sharpening.sharpen`."""
    scale, dense = seen.scale, DENSE * seen.scale.knee
    return sharpen(labels, density, scale.air, seen.said.next, seen.noise, dense, evening=evening)


def _with_the_rest(
    parts: NDArray[np.int32], seen: NDArray[np.bool_], shell: bool, spacing: Spacing
) -> NDArray[np.int32]:
    """Add thick matter that the network took for none: it has not seen everything."""
    rest = cc3d.connected_components(seen & (parts == 0), connectivity=6).astype(np.int32)
    deepest = np.zeros(int(rest.max()) + 1)
    np.maximum.at(deepest, rest.reshape(-1), edt.edt(rest, black_border=True).reshape(-1))
    thick = deepest >= (THICK if shell else 1)
    thick[0] = False
    top = int(parts.max())
    names = np.where(thick, np.cumsum(thick) + top, 0).astype(np.int32)
    together = np.where(parts > 0, parts, names[rest])
    if shell:
        skin = find_shell(together, spacing)
        skin[: top + 1] = False
        together[skin[together]] = 0
    return together


def grain(density: NDArray[np.generic]) -> float:
    """Return the noise from one voxel to the next, a standard deviation.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
        NaN is passed over.

    Notes
    -----
    The median of the absolute differences along x over 0.954, which is what it is for white
    noise; edges are too few to matter.
    """
    rows = density.reshape(-1, density.shape[2])
    rows = rows[:: max(1, rows.size // 2_000_000)].astype(np.float64)
    steps = np.abs(np.diff(rows, axis=1))
    steps = steps[np.isfinite(steps)]
    return float(np.median(steps)) / 0.954 if steps.size else 0.0


def _believed(
    parts: NDArray[np.int32], matter: NDArray[np.uint8], least: float
) -> NDArray[np.int32]:
    """Drop parts whose voxels are on average less likely an object's."""
    flat = parts.reshape(-1)
    counts = np.bincount(flat)
    sums = np.bincount(flat, matter.reshape(-1), len(counts))
    names = np.where(sums >= least * counts, np.arange(len(counts)), 0).astype(np.int32)
    return names[parts]
