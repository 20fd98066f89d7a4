"""Recursive splitting (Li et al. 2012, section 3): grow a tree of cuts, then choose its objects.

A cut that frees one of four objects need not raise the confidence at once, so that a rule which
stops at the first cut without gain leaves the others together. Here cuts are grown as far as
confidence may still rise, rated once, and chosen afterwards: trying other rules costs nothing.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from napari_unpack.segmentation.common.region import MIN_OBJECT_VOXELS, Oracle, Region
from napari_unpack.segmentation.isoperimetric.candidates import candidate_cuts
from napari_unpack.tasks import SILENT, Share


@dataclass(frozen=True)
class CutRule:
    """When a cut is kept.

    Parameters
    ----------
    gain : float
        The confidence of the parts exceeds that of the whole by this.
    compactness : float
        Isoperimetric ratio times the cube root of what is cut off is at most this; 1.2 for a cube
        cut off a rod of its own section, 0 where nothing is cut.
    least : bool
        Parts are as good as the worst of them, rather than as their mean by volume.
    """

    gain: float = 0.1
    compactness: float = 1.5
    least: bool = False


# Tried for every volume, from cautious to eager; the confidence chooses one, see `best_rule`.
RULES = tuple(
    CutRule(gain, compactness, least)
    for least, gain, compactness in itertools.product(
        (False, True), (0.25, 0.1, 0.03), (0.7, 1.1, 1.6, 3.0)
    )
)

# Confidence from which a region stays whole without the time for candidates.
SURE_OF_ONE_OBJECT = 0.9
# A cut, or a merge, is followed although it loses so much: the next may win more. Two of four
# objects together look no better than all four.
MOST_CONFIDENCE_LOST = 0.1
# Mean confidence of parts below which nothing is cut further: they look like no object at all.
LEAST_CONFIDENCE_BELOW_FIRST_CUT = 0.05
# Cuts inside each other, which bounds the work on one region.
DEEPEST_CUT = 6


@dataclass(frozen=True, eq=False)
class Node:
    """A region and the best way found to take it apart.

    Parameters
    ----------
    region : Region
        Its voxels.
    confidence : float
        Of being one object.
    parts : tuple of Node
        Empty where it stays whole.
    compactness : float
        Of the cut, see `CutRule`.
    """

    region: Region
    confidence: float
    parts: tuple[Node, ...] = ()
    compactness: float = 0.0


def split_recursively(
    regions: list[Region], oracle: Oracle, smallest: float, share: Share = SILENT
) -> list[Region]:
    """Split regions into what the oracle takes for single objects, in a fixed order.

    Parameters
    ----------
    regions : list of Region
        6-connected regions.
    oracle : callable
        Confidence in [0, 1] that a region is exactly one object.
    smallest : float
        No part is smaller, mm^3.
    share : Share
    """
    # The share of voxels seen is the progress; trees differ too much for more.
    total = max(sum(region.voxels for region in regions), 1)
    seen, trees = 0, []
    for region in regions:
        part = share.part(seen / total, (seen + region.voxels) / total, "Splitting")
        trees.append(grow_cut_tree(region, oracle, smallest, part))
        seen += region.voxels
    if not trees:
        return []
    return [node.region for node in _all(trees, best_rule(trees))]


def grow_cut_tree(
    region: Region,
    oracle: Oracle,
    smallest: float,
    share: Share = SILENT,
    depth: int = 0,
    confidence: float | None = None,
) -> Node:
    """Grow the tree of cuts of a region.

    Parameters
    ----------
    region : Region
        6-connected.
    oracle : callable
        Confidence in [0, 1] that a region is exactly one object.
    smallest : float
        No part is smaller, mm^3.
    share : Share
    depth : int
        Of this region in the tree; below 6 nothing is cut.
    confidence : float, optional
        The region's, where it is known.
    """
    # At every region that is not sure to be one object all candidates are rated, and the cut whose
    # parts are the best by volume is followed, also where it gains nothing yet; one that loses
    # more than 0.1 is not, nor below the first cut one to which hardly any confidence is left. The
    # work is bounded by the depth and the smallest part.
    sure = oracle(region) if confidence is None else confidence
    if sure >= SURE_OF_ONE_OBJECT or depth >= DEEPEST_CUT:
        return Node(region, sure)
    text = f"Splitting: {region.voxels} voxels"
    best: tuple[float, list[Region], list[float], float] | None = None
    candidates = candidate_cuts(
        region,
        max(smallest, MIN_OBJECT_VOXELS * region.voxel_volume / 2),
        share=share.part(0.0, 0.3, text),
    )
    for candidate in share.part(0.3, 0.5, text).over(candidates):
        parts = [region.part(candidate.parts == k) for k in range(1, candidate.parts.max() + 1)]
        scores = [oracle(part) for part in parts]
        volumes = [part.volume for part in parts]
        value = float(np.average(scores, weights=volumes))
        if best is None or value > best[0]:
            small = sum(volumes) - max(volumes)
            best = (value, parts, scores, candidate.ratio * small ** (1 / 3))
    if best is None or best[0] < max(
        sure - MOST_CONFIDENCE_LOST, LEAST_CONFIDENCE_BELOW_FIRST_CUT if depth else 0.0
    ):
        return Node(region, sure)
    nodes, seen = [], 0.5
    for part, score in zip(best[1], best[2], strict=True):
        ended = seen + 0.5 * part.voxels / region.voxels
        below = share.part(seen, min(ended, 1.0), text)
        nodes.append(grow_cut_tree(part, oracle, smallest, below, depth + 1, score))
        seen = ended
    return Node(region, sure, tuple(nodes), best[3])


def selected(node: Node, rule: CutRule) -> list[Node]:
    """Return the nodes that a rule keeps as objects, in the order of the tree.

    Parameters
    ----------
    node : Node
        The tree's root.
    rule : CutRule
    """
    # From the leaves up: a region is taken apart where the best segmentation of its parts beats it
    # by the rule.
    if not node.parts or node.compactness > rule.compactness:
        return [node]
    parts = [leaf for part in node.parts for leaf in selected(part, rule)]
    value = min(leaf.confidence for leaf in parts) if rule.least else mean_confidence(parts)
    return parts if value - node.confidence > rule.gain else [node]


def mean_confidence(parts: Sequence[Node]) -> float:
    """Return the mean confidence of parts, weighted by volume."""
    # A small piece that looks like an object makes no whole worth cutting.
    volumes = [part.region.volume for part in parts]
    return float(np.average([part.confidence for part in parts], weights=volumes))


def _segmentation_confidence(objects: list[Node]) -> float:
    """Return the confidence of a segmentation: that of its objects, weighted by V^(1/3)."""
    # Large objects count more than small ones, but do not drown them.
    weights = np.cbrt([node.region.volume for node in objects])
    return float(np.average([node.confidence for node in objects], weights=weights))


def best_rule(trees: list[Node], rules: tuple[CutRule, ...] = RULES) -> CutRule:
    """Return the rule whose segmentation of all regions has the highest confidence.

    Parameters
    ----------
    trees : list of Node
        At least one.
    rules : tuple of CutRule
        The more cautious first: of equals the first is taken.

    Notes
    -----
    Grady et al. (2012) choose the parameters of their segmentation for every volume by their
    confidence measure. The trees are grown once, so that a rule costs microseconds.
    """
    return max(rules, key=lambda rule: round(_segmentation_confidence(list(_all(trees, rule))), 9))


def _all(trees: list[Node], rule: CutRule) -> Iterator[Node]:
    for tree in trees:
        yield from selected(tree, rule)
