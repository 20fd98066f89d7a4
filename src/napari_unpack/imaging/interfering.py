"""Who interferes in a view, on whichever backend suits."""

from __future__ import annotations

import networkx as nx
from numpy.typing import ArrayLike

from napari_unpack.appearance.contacts import checked_layers, half_widths, interference
from napari_unpack.imaging.backends import chosen


def interference_in(
    ids: ArrayLike, distance: float = 5, layers: int | None = None, backend: str = "auto"
) -> nx.Graph:
    """Join the objects that come near one another in a view; see `appearance.interference`.

    Parameters
    ----------
    ids, distance, layers
        As there.
    backend : {"auto", "cpu", "gl"}
        "auto" takes the graphics card where there is one; beyond its limits (OpenGL 4.3, 4096
        objects) the CPU answers. The answer is the same.

    Returns
    -------
    networkx.Graph

    Raises
    ------
    TypeError, ValueError
        As there; or if the backend is unknown, or "gl" where no GL context can be had.
    """
    stack = checked_layers(ids, distance, layers)
    module = chosen(backend)
    if not hasattr(module, "interfering_pairs") or stack.size == 0:
        return interference(stack, distance)
    found = module.interfering_pairs(stack, half_widths(distance))
    if found is None:
        return interference(stack, distance)
    present, pairs, lengths = (array.tolist() for array in found)
    graph = nx.Graph()
    graph.add_nodes_from(present)
    for (a, b), length in zip(pairs, lengths, strict=True):
        graph.add_edge(a, b, weight=length)
    return graph
