"""What each object contributes to one pixel of the tinted image.

ID images make every sample opaque, which is right for occlusion and wrong for picking, where a
person means what they see (docs/paper.md, R13).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.rays import Rays
from napari_unpack.kernels import njit
from napari_unpack.rendering.cpu.bricks import Density
from napari_unpack.rendering.cpu.ray_sampling import (
    clipping_planes,
    density_at,
    ray_numbers,
    ray_of,
    sample_range,
)


def contributions(
    volume: Density,
    labels: NDArray[np.uint16],
    rays: Rays,
    spacing: ArrayLike,
    table: NDArray[np.float32],
    domain: tuple[float, float],
    tints: NDArray[np.float32],
    clipping: ArrayLike | None = None,
) -> dict[int, float]:
    """Add up the alpha every object lends to a pixel.

    Parameters
    ----------
    volume, labels, spacing, table, domain, tints, clipping
        As for `tinted`.
    rays : Rays
        A window of one pixel.

    Returns
    -------
    dict of int to float
        Contribution in [0, 1] by ID, 0 being matter without a label, in the order in which the
        ray meets them. The sum is the pixel's alpha; there is no early end, so that what lies
        behind opaque matter is listed too.

    Raises
    ------
    ValueError
        If the rays are more than one.
    """
    if rays.size != (1, 1):
        raise ValueError(f"rays must be a window of one pixel, got size {rays.size}")
    numbers, step, near = ray_numbers(rays)
    lo, hi = float(domain[0]), float(domain[1])
    # A copy: kernels are compiled for arrays that can be written to.
    mm = np.array(spacing, dtype=np.float64)
    shares = np.zeros(len(tints), np.float64)
    order = np.full(len(tints), -1, np.int64)
    count = _contribute(
        volume, labels, numbers, step, near, clipping_planes(clipping), mm, lo, hi,
        np.ascontiguousarray(table, np.float32), np.ascontiguousarray(tints, np.float32),
        shares, order,
    )  # fmt: skip
    return {int(i): float(shares[i]) for i in order[:count]}


def by_contribution(shares: dict[int, float]) -> list[tuple[int, float]]:
    """Order the objects of a pixel for picking, given their `contributions`, nearest first.

    The object that contributes most, then those behind it by depth, then those in front of it by
    depth; never ID 0. Ties go to the nearer object.
    """
    objects = [(i, share) for i, share in shares.items() if i]
    if not objects:
        return []
    most = max(range(len(objects)), key=lambda n: objects[n][1])
    return objects[most:] + objects[:most]


@njit(cache=True, nogil=True, error_model="numpy")
def _contribute(  # type: ignore[no-untyped-def]
    volume, labels, numbers, step, near, planes, spacing, lo, hi, table, tints, shares, order
):
    box = np.zeros((2, 3), np.int64)
    box[1, 0], box[1, 1], box[1, 2] = labels.shape
    pz, py, px, dz, dy, dx = ray_of(numbers, 0, 0)
    k, end = sample_range(box, planes, step, near, 0.5, pz, py, px, dz, dy, dx)
    length = step * np.sqrt(
        (dz * spacing[0]) ** 2 + (dy * spacing[1]) ** 2 + (dx * spacing[2]) ** 2
    )
    exponent = length / spacing.min()
    top = table.shape[0] - 1
    through = 1.0
    met = np.zeros(tints.shape[0], np.bool_)
    count = 0
    for sample in range(k, end):
        t = (sample + 0.5) * step
        vz, vy, vx = pz + t * dz, py + t * dy, px + t * dx
        label = labels[int(vz + 0.5), int(vy + 0.5), int(vx + 0.5)]
        if tints[label, 3] <= 0:
            continue
        u = min(max((density_at(volume, vz, vy, vx) - lo) / (hi - lo) * top, 0.0), float(top))
        i = min(int(u), top - 1)
        a = (table[i, 3] + (u - i) * (table[i + 1, 3] - table[i, 3])) * tints[label, 3]
        if a <= 0:
            continue
        if not met[label]:
            met[label] = True
            order[count] = label
            count += 1
        a = 1.0 - (1.0 - min(a, 1.0)) ** exponent
        shares[label] += through * a
        through *= 1.0 - a
    return count
