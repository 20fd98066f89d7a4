"""The lattice graph of a shape: conductances, potentials, and the cut of every level set.

Two problems share it: the isoperimetric partition of Grady & Schwartz (PAMI 28(3), 2006), where a
ground draws a current from everywhere, and the potential between two seeds, for cutting by hand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from napari_unpack.kernels import njit
from napari_unpack.segmentation.common.validation import Spacing

# Of a face across a density step, as a share: it keeps the system well conditioned.
LEAST_CONDUCTANCE = 0.01


@dataclass(frozen=True, eq=False)
class Lattice:
    """The voxels of a mask and the faces between them.

    Parameters
    ----------
    where : (N,) ndarray of int64
        Flat index of every node in the mask.
    after : (N, 3) ndarray of int32
        Node one voxel further along z, y, x; -1 where there is none.
    areas : (3,) ndarray of float64
        Of a face across z, y, x, mm^2.
    conductance : (N, 3) ndarray of float64
        Of those faces: area over distance, times the density weight.
    voxel : float
        Volume of a voxel, mm^3.
    """

    where: NDArray[np.int64]
    after: NDArray[np.int32]
    areas: NDArray[np.float64]
    conductance: NDArray[np.float64]
    voxel: float

    @staticmethod
    def of(
        mask: NDArray[np.bool_], spacing: Spacing, density: NDArray[np.floating] | None = None
    ) -> Lattice:
        """Make the lattice of a mask.

        Parameters
        ----------
        mask : (Z, Y, X) ndarray of bool
            At least one voxel.
        spacing : (float, float, float) of mm, z y x
        density : (Z, Y, X) ndarray of float, optional
            Finite inside the mask. Faces across a step of it conduct less.
        """
        # The density weight is 1 / (1 + (g / s)^2), at least 0.01, with g the step across the face
        # and s three times its median plus 5 % of the median density. An exponential of a fixed
        # beta collapses to cuts around single noisy voxels: the scale follows the noise, the tail
        # is long, and the floor keeps the system well conditioned.
        where = np.flatnonzero(mask)
        # One plane more along each axis stands for "no neighbour" at the far side.
        index = np.full([n + 1 for n in mask.shape], -1, np.int32)
        index[:-1, :-1, :-1][mask] = np.arange(len(where), dtype=np.int32)
        after = np.stack(
            [index[1:, :-1, :-1][mask], index[:-1, 1:, :-1][mask], index[:-1, :-1, 1:][mask]],
            axis=1,
        )
        voxel = float(np.prod(spacing))
        areas = voxel / np.array(spacing)
        conductance = np.repeat((areas / np.array(spacing))[None], len(where), axis=0)
        if density is not None:
            values = density[mask].astype(np.float64)
            steps = np.abs(np.where(after >= 0, values[after] - values[:, None], 0))
            inner = steps[after >= 0]
            typical = float(np.median(inner)) if len(inner) else 0.0
            scale = max(3 * typical + 0.05 * abs(float(np.median(values))), 1e-9)
            conductance *= np.maximum(1 / (1 + (steps / scale) ** 2), LEAST_CONDUCTANCE)
        return Lattice(where, after, areas, conductance, voxel)

    def potential(
        self,
        fixed: NDArray[np.int64],
        values: NDArray[np.float64],
        source: float,
        tolerance: float = 1e-4,
        most: int = 2000,
    ) -> NDArray[np.float64]:
        """Solve L x = source with x given at some nodes.

        Parameters
        ----------
        fixed : (K,) ndarray of int64
            Nodes whose potential is given, at least one in every component.
        values : (K,) ndarray of float64
            Their potentials.
        source : float
            Right-hand side at all others.
        tolerance : float
            Of the residual, relative to the first.
        most : int
            Iterations at most.
        """
        # Conjugate gradients, preconditioned by the diagonal, whose iterations grow with the
        # lattice's diameter: about N^(4/3) work. Meant for tens of thousands of nodes.
        held = np.zeros(len(self.where), np.bool_)
        held[fixed] = True
        start = np.zeros(len(self.where))
        start[fixed] = values
        solved = _solve(self.after, self.conductance, held, start, source, tolerance, most)
        return np.asarray(solved)

    def sweep(
        self, potential: NDArray[np.float64], weighted: bool
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the nodes by ascending potential, and the cut of every prefix.

        Parameters
        ----------
        potential : (N,) ndarray of float64
            Any field on the nodes.
        weighted : bool
            Whether a face counts its area times its density weight, or its area alone.

        Returns
        -------
        order : (N,) ndarray of int64
            Nodes.
        cut : (N,) ndarray of float64
            mm^2.
        """
        # Stable: nodes of one potential stay in the order of memory, on every machine.
        order = np.argsort(potential, kind="stable")
        plain = self.areas * self.areas / self.voxel
        weight = self.areas * (self.conductance / plain if weighted else np.ones((1, 3)))
        weight = np.broadcast_to(weight, self.after.shape)
        return order, np.asarray(_cuts(self.after, np.ascontiguousarray(weight), order))


