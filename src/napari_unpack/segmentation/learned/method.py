"""The default method: a network's affinities, fragments between them, and classifiers of pairs.

The volume is first split a little too far (`oversegment`): fragments are linked by mean affinity.
Then parts are merged by how they meet, split at their density steps, merged again, and their
borders are drawn, each decided by a trained classifier.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cc3d
import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.common.density_regions import (
    DensityScale,
    label_means,
    log_density,
)
from napari_unpack.segmentation.common.depths import label_depths
from napari_unpack.segmentation.common.flooding import flood
from napari_unpack.segmentation.common.joins import JoinLog, Level, Seen, Steps
from napari_unpack.segmentation.common.merging import absorb_small
from napari_unpack.segmentation.common.morphology import dilate
from napari_unpack.segmentation.common.region import MIN_OBJECT_VOXELS, fewest_voxels
from napari_unpack.segmentation.common.validation import Spacing
from napari_unpack.segmentation.foreground.bag_shell import drop_skin, find_case, find_shell
from napari_unpack.segmentation.foreground.methods import ForegroundOptions, typical_knee
from napari_unpack.segmentation.foreground.scanner_table import (
    SUPPORT_RIM,
    find_supports,
    measured_section,
)
from napari_unpack.segmentation.foreground.streaks import find_streaks, without_streaks
from napari_unpack.segmentation.foreground.thresholds import Levels, median_step
from napari_unpack.segmentation.learned.affinity_linkage import (
    LinkageThreshold,
    mean_affinity_linkage,
)
from napari_unpack.segmentation.learned.border_classifier import BorderEvidence, draw_borders
from napari_unpack.segmentation.learned.border_refinement import assign_labels, sharpen_borders
from napari_unpack.segmentation.learned.boundary_network import (
    BoundaryNetwork,
    Prediction,
    default_boundaries,
)
from napari_unpack.segmentation.learned.fragments import (
    cells_with,
    find_fragments,
    measure_affinities,
)
from napari_unpack.segmentation.learned.pair_classifier import AREA
from napari_unpack.segmentation.learned.part_merging import (
    PredictedParts,
    measure_predicted_parts,
    merge_parts,
)
from napari_unpack.segmentation.learned.part_splitting import (
    METAL,
    Pieces,
    merge_pieces,
    split_and_measure,
)
from napari_unpack.tasks import SILENT, Progress, Share

# Voxels from the middle of foreground that the network missed to its surface; the skin of a bag
# is thinner.
LEAST_DEPTH_OF_MISSED = 4.0
# An object rises from air by so many deviations of the noise in this share of its voxels at
# least; a cloud of specks, or noise itself, does not.
NOISE_DEVIATIONS, PLAIN_SHARE = 2.0, 0.15
# Probability from which a voxel is an object's: usually, and above the foreground's level, where
# thin walls of containers are.
FOREGROUND, DENSE = 0.3, 0.1
# Mean probability of the voxels of an object.
OBJECT = 0.5
# Mean affinity of two fragments that are linked; what it leaves apart, `merge_parts` decides.
LINKAGE = LinkageThreshold(0.55, 0.1)
# Where no classifier merges after it, linkage goes on further.
LINKAGE_ALONE = LinkageThreshold(0.45, 0.1)


@dataclass(frozen=True, eq=False)
class Oversegmentation:
    """A volume split a little too far, and what the network predicted of it.

    Parameters
    ----------
    parts : (Z, Y, X) ndarray of int32
        1, 2, ...; 0 is background, which the network takes the bag and the table for.
    measured : PredictedParts
        Of them, for `merge_parts`.
    prediction : Prediction
        Of every voxel and cell.
    scale : DensityScale
        How densities are compared.
    levels : Levels
        Of air and foreground.
    noise : float
        Of the density from one voxel to the next, a standard deviation.
    """

    parts: NDArray[np.int32]
    measured: PredictedParts
    prediction: Prediction
    scale: DensityScale
    levels: Levels
    noise: float


def oversegment(
    density: NDArray[np.generic],
    spacing: Spacing,
    progress: Progress,
    foreground: ForegroundOptions | None = None,
    network: BoundaryNetwork | None = None,
    linkage: LinkageThreshold = LINKAGE,
    noted: Steps | None = None,
) -> Oversegmentation:
    """Split a volume by the network's affinities, a little too far.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
    spacing : (float, float, float) of mm, z y x
    progress : callable
    foreground : ForegroundOptions, optional
        It sets the scale of density; where its method is a number, nothing below that is an object.
    network : BoundaryNetwork, optional
        By default the one that ships with the package.
    linkage : LinkageThreshold
        Of fragments.
    noted : Steps, optional
        Where linkage is noted.
    """
    options, share = foreground or ForegroundOptions(), Share(progress)
    known = options.known
    dense, levels = options.find(density, spacing, share.part(0.0, 0.05))
    knee = typical_knee(density, dense, levels.air) if known is None else known.knee
    scale = DensityScale(levels.air, knee)
    prediction = (network or default_boundaries()).predict(density, scale, share.part(0.05, 0.65))
    # A voxel far from all that is dense is no object, whatever the network predicts.
    mask = dilate(dense) & (prediction.foreground >= 255 * FOREGROUND)
    mask |= dense & (prediction.foreground >= 255 * DENSE)
    section = measured_section(density) if known is None else None
    if section is not None:
        mask &= section
        dense = dense & section
    if options.supports:
        held = find_supports(dense, spacing)
        dense = dense & ~held
        # What is not dense beside a support is its blurred rim.
        held = dilate(held, iterations=SUPPORT_RIM)
        mask &= dense | ~held
    share(0.65, "Finding fragments")
    fragments = find_fragments(prediction.far, cells_with(mask))
    linking = share.part(0.7, 0.76, "Linking fragments")
    affinities = measure_affinities(fragments, prediction.far, linking)
    linking(1.0)
    log = JoinLog()
    owner = mean_affinity_linkage(affinities, np.bincount(fragments.reshape(-1)), linkage, log)
    drawing = share.part(0.78, 0.9, "Drawing borders")
    cells_owned, part = owner.astype(np.int32)[fragments], drawing.part(0.0, 0.2)
    parts = assign_labels(cells_owned, mask, prediction.next, share=part)
    if noted is not None:
        linked = Level.of(log, fragments, affinities.pairs, affinities.touching)
        noted.seen = Seen(density, scale, prediction.foreground)
        names = assign_labels(linked.names, mask, prediction.next, share=drawing.part(0.2, 0.4))
        noted.levels.append(replace(linked, names=names))
    parts = _above_mean(parts, prediction.foreground, 255 * OBJECT, drawing.part(0.4, 0.5))
    noise = noise_deviation(density)
    plain = np.greater(density, levels.air + NOISE_DEVIATIONS * noise)
    parts = _above_mean(parts, plain.astype(np.uint8), PLAIN_SHARE, drawing.part(0.5, 0.6))
    if options.supports:
        parts = _above_mean(parts, (~held).astype(np.uint8), 0.5, drawing.part(0.6, 0.7))
    # A sharp corner belongs to its object even where the network doubts it.
    inside = parts > 0
    around = inside | (dense & dilate(inside))
    parts = flood(parts, around, share=drawing.part(0.7, 1.0))
    missing = share.part(0.9, 1.0, "Looking for what the network missed")
    parts = with_missed(parts, dense, options.shell, spacing, missing.part(0.0, 0.5))
    if options.shell and known is None:
        # In a block of a volume a large carton looks like a case.
        parts[find_case(parts)[parts]] = 0
    parts, measured = measure_predicted_parts(
        parts, density, spacing, scale, affinities, owner, missing.part(0.5, 1.0)
    )
    return Oversegmentation(parts, measured, prediction, scale, levels, noise)


def find_objects(
    density: NDArray[np.generic],
    spacing: Spacing,
    progress: Progress,
    foreground: ForegroundOptions | None = None,
    *,
    smallest: float = 0.0,
    by_default: bool = False,
    steps: bool = True,
    noted: Steps | None = None,
    network: BoundaryNetwork | None = None,
) -> NDArray[np.int32]:
    """Find the objects of a volume by the learned method; 0 is background.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
    spacing : (float, float, float) of mm, z y x
    progress : callable
    foreground : ForegroundOptions, optional
    smallest : float
        As for `pipeline.segment`, mm^3.
    by_default : bool
        Nobody has asked for this size; see `fewest_voxels`.
    steps : bool
        Merge parts, split them at density steps, draw borders there and keep small metal.
    noted : Steps, optional
        Where what is joined and what is left apart is noted, step by step.
    network : BoundaryNetwork, optional
        As for `oversegment`.
    """
    share = Share(progress)
    # Of the time, at any size: the network half, the classifier of borders a quarter.
    linkage = LINKAGE if steps else LINKAGE_ALONE
    finding = share.part(0.0, 0.6)
    found = oversegment(density, spacing, finding, foreground, network, linkage, noted)
    if not found.parts.any():
        return found.parts
    voxel = float(np.prod(spacing))
    if by_default:
        smallest = fewest_voxels(found.parts, smallest / voxel) * voxel
    least = max(smallest, MIN_OBJECT_VOXELS * voxel)
    if not steps:
        # The classifiers know no haze: on the nuclei of a plant linkage alone has 0.81 of F1, 0.77
        # with them.
        return absorb_small(found.parts, spacing, least)
    merging = share.part(0.6, 0.8, "Merging parts")
    first = merging.part(0.0, 0.5)
    pieces, measured = split_at_density_steps(density, spacing, found, noted, first)
    labels = _merged(merge_pieces, pieces, measured, noted, merging.part(0.5, 0.7))
    labels = sharpened(labels, density, found, share=merging.part(0.7, 1.0))
    drawing = share.part(0.8, 1.0, "Drawing fine borders")
    evidence = BorderEvidence.of(labels, density, found.scale, found.prediction.next, found.noise)
    labels = draw_borders(labels, evidence, share=drawing.part(0.05, 0.95))
    # Coins and keys are smaller than anything else that is worth its own label.
    few = max(smallest / 4, MIN_OBJECT_VOXELS * voxel) / voxel
    metal = _metal(labels, density, found.scale, few)
    if foreground is None or foreground.shell:
        # Parts were asked the same when they were found; what they took in since may be skin.
        doubted = label_means(labels, found.prediction.foreground) / 255 < OBJECT
        labels = drop_skin(labels, doubted & ~metal, spacing)
    # What goes may be the last of the labels.
    metal = metal[: int(labels.max()) + 1]
    streaks = find_streaks(labels, density, found.levels) & ~metal
    labels, sources = without_streaks(labels, streaks, density, found.scale, few)
    metal = np.concatenate([metal, np.ones(sources, np.bool_)])
    drawing(1.0)
    return absorb_small(labels, spacing, least, metal[: int(labels.max()) + 1])


def _metal(
    labels: NDArray[np.int32], density: NDArray[np.generic], scale: DensityScale, least: float
) -> NDArray[np.bool_]:
    """Return which labels of at least so many voxels are metal."""
    lifted = log_density(density, labels > 0, scale)
    counts = np.bincount(labels.reshape(-1))
    return (counts >= least) & (label_means(labels, lifted) >= np.log1p(METAL))


def _merged(
    merge: Callable[..., NDArray[np.int32]],
    parts: NDArray[np.int32],
    measured: PredictedParts,
    noted: Steps | None,
    share: Share,
) -> NDArray[np.int32]:
    """Merge parts or pieces, and note what was joined."""
    # A merge uses the measurements up.
    log, touching = JoinLog(), measured.contacts.pairs(AREA)
    merged = merge(parts, measured, log=log, share=share)
    if noted is not None:
        noted.levels.append(Level.of(log, parts, *touching))
    return merged


def split_at_density_steps(
    density: NDArray[np.generic],
    spacing: Spacing,
    found: Oversegmentation,
    noted: Steps | None = None,
    share: Share = SILENT,
) -> tuple[NDArray[np.int32], Pieces]:
    """Merge parts, and split what becomes of them at its density steps.

    Parameters
    ----------
    density : (Z, Y, X) ndarray
    spacing : (float, float, float) of mm, z y x
    found : Oversegmentation
        Its measurements are used up.
    noted : Steps, optional
        Where merges of parts are noted.
    share : Share

    Returns
    -------
    pieces : (Z, Y, X) ndarray of int32
        1, 2, ...
    measured : Pieces
        Of them, for `merge_pieces`.
    """
    # The classifier of pieces learned from borders that were not smoothed yet.
    labels = _merged(merge_parts, found.parts, found.measured, noted, share.part(0.0, 0.1))
    labels = sharpened(labels, density, found, 0, share.part(0.1, 0.4))
    far, rest = found.prediction.far, share.part(0.4, 1.0)
    return split_and_measure(labels, density, spacing, found.scale, far, rest)


def sharpened(
    labels: NDArray[np.int32],
    density: NDArray[np.generic],
    found: Oversegmentation,
    smoothing: int = 2,
    share: Share = SILENT,
) -> NDArray[np.int32]:
    """Move the borders of labels to density steps; see `sharpen_borders`.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
    density : (Z, Y, X) ndarray
    found : Oversegmentation
    smoothing : int
        Last rounds, which smooth borders.
    share : Share
    """
    scale, dense = found.scale, METAL * found.scale.knee
    following = found.prediction.next
    return sharpen_borders(
        labels, density, scale.air, following, found.noise, dense, smoothing=smoothing, share=share
    )


def with_missed(
    parts: NDArray[np.int32],
    dense: NDArray[np.bool_],
    shell: bool,
    spacing: Spacing,
    share: Share,
) -> NDArray[np.int32]:
    """Add thick foreground that the network took for none: it was not trained on everything.

    Parameters
    ----------
    parts : (Z, Y, X) ndarray of int32
        1, 2, ...; 0 is none.
    dense : (Z, Y, X) ndarray of bool
        The foreground.
    shell : bool
        Leave out what is the bag itself, and want more depth of the rest.
    spacing : (float, float, float) of mm, z y x
    share : Share

    Returns
    -------
    (Z, Y, X) ndarray of int32
        The parts under their names, and further ones.
    """
    rest = cc3d.connected_components(dense & (parts == 0), connectivity=6).astype(np.int32)
    share(0.1)
    deepest, depth = np.zeros(int(rest.max()) + 1), label_depths(rest)
    share(0.4)
    for a, b in share.part(0.4, 0.6).slabs(rest.shape):
        inside = rest[a:b] > 0
        np.maximum.at(deepest, rest[a:b][inside], depth[a:b][inside])
    thick = deepest >= (LEAST_DEPTH_OF_MISSED if shell else 1)
    thick[0] = False
    top = int(parts.max())
    names = np.where(thick, np.cumsum(thick) + top, 0).astype(np.int32)
    together = np.where(parts > 0, parts, names[rest])
    if shell:
        skin = find_shell(together, spacing, share=share.part(0.6, 1.0))
        # Only what the network missed may be the bag: its own parts it has told from it.
        skin[: top + 1] = False
        together[skin[together]] = 0
    return together


def noise_deviation(density: NDArray[np.generic]) -> float:
    """Return the standard deviation of the noise from one voxel to the next; NaN is left out."""
    # Edges are too few to count.
    rows = density.reshape(-1, density.shape[2])
    return median_step(rows[:: max(1, rows.size // 2_000_000)]) / 0.954


def _above_mean(
    parts: NDArray[np.int32], values: NDArray[np.uint8], least: float, share: Share
) -> NDArray[np.int32]:
    """Drop parts whose mean value is below a limit."""
    means = label_means(parts, values)
    share(0.5)
    names = np.where(means >= least, np.arange(len(means)), 0).astype(np.int32)
    return names[parts]
