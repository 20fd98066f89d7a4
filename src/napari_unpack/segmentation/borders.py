"""Borders between touching objects, drawn voxel by voxel by a small trained judge.

A thin plate on a box is a few voxels thick, all of them at a border, blurred into the box on one
side and into air on the other. No one measure tells whose such a voxel is: not its density, not
what the network says of its faces, not who is around it. A judge trained on drawn bags weighs them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from napari_unpack.segmentation.affinity import Affinity
from napari_unpack.segmentation.border_features import (
    BINS,
    BORDER_FEATURES,
    FEW,
    bin_of,
    describe,
    find_rivals,
)
from napari_unpack.segmentation.materials import MaterialScale
from napari_unpack.segmentation.sharpening import find_inside

ROUNDS = 6
"""Voxels that a border moves at most."""

HOLD = 1.0
"""By how much more, before the logistic, must speak for another label."""

RARE = 0.005
"""Share that every density has of every object at least."""

FACES = BORDER_FEATURES.index("faces")

REACH = 4
"""Voxels to every side whose labels `border_features.describe` goes by: it looks three far, and
whether one there is inside hangs on the next."""


@dataclass(frozen=True, eq=False)
class Scene:
    """What borders are judged by, besides the labels.

    Parameters
    ----------
    values : (Z, Y, X) ndarray of float32
        Density above air.
    knee : float
        See `materials.MaterialScale`.
    following : (3, Z, Y, X) ndarray of uint8
        That a voxel belongs with the next; see `boundaries.Prediction`.
    noise : float
        Standard deviation of the density's noise.
    means, sizes : (M,) ndarray of float64
        Of every label: density above air, voxels.
    logs : (M, BINS) ndarray of float64
        Of every label: logarithm of the share that each log density has of it.
    """

    values: NDArray[np.float32]
    knee: float
    following: NDArray[np.uint8]
    noise: float
    means: NDArray[np.float64]
    sizes: NDArray[np.float64]
    logs: NDArray[np.float64]

    @staticmethod
    def of(
        labels: NDArray[np.int32],
        density: NDArray[np.generic],
        scale: MaterialScale,
        following: NDArray[np.uint8],
        noise: float,
    ) -> Scene:
        """Measure every label as it is now.

        Parameters
        ----------
        labels : (Z, Y, X) ndarray of int32
            Objects; 0 is background.
        density : (Z, Y, X) ndarray
            NaN and infinities count as air.
        scale : MaterialScale
            How densities are compared.
        following, noise
            See `Scene`.

        Returns
        -------
        Scene
        """
        air = float(np.float32(scale.air))
        values = density.astype(np.float32)
        # What is not measured is air, as for all of the package.
        np.nan_to_num(values, copy=False, nan=air, posinf=air, neginf=air)
        values -= np.float32(air)
        sizes = np.maximum(np.bincount(labels.reshape(-1)), 1).astype(np.float64)
        means = np.bincount(labels.reshape(-1), values.reshape(-1), len(sizes)) / sizes
        counts = _histograms(labels, values, find_inside(labels), scale.knee, len(sizes))
        counts = gaussian_filter1d(counts, 1.0, axis=1)
        shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1e-9)
        logs = np.log(shares + RARE)
        return Scene(values, scale.knee, following, noise, means, sizes, logs)

    def facts(self) -> tuple[object, ...]:
        """Return what the compiled loops take, in their order."""
        return (
            self.values,
            self.knee,
            self.following,
            self.noise,
            self.means,
            self.sizes,
            self.logs,
        )


def draw_borders(
    labels: NDArray[np.int32], scene: Scene, judge: Affinity | None = None, rounds: int = ROUNDS
) -> NDArray[np.int32]:
    """Give voxels at borders to the one of the labels around them that they are most likely of.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Objects, 0 background. Not changed.
    scene : Scene
        What they are judged by.
    judge : Affinity, optional
        Over `border_features.BORDER_FEATURES`, of three layers; by default the one that ships
        with the package.
    rounds : int
        Voxels that a border moves at most.

    Returns
    -------
    (Z, Y, X) ndarray of int32
        No voxel becomes background, none of it an object's.

    Notes
    -----
    Borders are to lie roughly right already, see `sharpening`. Only a label that shares a face
    with a voxel may take it. All is counted in voxels, whatever their size. Rounds after the first
    look again only at what has changed and is near it. About 350 reads and 2000 multiplications a
    voxel of border.
    """
    trained = judge or default_border_judge()
    layers = [np.ascontiguousarray(w, np.float32) for w in trained.weights]
    offsets = [np.ascontiguousarray(o, np.float32) for o in trained.offsets]
    center = trained.center.astype(np.float32)
    scale = trained.scale.astype(np.float32)
    given = (*scene.facts(), center, scale, *layers, *offsets)
    due = np.ones(labels.shape, np.bool_)
    for _ in range(rounds):
        inside = find_inside(labels)
        moved, changed = _moved(labels, inside, due, *given)
        if not len(changed):
            break
        labels = moved
        due = _around(changed, labels.shape)
    return labels


@cache
def default_border_judge() -> Affinity:
    """Return the judge of borders that ships with the package."""
    return Affinity.load(Path(__file__).with_name("borders.npz"), BORDER_FEATURES)


@njit(cache=True, nogil=True)
def _histograms(labels, values, inside, knee, count):  # type: ignore[no-untyped-def]
    """Count log densities, label by label; voxels at a border, which are blurred, hardly count."""
    found = np.zeros((count, BINS))
    for z in range(labels.shape[0]):
        for y in range(labels.shape[1]):
            for x in range(labels.shape[2]):
                name = labels[z, y, x]
                if name > 0:
                    weight = 1.0 if inside[z, y, x] else 0.05
                    found[name, bin_of(values[z, y, x], knee)] += weight
    return found


@njit(cache=True, nogil=True)
def _moved(  # type: ignore[no-untyped-def]
    labels, inside, due, values, knee, following, noise, means, sizes, logs,
    center, scale, w0, w1, w2, o0, o1, o2,
):  # fmt: skip
    result = labels.copy()
    changed = [np.int64(0) for _ in range(0)]
    size = labels.shape
    names = np.zeros(FEW, np.int32)
    rows = np.zeros((FEW, len(center)), np.float32)
    one, two = np.zeros(len(o0), np.float32), np.zeros(len(o1), np.float32)
    for z in range(size[0]):
        for y in range(size[1]):
            for x in range(size[2]):
                if not due[z, y, x] or labels[z, y, x] == 0:
                    continue
                count = find_rivals(labels, z, y, x, names)
                if count == 1:
                    continue
                describe(
                    labels, inside, values, knee, following, noise, means, sizes, logs,
                    z, y, x, names[:count], rows,
                )  # fmt: skip
                best, most = 0, -np.inf
                for n in range(count):
                    # Across an edge alone it would come apart from its object.
                    if n > 0 and rows[n, FACES] == 0:
                        continue
                    said = HOLD if n == 0 else 0.0
                    said += _answer(rows[n], center, scale, w0, w1, w2, o0, o1, o2, one, two)
                    if said > most:
                        best, most = n, said
                if best > 0:
                    result[z, y, x] = names[best]
                    changed.append((z * size[1] + y) * size[2] + x)
    return result, np.array(changed)


@njit(cache=True, nogil=True)
def _answer(row, center, scale, w0, w1, w2, o0, o1, o2, one, two):  # type: ignore[no-untyped-def]
    """Return what `Affinity.probability` says of a row, before the logistic."""
    one[:] = o0
    for k in range(len(row)):
        value = min(max((row[k] - center[k]) / scale[k], -6.0), 6.0)
        for n in range(len(one)):
            one[n] += value * w0[k, n]
    two[:] = o1
    for k in range(len(one)):
        value = np.tanh(one[k])
        for n in range(len(two)):
            two[n] += value * w1[k, n]
    said = o2[0]
    for k in range(len(two)):
        said += np.tanh(two[k]) * w2[k, 0]
    return said


@njit(cache=True, nogil=True)
def _around(places, size):  # type: ignore[no-untyped-def]
    """Return which voxels have a changed place within reach."""
    near = np.zeros(size, np.bool_)
    for place in places:
        z, rest = place // (size[1] * size[2]), place % (size[1] * size[2])
        y, x = rest // size[2], rest % size[2]
        near[
            max(z - REACH, 0) : z + REACH + 1,
            max(y - REACH, 0) : y + REACH + 1,
            max(x - REACH, 0) : x + REACH + 1,
        ] = True
    return near
