"""Candidates from isoperimetric distance trees: where a shape, or its density, is narrowest."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.distance_tree import significant_minima, tree_sweep
from napari_unpack.segmentation.measures import chamfer
from napari_unpack.segmentation.workpiece import Proposals, Workpiece, largest_steps

DROP = 1.1
KEEP = 3


def tree_candidates(piece: Workpiece) -> Proposals:
    """Propose the significant minima of the ratio along several distance trees.

    Parameters
    ----------
    piece : Workpiece
        What to cut.

    Yields
    ------
    Proposal
        "tree", "tree, wide" (distance conductance), "tree, city-block", "tree, edges" (distance
        to the outside or to a density edge), "tree, valleys" (distance times density).

    Notes
    -----
    notes 3.2 of the design. Density edges are where the step between blocks exceeds four times
    its median and a twentieth of the median density.
    """
    small = piece.coarse
    for source, depth, conductance in _fields(piece):
        sweep = tree_sweep(small.mask, depth, small.spacing, conductance)
        last = len(sweep.order) - piece.fewest
        for k in significant_minima(sweep.ratio, piece.fewest, last, DROP, KEEP):
            sides = np.zeros(small.mask.size, np.int32)
            sides[sweep.order[: k + 1]] = 1
            sides[sweep.order[k + 1 :]] = 2
            yield source, sides.reshape(small.mask.shape), None


def _fields(piece: Workpiece) -> Iterator[tuple[str, NDArray[np.float32], str]]:
    small = piece.coarse
    yield "tree", small.depth, "unit"
    yield "tree, wide", small.depth, "distance"
    yield "tree, city-block", _city_block(small.mask, small.spacing), "unit"
    values = small.density[small.mask]
    low, middle = np.quantile(values, [0.05, 0.5])
    edges = _edges(small.density, small.mask, float(middle))
    if edges.any():
        aware = chamfer(small.mask & ~edges, small.spacing)
        yield "tree, edges", np.minimum(aware, small.depth), "unit"
    lift = np.clip((small.density - low) / max(float(middle - low), 1e-6), 0.0, 2.0)
    yield "tree, valleys", (small.depth * lift).astype(np.float32), "unit"


def _edges(
    density: NDArray[np.float32], mask: NDArray[np.bool_], middle: float
) -> NDArray[np.bool_]:
    step = largest_steps(density, mask)
    typical = float(np.median(step[mask]))
    return np.asarray(mask & (step > max(4 * typical, 0.05 * abs(middle))))


def _city_block(
    mask: NDArray[np.bool_], spacing: tuple[float, float, float]
) -> NDArray[np.float32]:
    from scipy.ndimage import distance_transform_cdt

    padded = np.pad(mask, 1)
    steps = distance_transform_cdt(padded, metric="taxicab")[1:-1, 1:-1, 1:-1]
    return steps.astype(np.float32) * np.float32(min(spacing))
