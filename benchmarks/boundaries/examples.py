"""Patches to learn from: cut out, turned, stretched, given other densities, and scanned anew."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import correlate1d

from benchmarks.boundaries.volumes import AIR, KINDS, files, hollow
from napari_unpack.segmentation.learned.boundary_network import REACHES
from napari_unpack.segmentation.learned.fragments import cells_of

FAR = 9.0
"""No log density lies above."""

USUAL = 600.0
"""Median density of the matter of a bag."""


SMALLEST_ZOOM, LARGEST_ZOOM = 0.5, 2.2
"""A thing is to be known at any size, and a scan is sampled as its scanner does."""


class Source:
    """Volumes in files, cut open where they are asked for.

    Parameters
    ----------
    folder : Path
        See `volumes.main`; those that are not there yet are left out.
    seeds : mapping of str to range
        Of the volumes of each kind.
    """

    def __init__(self, folder: Path, seeds: Mapping[str, range]) -> None:
        self.folder, self.seeds = folder, seeds
        self.kinds = list(seeds)
        shares = np.array([KINDS[kind].share for kind in self.kinds])
        self.shares = shares / shares.sum()

    def patch(
        self, rng: np.random.Generator, size: int
    ) -> tuple[NDArray[np.float32], NDArray[np.int32], str]:
        """Return density and labels of a cube cut at a random zoom and turned, and its kind."""
        while True:
            kind = self.kinds[int(rng.choice(len(self.kinds), p=self.shares))]
            several = self.seeds[kind]
            stored = files(self.folder, kind, several[int(rng.integers(len(several)))])
            if stored[0].exists():
                break
        density, labels = (np.load(path, mmap_mode="r") for path in stored)
        zoom = np.exp(rng.uniform(np.log(SMALLEST_ZOOM), np.log(LARGEST_ZOOM)))
        zoom = zoom * np.exp(rng.normal(0, 0.08, 3))
        reach = size / zoom
        room = np.array(density.shape) - reach
        # Beyond the volume there is air, but not much of it.
        low = np.where(room > 0, rng.uniform(-0.1, 1.1, 3) * room, room * rng.uniform(0.2, 0.8, 3))
        low = np.clip(low, -0.2 * reach, np.array(density.shape) - 0.8 * reach)
        first = np.maximum(np.floor(low).astype(int), 0)
        last = np.minimum(np.ceil(low + reach).astype(int) + 2, density.shape)
        region = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
        values, names = _resample(
            np.ascontiguousarray(density[region]),
            np.ascontiguousarray(labels[region]),
            low - first,
            1 / zoom,
            size,
        )
        axes = rng.permutation(3)
        flips = tuple(slice(None, None, int(s)) for s in rng.choice([-1, 1], 3))
        values, names = values.transpose(axes)[flips], names.transpose(axes)[flips]
        return np.ascontiguousarray(values), np.ascontiguousarray(names), kind


@njit(cache=True, nogil=True)
def _resample(density, labels, low, step, size):  # type: ignore[no-untyped-def]
    values = np.zeros((size, size, size), np.float32)
    names = np.zeros((size, size, size), np.int32)
    depth, height, width = density.shape
    for k in range(size):
        z = low[0] + k * step[0]
        for j in range(size):
            y = low[1] + j * step[1]
            for i in range(size):
                x = low[2] + i * step[2]
                nz, ny, nx = int(np.round(z)), int(np.round(y)), int(np.round(x))
                if nz < 0 or ny < 0 or nx < 0 or nz >= depth or ny >= height or nx >= width:
                    continue
                names[k, j, i] = labels[nz, ny, nx]
                a, b, c = int(np.floor(z)), int(np.floor(y)), int(np.floor(x))
                total = 0.0
                for dz in range(2):
                    wz = 1 - abs(z - a - dz)
                    pz = min(max(a + dz, 0), depth - 1)
                    for dy in range(2):
                        wy = wz * (1 - abs(y - b - dy))
                        py = min(max(b + dy, 0), height - 1)
                        for dx in range(2):
                            w = wy * (1 - abs(x - c - dx))
                            px = min(max(c + dx, 0), width - 1)
                            total += w * density[pz, py, px]
                values[k, j, i] = total
    return values, names


def repaint(
    rng: np.random.Generator, density: NDArray[np.float32], labels: NDArray[np.int32], solid: bool
) -> None:
    """Give objects other densities, or one, or take them out; in place."""
    names = np.flatnonzero(np.bincount(labels.reshape(-1)))
    names = names[names > 0]
    top = int(labels.max()) + 1
    gain = np.ones(top, np.float32)
    flat = np.full(top, -1.0, np.float32)
    gone = np.zeros(top, np.bool_)
    if len(names) == 0:
        return
    mood = rng.random()
    if mood < 0.35:
        gain[names] = np.exp(rng.normal(0, 0.35, len(names)))
    if mood < 0.2 or (solid and mood < 0.5):
        # Some become one plain material, often the same as their neighbours.
        few = np.exp(rng.uniform(np.log(180), np.log(3500), int(rng.integers(1, 4))))
        some = names[rng.random(len(names)) < rng.choice([0.3, 0.6, 1.0])]
        flat[some] = rng.choice(few, len(some)) * np.exp(rng.normal(0, 0.01, len(some)))
    if rng.random() < 0.4:
        gone[names] = rng.random(len(names)) < 0.25
    gain[0] = 0.0 if rng.random() < 0.1 else np.exp(rng.normal(0, 0.3))
    _repaint(density, labels, gain, flat, gone)


@njit(cache=True, nogil=True)
def _repaint(density, labels, gain, flat, gone):  # type: ignore[no-untyped-def]
    values, names = density.reshape(-1), labels.reshape(-1)
    for k in range(len(values)):
        name = names[k]
        if gone[name]:
            values[k] = 0
            names[k] = 0
        elif flat[name] >= 0 and values[k] > 60.0:
            values[k] = flat[name]
        else:
            values[k] *= gain[name]


def scan(rng: np.random.Generator, density: NDArray[np.float32]) -> NDArray[np.float32]:
    """Add shading, bands, noise and blur; in place."""
    size = density.shape[0]
    axes = np.meshgrid(*[np.arange(size, dtype=np.float32)] * 3, indexing="ij", sparse=True)
    if rng.random() < 0.3:
        way = rng.normal(size=3) / size
        density *= 1 + 0.12 * np.sin(
            sum(a * w for a, w in zip(axes, way * 3, strict=True)) + rng.uniform(0, 6)
        ).astype(np.float32)
    if rng.random() < 0.3:
        for _ in range(int(rng.integers(1, 4))):
            way = rng.normal(size=3)
            way[rng.integers(3)] *= 0.05
            way *= np.exp(rng.uniform(np.log(0.05), np.log(0.6))) / np.linalg.norm(way)
            wave = np.sin(sum(a * w for a, w in zip(axes, way, strict=True)) + rng.uniform(0, 6))
            density += np.float32(np.exp(rng.uniform(np.log(8), np.log(70)))) * wave
    sigma = rng.uniform(0.3, 1.0) if rng.random() < 0.85 else rng.uniform(1.0, 1.5)
    reach = int(np.ceil(3 * sigma))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    kernel /= kernel.sum()
    noise = np.exp(rng.uniform(np.log(4), np.log(60)))
    # Part of the noise is as coarse as the blur.
    coarse = rng.random()
    lift = coarse * noise / (kernel**2).sum() ** 1.5
    density += np.float32(lift) * rng.standard_normal(density.shape, dtype=np.float32)
    for axis in range(3):
        density = correlate1d(density, kernel, axis=axis, mode="nearest")
    density += np.float32((1 - coarse) * noise) * rng.standard_normal(
        density.shape, dtype=np.float32
    )
    return density


def to_log(
    rng: np.random.Generator, density: NDArray[np.float32], foreground: float
) -> NDArray[np.float32]:
    """Compress as the network's input is, with its errors of air and of matter."""
    knee = foreground / 4 * np.exp(rng.normal(0, 0.3))
    air = rng.normal(0, 6)
    gamma = np.exp(rng.normal(0, 0.05))
    # NumPy has log in vectors of the processor, log1p one by one.
    lifted = 1 + np.maximum(density - np.float32(air), 0) * np.float32(1 / knee)
    return np.minimum(np.log(lifted) * np.float32(gamma), np.float32(FAR))


