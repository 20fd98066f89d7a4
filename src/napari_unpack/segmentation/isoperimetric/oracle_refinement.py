"""Merging touching parts whose union the oracle takes for one object: cuts made too soon."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.segmentation.common.merging import measure_contacts
from napari_unpack.segmentation.common.region import Oracle, Region, united
from napari_unpack.segmentation.common.validation import Spacing
from napari_unpack.segmentation.isoperimetric.cut_tree import (
    HOPELESS,
    CutRule,
    Node,
    kept,
    worth,
)
from napari_unpack.tasks import Progress


def join_touching(
    labels: NDArray[np.int32],
    density: NDArray[np.generic],
    spacing: Spacing,
    oracle: Oracle,
    margin: float = 0.0,
    touching: float = 0.05,
    tell: Progress | None = None,
) -> NDArray[np.int32]:
    """Merge touching parts whose union the oracle prefers.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Parts, 0 background. Not changed.
    density : (Z, Y, X) ndarray
        Density.
    spacing : (float, float, float)
        Voxel size z y x, mm.
    oracle : callable
        Confidence of a region.
    margin : float
        A union's confidence exceeds the mean of its parts', by volume, by this.
    touching : float
        Parts that touch over a smaller share of the lesser surface are not merged.
    tell : callable, optional
        Called with (fraction, text) before every merge; raising in it cancels.

    Returns
    -------
    (Z, Y, X) ndarray of int32
        Labels 1, 2, ... without order.

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
        near = inner > touching * np.minimum.outer(surface, surface)
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
    chosen = [leaf for node in nodes.values() for leaf in kept(node, CutRule(-margin))]
    for name, leaf in enumerate(chosen, 1):
        out[leaf.region.box][leaf.region.mask] = name
    return out
