"""Second thoughts about a segmentation: split what is not one object, join what is."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.segmentation.common.merging import measure_contacts
from napari_unpack.segmentation.common.region import Region, united
from napari_unpack.segmentation.common.validation import Spacing
from napari_unpack.segmentation.confidence.oracle import default_oracle
from napari_unpack.segmentation.isoperimetric.cut_tree import (
    HOPELESS,
    CutRule,
    Node,
    grow,
    kept,
    worth,
)
from napari_unpack.segmentation.isoperimetric.splitting import Oracle
from napari_unpack.tasks import Progress


@dataclass(frozen=True)
class RefineRule:
    """How clear a case must be.

    Parameters
    ----------
    doubtful : float
        Only objects of lesser confidence are split.
    cut : CutRule
        Which cuts are kept.
    margin : float
        A union's confidence exceeds the mean of its parts', by volume, by this.
    touching : float
        Parts that touch over less of the lesser surface than this are not joined.
    smallest : float
        No part is smaller, mm^3.
    """

    doubtful: float = 0.5
    cut: CutRule = field(default_factory=lambda: CutRule(0.6, 1.1))
    margin: float = 0.2
    touching: float = 0.05
    smallest: float = 500.0


def refine_by_oracle(
    labels: NDArray[np.int32],
    density: NDArray[np.generic],
    spacing: Spacing,
    oracle: Oracle | None = None,
    tell: Progress | None = None,
    rule: RefineRule | None = None,
) -> NDArray[np.int32]:
    """Split objects of low confidence where the gain is clear, and join touching ones likewise.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Objects, 0 background. Not changed.
    density : (Z, Y, X) ndarray
        Density.
    spacing : (float, float, float)
        Voxel size z y x, mm.
    oracle : callable, optional
        Confidence of a region; by default the one that ships with the package.
    tell : callable, optional
        Called with (fraction, text) before every object; raising in it cancels.
    rule : RefineRule, optional
        How clear a case must be.

    Returns
    -------
    (Z, Y, X) ndarray of int32
        Labels 1, 2, ... without order.
    """
    limits, judge = rule or RefineRule(), oracle or default_oracle()
    apart = split_doubtful(labels, density, spacing, judge, limits, tell)
    return join_touching(apart, density, spacing, judge, limits, tell)


def split_doubtful(
    labels: NDArray[np.int32],
    density: NDArray[np.generic],
    spacing: Spacing,
    oracle: Oracle,
    rule: RefineRule,
    tell: Progress | None = None,
) -> NDArray[np.int32]:
    """Split the objects that the oracle doubts; see `refine_by_oracle`."""
    boxes = label_boxes(labels)
    out = labels.copy()
    top = int(labels.max(initial=0))
    for k, name in enumerate(boxes.ids.tolist()):
        if tell is not None:
            tell(0.5 * k / len(boxes.ids), f"Doubting: object {name}")
        region = Region.of(labels[boxes.slices(name)] == name, density, boxes.slices(name), spacing)
        confidence = oracle(region)
        if confidence >= rule.doubtful or region.volume < 2 * rule.smallest:
            continue
        tree = grow(region, oracle, rule.smallest, tell, 0, confidence)
        for node in kept(tree, rule.cut)[1:]:
            top += 1
            out[node.region.box][node.region.mask] = top
    return out


def join_touching(
    labels: NDArray[np.int32],
    density: NDArray[np.generic],
    spacing: Spacing,
    oracle: Oracle,
    rule: RefineRule,
    tell: Progress | None = None,
) -> NDArray[np.int32]:
    """Join touching objects whose union is clearly more of an object; see `refine_by_oracle`.

    Notes
    -----
    `recursion.grow` turned round: two of the five pieces of a suitcase are no better an object than
    one, so that a rule which asks a gain of every join would leave all five apart. The pair with
    the largest gain is joined first, also where that loses up to 0.1, its neighbours are judged
    anew, and from the tree of joins `recursion.kept` then takes those unions that are worth more
    than the best of what they are made of. This undoes premature cuts, and joins shell and content
    of a container where the oracle prefers it.
    """
    boxes = label_boxes(labels)
    contacts = measure_contacts(labels, spacing)
    inner, surface = contacts.area.copy(), contacts.surface.copy()
    inner[0] = inner[:, 0] = 0
    nodes: dict[int, Node] = {}
    for name in boxes.ids.tolist():
        box = boxes.slices(name)
        part = Region.of(labels[box] == name, density, box, spacing)
        nodes[name] = Node(part, oracle(part))
    unions: dict[tuple[int, int], Node] = {}

    def gains() -> list[tuple[float, int, int]]:
        found = []
        near = inner > rule.touching * np.minimum.outer(surface, surface)
        for one, two in np.argwhere(np.triu(near, 1)).tolist():
            parts = nodes[one], nodes[two]
            if (one, two) not in unions:
                both = united(parts[0].region, parts[1].region, density)
                unions[one, two] = Node(both, oracle(both), parts)
            gain = unions[one, two].confidence - worth(parts)
            if gain >= -HOPELESS:
                found.append((-gain, one, two))
        return sorted(found)

    while waiting := gains():
        if tell is not None:
            tell(0.9, f"Joining: {len(waiting)} pairs")
        _, one, two = waiting[0]
        nodes[one] = unions[one, two]
        del nodes[two]
        surface[one] += surface[two] - 2 * inner[one, two]
        inner[one] += inner[two]
        inner[:, one] += inner[:, two]
        inner[two] = 0
        inner[:, two] = 0
        inner[one, one] = 0
        unions = {pair: u for pair, u in unions.items() if not {one, two} & set(pair)}
    out = np.zeros_like(labels)
    chosen = [leaf for node in nodes.values() for leaf in kept(node, CutRule(-rule.margin))]
    for name, leaf in enumerate(chosen, 1):
        out[leaf.region.box][leaf.region.mask] = name
    return out