def packed(values: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return (8, z/2, y/2, x/2): the voxels of each cell as channels."""
    z, y, x = (n // 2 for n in values.shape)
    cells = values.reshape(z, 2, y, 2, x, 2).transpose(1, 3, 5, 0, 2, 4)
    return np.ascontiguousarray(cells.reshape(8, z, y, x))


NOTHING, SAME, APART, BESIDE_AIR, AIR_ALONE = range(5)
"""What the network shall say: nothing is known; yes; two objects; one and air; air."""


def targets(labels: NDArray[np.int32]) -> NDArray[np.uint8]:
    """Return what the network shall say.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Truth.

    Returns
    -------
    (CHANNELS, Z/2, Y/2, X/2) ndarray of uint8
        In the order of `boundary_network.CHANNELS`: `SAME` where it shall say yes, `NOTHING` where
        it may say what it likes, one of the others where it shall say no.
    """
    matter = np.where(labels > 0, SAME, AIR_ALONE).astype(np.uint8)
    pairs = [packed(_pairs(labels, axis, 1)) for axis in range(3)]
    cells = cells_of(labels)
    far = [_pairs(cells, axis, reach)[None] for reach in REACHES for axis in range(3)]
    return np.concatenate([packed(matter), *pairs, *far])


def _pairs(labels: NDArray[np.int32], axis: int, reach: int) -> NDArray[np.uint8]:
    answers = np.zeros(labels.shape, np.uint8)
    _compare(np.moveaxis(labels, axis, 0), reach, np.moveaxis(answers, axis, 0))
    return answers


@njit(cache=True, nogil=True)
def _compare(labels, reach, answers):  # type: ignore[no-untyped-def]
    """Compare every voxel with the one so many further along the first axis."""
    depth, height, width = labels.shape
    for z in range(depth - reach):
        for y in range(height):
            for x in range(width):
                one, two = labels[z, y, x], labels[z + reach, y, x]
                if one == 0 and two == 0:
                    continue
                if one == two:
                    answers[z, y, x] = SAME
                elif one == 0 or two == 0:
                    answers[z, y, x] = BESIDE_AIR
                else:
                    answers[z, y, x] = APART


def rescan(rng: np.random.Generator, density: NDArray[np.float32]) -> NDArray[np.float32]:
    """Add some noise at times to what a scanner has made already; in place."""
    if rng.random() < 0.3:
        noise = np.float32(np.exp(rng.uniform(np.log(4), np.log(40))))
        density += noise * rng.standard_normal(density.shape, dtype=np.float32)
    return density


def examples(
    source: Source, seed: int | list[int], size: int
) -> Iterator[tuple[NDArray[np.float32], NDArray[np.uint8]]]:
    """Yield cells of log density, (8, z, y, x), and `targets` of them without end."""
    rng = np.random.default_rng(seed)
    while True:
        density, labels, kind = source.patch(rng, size)
        scanned = KINDS[kind].scanned
        if not scanned:
            hollow(density, labels)
        foreground = density[(labels > 0) & (density > AIR)]
        if foreground.size < 0.05 * labels.size:
            continue
        if not scanned:
            repaint(rng, density, labels, "solids" in kind)
            foreground = density[density > AIR]
        # A volume's median is not its patch's: it is somewhere between that and the usual one.
        typical = float(np.median(foreground)) if foreground.size else USUAL
        share = rng.random()
        typical = max(float(np.exp(share * np.log(typical) + (1 - share) * np.log(USUAL))), 120.0)
        seen = rescan(rng, density) if scanned else scan(rng, density)
        yield packed(to_log(rng, seen, typical)), targets(labels)
