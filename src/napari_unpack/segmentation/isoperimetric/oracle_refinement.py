"""Merging touching parts whose union the oracle takes for one object: cuts made too soon."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.segmentation.common.adjacency import find_neighbours
from napari_unpack.segmentation.common.pair_sums import PairSums
from napari_unpack.segmentation.common.region import Oracle, Region, united
from napari_unpack.segmentation.common.validation import Spacing
from napari_unpack.segmentation.isoperimetric.cut_tree import (
    MOST_CONFIDENCE_LOST,
    CutRule,
    Node,
    mean_confidence,
    selected,
)
from napari_unpack.tasks import SILENT, Share

# Parts that touch over a smaller share of the lesser surface are not merged.
TOUCHING = 0.05


def join_touching(
    labels: NDArray[np.int32],
    density: NDArray[np.generic],
    spacing: Spacing,
    oracle: Oracle,
    margin: float = 0.0,
    share: Share = SILENT,
) -> NDArray[np.int32]:
    """Merge touching parts whose union the oracle prefers; return labels in any order.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Parts, 0 background. Not changed.
    density : (Z, Y, X) ndarray
    spacing : (float, float, float) of mm, z y x
    oracle : callable
        Confidence of a region.
    margin : float
        A union's confidence exceeds the mean of its parts', by volume, by this.
    share : Share
    """
    # `grow_cut_tree` turned round: two of the five pieces of a suitcase are no better an object
    # than one, so that a rule which asks a gain of every merge would leave all five apart. The
    # pair with the largest gain is merged first, also where that loses up to 0.1, its neighbours
    # are rated anew, and from the tree of merges `selected` then takes those unions of higher
    # confidence than the best of what they are made of. This undoes premature cuts, and merges
    # shell and content of a container where the oracle prefers it.
    boxes, near = label_boxes(labels), find_neighbours(labels, spacing)
    pairs, area = near.pairs()
    # Its one column: the area over which two parts touch.
    contacts, surface = PairSums(len(near.surface), pairs, area[:, None]), near.surface
    nodes: dict[int, Node] = {}
    for name in share.part(0.0, 0.2).over(boxes.ids.tolist()):
        box = boxes.slices(name)
        part = Region.of(labels[box] == name, density, box, spacing)
        nodes[name] = Node(part, oracle(part))
    # Every union is rated once: that is nearly all of the time.
    unions: dict[tuple[int, int], Node] = {}

    def gains(share: Share) -> list[tuple[float, int, int]]:
        found = []
        pairs, area = contacts.pairs(0)
        touching = area > TOUCHING * surface[pairs].min(axis=1)
        for one, two in share.over(pairs[touching].tolist()):
            parts = nodes[one], nodes[two]
            if (one, two) not in unions:
                both = united(parts[0].region, parts[1].region, density)
                unions[one, two] = Node(both, oracle(both), parts)
            gain = unions[one, two].confidence - mean_confidence(parts)
            if gain >= -MOST_CONFIDENCE_LOST:
                found.append((-gain, one, two))
        return sorted(found)

    # Where every round begins: the first one rates nearly all.
    marks, merged = [0.2, *np.linspace(0.6, 1.0, len(nodes) + 1).tolist()], 0
    while waiting := gains(share.part(marks[merged], marks[merged + 1])):
        merged += 1
        share(marks[merged], f"Merging: {len(waiting)} pairs")
        _, one, two = waiting[0]
        nodes[one] = unions[one, two]
        del nodes[two]
        surface[one] += surface[two] - 2 * contacts.between(one, two)[0]
        contacts.join(one, two)
        # Only unions with what has just changed must be rated again.
        unions = {pair: u for pair, u in unions.items() if not {one, two} & set(pair)}
    out = np.zeros_like(labels)
    chosen = [leaf for node in nodes.values() for leaf in selected(node, CutRule(-margin))]
    for name, leaf in enumerate(chosen, 1):
        out[leaf.region.box][leaf.region.mask] = name
    return out
