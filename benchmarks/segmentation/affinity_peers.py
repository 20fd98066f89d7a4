"""Other ways to link fragments by the same affinities, nothing after them: what linkage is worth.

Each gets the network's affinities between the same fragments, less a bar above which two belong
together, and stands at the best of a few bars. What is before and after linkage is ours, but for
the classifiers of pairs and of borders, which are out.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from benchmarks.segmentation.peers import Found
from napari_unpack.segmentation import pipeline, segment
from napari_unpack.segmentation.learned import method
from napari_unpack.segmentation.learned.affinity_linkage import LinkageThreshold
from napari_unpack.segmentation.learned.fragments import REACH_WEIGHTS, FragmentAffinities

BARS = (0.25, 0.35, 0.45, 0.55)

Link = Callable[[Any, NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]], Any]
"""`link(graph, costs, counts, touching) -> labels`."""


def ours(volume: NDArray[Any], spacing: Any) -> Found:
    """Yield our linkage alone, whose bar rises with the size of the smaller."""
    for bar in BARS:
        with mock.patch.object(method, "LINKAGE_ALONE", LinkageThreshold(bar, 0.1)):
            yield f"linkage alone {bar:g}", _alone(volume, spacing)


def _peer(name: str, link: Link, volume: NDArray[Any], spacing: Any) -> Found:
    for bar in BARS:
        with mock.patch.object(method, "mean_affinity_linkage", partial(_linked, link, bar)):
            yield f"{name} {bar:g}", _alone(volume, spacing)


def _alone(volume: NDArray[Any], spacing: Any) -> NDArray[np.int32]:
    with mock.patch.object(pipeline, "find_objects", _without_steps):
        labels: NDArray[np.int32] = segment(volume, spacing).labels
        return labels


def _without_steps(*given: Any, **named: Any) -> NDArray[np.int32]:
    """Stand in for `find_objects`, whatever it is asked for."""
    return method.find_objects(*given, **{**named, "steps": False})


def _linked(
    link: Link,
    bar: float,
    affinities: FragmentAffinities,
    sizes: NDArray[np.integer[Any]],
    threshold: LinkageThreshold,
    log: Any = None,
) -> NDArray[np.int64]:
    """Stand in for `mean_affinity_linkage`."""
    from bioimage_cpp.graph import UndirectedGraph

    graph = UndirectedGraph(len(sizes))
    graph.insert_edges(affinities.pairs.astype(np.uint64))
    counts = affinities.counts @ REACH_WEIGHTS
    labels = link(
        graph, affinities.sums @ REACH_WEIGHTS - bar * counts, counts, affinities.touching > 0
    )
    # Each is named by its first fragment.
    _, first, inverse = np.unique(np.asarray(labels), return_index=True, return_inverse=True)
    return np.asarray(first[inverse], np.int64)


def _gasp(kind: str, graph: Any, costs: Any, counts: Any, touching: Any) -> Any:
    """Merge by signed affinities (Bailoni et al., CVPR 2022), or by mutual exclusion."""
    from bioimage_cpp.graph.agglomeration import GaspClusterPolicy

    means = costs / np.maximum(counts, 1e-9)
    return GaspClusterPolicy(linkage=kind).optimize(graph, means, edge_sizes=counts)


def _multicut(graph: Any, costs: Any, counts: Any, touching: Any) -> Any:
    """Cut where that costs least: greedily, then with moves by Kernighan and Lin."""
    from bioimage_cpp.graph import multicut

    solve = multicut.ChainedMulticutSolvers(
        [multicut.GreedyAdditiveMulticut(), multicut.KernighanLinMulticut()]
    )
    return solve.optimize(multicut.MulticutObjective(graph, costs))


AFFINITY_PEERS: dict[str, Callable[[NDArray[Any], Any], Found]] = {
    "linkage alone": ours,
    "GASP": partial(_peer, "GASP", partial(_gasp, "mean")),
    "mutex watershed": partial(_peer, "mutex watershed", partial(_gasp, "mutex_watershed")),
    "multicut": partial(_peer, "multicut", _multicut),
}
