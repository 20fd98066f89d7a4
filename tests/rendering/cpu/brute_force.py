"""Ray casting as slow and plain as can be: every sample of every ray, in numpy and dicts."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from scipy.ndimage import map_coordinates

from napari_unpack.geometry.rays import Rays

FARTHEST = 300


def samples(rays: Rays, row: int, col: int, shape: tuple[int, ...]):
    """Yield (t, position, nearest voxel) of every sample of a ray inside a volume."""
    weights = np.array([1.0, row, col])
    origin, direction = weights @ rays.table[:3], weights @ rays.table[3:]
    t = (np.arange(-FARTHEST, FARTHEST) + 0.5) * rays.step
    p = origin + t[:, None] * direction
    voxels = np.floor(p + 0.5).astype(int)
    inside = ((voxels >= 0) & (voxels < shape)).all(axis=1) & (t > rays.near)
    for n in np.flatnonzero(inside):
        yield t[n], p[n], tuple(voxels[n])


def runs(labels, rays: Rays, visible):
    """Yield (row, col, list of the visible label of every sample, 0 for none)."""
    for row in range(rays.size[0]):
        for col in range(rays.size[1]):
            met = [int(labels[v]) for _, _, v in samples(rays, row, col, labels.shape)]
            yield row, col, [i if visible[i] else 0 for i in met]


def id_layers(labels, rays: Rays, visible, layers: int):
    out = np.zeros((layers, *rays.size), np.int32)
    for row, col, ids in runs(labels, rays, visible):
        distinct = list(dict.fromkeys(i for i in ids if i))[:layers]
        out[: len(distinct), row, col] = distinct
    return out


def occlusion(labels, rays: Rays, visible) -> dict[str, dict]:
    names = ("samples", "hits", "occluded_hits", "occluded_samples", "exact_samples")
    counts = {name: defaultdict(int) for name in names}
    blocks = set()
    for _, _, ids in runs(labels, rays, visible):
        ids = [i for i in ids if i]
        for object_id in set(ids):
            counts["hits"][object_id] += 1
            counts["occluded_hits"][object_id] += object_id != ids[0]
        for n, object_id in enumerate(ids):
            others = set(ids[:n]) - {object_id}
            counts["samples"][object_id] += 1
            counts["occluded_samples"][object_id] += object_id != ids[0]
            counts["exact_samples"][object_id] += bool(others)
            blocks |= {(other, object_id) for other in others}
    return {**counts, "blocks": blocks}


def listing(labels, rays: Rays, visible) -> dict[int, int]:
    """Transcribe the paper's countOccludedSamples, advancing on `continue`."""
    counter: dict[int, int] = defaultdict(int)

    def update(current: int, count: int) -> None:
        if current > 0:
            counter[current] += count

    for _, _, ids in runs(labels, rays, visible):
        first = next((i for i in ids if i), 0)
        current, count = -1, 0
        for object_id in ids:
            if object_id == first:
                continue
            if object_id == current:
                count += 1
            else:
                update(current, count)
                current, count = object_id, 1
        update(current, count)
    return counter


def tinted(volume, labels, rays: Rays, spacing, table, domain, tints, shading, opaque=0.99):
    """Return (image, depth) in float64."""
    image, depth = np.zeros((*rays.size, 4)), np.full(rays.size, np.inf)
    mm = np.asarray(spacing, float)
    padded = np.pad(volume.astype(float), 3, mode="edge")
    entries = np.arange(len(table))

    def density(p) -> float:
        return map_coordinates(padded, (p + 3)[:, None], order=1)[0]

    for row in range(rays.size[0]):
        for col in range(rays.size[1]):
            world = np.array([1.0, row, col]) @ rays.table[3:] * mm
            length = np.linalg.norm(world) * rays.step / mm.min()
            light = world / np.linalg.norm(world)
            colour, alpha = np.zeros(3), 0.0
            for t, p, voxel in samples(rays, row, col, labels.shape):
                tint = tints[labels[voxel]].astype(float)
                x = (density(p) - domain[0]) / (domain[1] - domain[0]) * (len(table) - 1)
                *rgb, a = (np.interp(x, entries, table[:, i]) for i in range(4))
                a = 1 - (1 - a * tint[3]) ** length
                sides = [density(p + u) - density(p - u) for u in np.eye(3)]
                gradient = np.array(sides) / 2 * mm.min() / mm
                steep = np.linalg.norm(gradient)
                c = abs(gradient @ light) / steep if steep else 0.0
                s = min(steep / (shading.gradient_floor * (domain[1] - domain[0])), 1.0)
                lit = shading.ambient + shading.diffuse * (1 - s + s * c)
                shine = shading.specular * s * c**shading.shininess
                colour += (1 - alpha) * a * np.minimum(np.array(rgb) * tint[:3] * lit + shine, 1)
                before, alpha = alpha, alpha + (1 - alpha) * a
                if before < 0.5 <= alpha:
                    depth[row, col] = t
                if alpha >= opaque:
                    break
            image[row, col] = [*colour, alpha]
    return image, depth
