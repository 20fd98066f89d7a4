"""Candidates from the isoperimetric potential of the full lattice: cuts of least area."""

from __future__ import annotations

import numpy as np

from napari_unpack.segmentation.distance_tree import significant_minima
from napari_unpack.segmentation.lattice import Lattice, isoperimetric_ratio
from napari_unpack.segmentation.workpiece import Proposals, Workpiece


def lattice_candidates(piece: Workpiece, keep: int = 2) -> Proposals:
    """Propose minima of the isoperimetric ratio, by shape alone and with density steps.

    Parameters
    ----------
    piece : Workpiece
        What to cut.
    keep : int
        Cuts at most of each.

    Yields
    ------
    Proposal
        "lattice", "lattice, density".

    Notes
    -----
    notes 3.1 of the design (Grady & Schwartz 2006): L0 x0 = 1 with the ground taken out, swept.
    Deviation: the ground is the block furthest from the middle of the shape rather than the one of
    largest degree, which on a binary lattice is any inner one; a ground in the middle makes level
    sets that are shells around it, one at an end makes them cross the shape.
    """
    small = piece.coarse
    for source, density in (("lattice", None), ("lattice, density", small.density)):
        lattice = Lattice.of(small.mask, small.spacing, density)
        places = np.stack(np.unravel_index(lattice.where, small.mask.shape), axis=1)
        apart = (places - places.mean(axis=0)) * np.array(small.spacing)
        ground = np.array([int(np.argmax(np.square(apart).sum(axis=1)))])
        potential = lattice.potential(ground, np.zeros(1), 1.0, 1e-3, 500)
        order, cut = lattice.sweep(potential, weighted=density is not None)
        ratio = isoperimetric_ratio(cut, lattice.voxel)
        last = len(order) - piece.fewest
        for k in significant_minima(ratio, piece.fewest, last, 1.1, keep):
            sides = np.zeros(small.mask.size, np.int32)
            sides[lattice.where[order[: k + 1]]] = 1
            sides[lattice.where[order[k + 1 :]]] = 2
            yield source, sides.reshape(small.mask.shape), None