@njit(cache=True, nogil=True)
def _apply(after, conductance, held, x, out):  # type: ignore[no-untyped-def]
    """Write the product of the Laplacian and a field, 0 at held nodes."""
    out[:] = 0
    for node in range(len(x)):
        for axis in range(3):
            other = after[node, axis]
            if other < 0:
                continue
            flow = conductance[node, axis] * (x[node] - x[other])
            out[node] += flow
            out[other] -= flow
    for node in range(len(x)):
        if held[node]:
            out[node] = 0


@njit(cache=True, nogil=True)
def _solve(after, conductance, held, start, source, tolerance, most):  # type: ignore[no-untyped-def]
    """Solve by conjugate gradients, preconditioned by the diagonal."""
    count = len(start)
    diagonal = np.zeros(count)
    for node in range(count):
        for axis in range(3):
            other = after[node, axis]
            if other >= 0:
                diagonal[node] += conductance[node, axis]
                diagonal[other] += conductance[node, axis]
    x = start.copy()
    product = np.empty(count)
    _apply(after, conductance, held, x, product)
    residual = np.empty(count)
    direction = np.empty(count)
    energy = 0.0
    # Loops rather than np.dot: a BLAS that wakes its threads for so little takes ten times as long.
    for node in range(count):
        residual[node] = 0.0 if held[node] else source - product[node]
        diagonal[node] = max(diagonal[node], 1e-12)
        direction[node] = residual[node] / diagonal[node]
        energy += residual[node] * direction[node]
    enough = energy * tolerance * tolerance
    for _ in range(most):
        if energy <= enough or energy == 0:
            break
        _apply(after, conductance, held, direction, product)
        along = 0.0
        for node in range(count):
            along += direction[node] * product[node]
        # Rounding has used up the direction: going on would climb.
        if along <= 0:
            break
        step, before, energy = energy / along, energy, 0.0
        for node in range(count):
            x[node] += step * direction[node]
            residual[node] -= step * product[node]
            energy += residual[node] * residual[node] / diagonal[node]
        for node in range(count):
            direction[node] = residual[node] / diagonal[node] + energy / before * direction[node]
    return x


@njit(cache=True, nogil=True)
def _cuts(after, weight, order):  # type: ignore[no-untyped-def]
    """Return the weight of the faces between every prefix and the rest."""
    rank = np.empty(len(order), np.int64)
    for k in range(len(order)):
        rank[order[k]] = k
    # A face is cut between the ranks of its two nodes: one running sum gives all prefixes.
    change = np.zeros(len(order), np.float64)
    for node in range(len(order)):
        for axis in range(3):
            other = after[node, axis]
            if other >= 0:
                change[min(rank[node], rank[other])] += weight[node, axis]
                change[max(rank[node], rank[other])] -= weight[node, axis]
    return np.cumsum(change)
