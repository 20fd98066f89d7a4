"""Recursive splitting by the oracle: grow a tree of cuts, then keep the objects it likes best.

A cut that frees one of four objects need not raise the confidence at once, so that a rule which
stops at the first cut without gain leaves the others together. Here cuts are grown as far as
there is hope, judged once, and chosen afterwards; trying other parameters then costs nothing.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from napari_unpack.segmentation.common.region import FEWEST, Oracle, Region
from napari_unpack.segmentation.isoperimetric.candidates import pool
from napari_unpack.tasks import Progress


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


GRID = tuple(
    CutRule(gain, compactness, least)
    for least, gain, compactness in itertools.product(
        (False, True), (0.25, 0.1, 0.03), (0.7, 1.1, 1.6, 3.0)
    )
)
SURE = 0.9
HOPELESS = 0.1
FAINT = 0.05
DEEPEST = 6


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
    source : str
        Which splitter proposed the cut; empty where there is none.
    """

    region: Region
    confidence: float
    parts: tuple[Node, ...] = ()
    compactness: float = 0.0
    source: str = ""


def split_recursively(
    regions: list[Region], oracle: Oracle, smallest: float, tell: Progress | None = None
) -> list[Region]:
    """Split regions into what the oracle takes for single objects.

    Parameters
    ----------
    regions : list of Region
        6-connected regions.
    oracle : callable
        Confidence in [0, 1] that a region is exactly one object.
    smallest : float
        No part is smaller, mm^3.
    tell : callable, optional
        Called before every split with the fraction of voxels seen; raising in it cancels.

    Returns
    -------
    list of Region
        In a fixed order.
    """
    total = max(sum(region.voxels for region in regions), 1)
    seen = 0
    trees = []
    for region in regions:
        share = seen / total
        told = None if tell is None else partial(_tell, tell, share)
        trees.append(grow(region, oracle, smallest, told))
        seen += region.voxels
    if not trees:
        return []
    return [node.region for node in _all(trees, best_rule(trees))]


def _tell(tell: Progress, share: float, _: float, text: str) -> None:
    tell(share, text)


def grow(
    region: Region,
    oracle: Oracle,
    smallest: float,
    tell: Progress | None = None,
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
    tell : callable, optional
        Called before every split with (0, text); raising in it cancels.
    depth : int
        Of this region in the tree; below 6 nothing is cut.
    confidence : float, optional
        The region's, where it is known.

    Returns
    -------
    Node

    Notes
    -----
    At every region that is not sure to be one object the whole pool is judged, and the cut whose
    parts are the best by volume is followed, also where it gains nothing yet; one that loses more
    than 0.1 is not, nor below the first cut one to which hardly any confidence is left. The work is
    bounded by the depth and the smallest part.
    """
    sure = oracle(region) if confidence is None else confidence
    if sure >= SURE or depth >= DEEPEST:
        return Node(region, sure)
    if tell is not None:
        tell(0.0, f"Splitting: {region.voxels} voxels")
    best: tuple[float, list[Region], list[float], float, str] | None = None
    for candidate in pool(region, max(smallest, FEWEST * region.voxel_volume / 2)):
        parts = [region.part(candidate.parts == k) for k in range(1, candidate.parts.max() + 1)]
        scores = [oracle(part) for part in parts]
        volumes = [part.volume for part in parts]
        value = float(np.average(scores, weights=volumes))
        if best is None or value > best[0]:
            small = sum(volumes) - max(volumes)
            best = (value, parts, scores, candidate.ratio * small ** (1 / 3), candidate.source)
    if best is None or best[0] < max(sure - HOPELESS, FAINT if depth else 0.0):
        return Node(region, sure)
    nodes = tuple(
        grow(part, oracle, smallest, tell, depth + 1, score)
        for part, score in zip(best[1], best[2], strict=True)
    )
    return Node(region, sure, nodes, best[3], best[4])


def kept(node: Node, rule: CutRule) -> list[Node]:
    """Return the nodes that a rule keeps as objects, in the order of the tree.

    Notes
    -----
    From the leaves up: a region is taken apart where the best segmentation of its parts beats it
    by the rule.
    """
    if not node.parts or node.compactness > rule.compactness:
        return [node]
    parts = [leaf for part in node.parts for leaf in kept(part, rule)]
    value = min(leaf.confidence for leaf in parts) if rule.least else worth(parts)
    return parts if value - node.confidence > rule.gain else [node]


def worth(parts: Sequence[Node]) -> float:
    """Return what a segmentation into parts is worth: their mean confidence by volume.

    A small piece that looks like something by itself makes no whole worth cutting.
    """
    volumes = [part.region.volume for part in parts]
    return float(np.average([part.confidence for part in parts], weights=volumes))


def liking(objects: list[Node]) -> float:
    """Return how much the oracle likes a segmentation: mean confidence, weighted by V^(1/3).

    Large objects count more than small ones, but do not drown them.
    """
    weights = np.cbrt([node.region.volume for node in objects])
    return float(np.average([node.confidence for node in objects], weights=weights))


def best_rule(trees: list[Node], rules: tuple[CutRule, ...] = GRID) -> CutRule:
    """Return the rule whose segmentation of all regions the oracle likes best.

    Parameters
    ----------
    trees : list of Node
        At least one.
    rules : tuple of CutRule
        The more cautious first: of equals the first is taken.

    Returns
    -------
    CutRule

    Notes
    -----
    Grady et al. (2012) choose the parameters of their segmentation for every volume by their
    confidence measure. The trees are grown once, so that a rule costs microseconds.
    """
    return max(rules, key=lambda rule: round(liking(list(_all(trees, rule))), 9))


def _all(trees: list[Node], rule: CutRule) -> Iterator[Node]:
    for tree in trees:
        yield from kept(tree, rule)
