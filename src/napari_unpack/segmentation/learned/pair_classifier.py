"""Whether two touching parts are one object: features of pairs, and a small trained classifier.

A camera is plastic, glass and battery; a shoe is leather over rubber. What tells such parts from
two things that touch is how they meet: over how much of their surface, with or without a dip of air
between them, one inside the other's convex hull or merely beside it. `agglomerate` merges the
surest pair first.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from napari_unpack.atomic import written_atomically
from napari_unpack.file_sizes import load_arrays
from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.kernels import njit
from napari_unpack.read_errors import read_errors_told
from napari_unpack.segmentation.common.adjacency import find_neighbours
from napari_unpack.segmentation.common.convex_hull import hull_volume, mask_corners, support_points
from napari_unpack.segmentation.common.depths import label_depths
from napari_unpack.segmentation.common.joins import JoinLog
from napari_unpack.segmentation.common.pair_sums import PairSums
from napari_unpack.segmentation.common.validation import Spacing
from napari_unpack.tasks import SILENT, Share

# Stored with the weights and compared with them: the names must stay as they were trained.
PAIR_FEATURES = (
    "contact_of_smaller",
    "contact_of_larger",
    "air_of_smaller",
    "air_of_larger",
    "density_gap",
    "density_sign",
    "volume_ratio",
    "log_volume",
    "thickness_of_smaller",
    "thickness_of_larger",
    "solidity_of_smaller",
    "solidity_of_larger",
    "solidity_together",
    "hull_overlap",
    "dip",
    "step",
    "neck",
    "spread_of_smaller",
    "spread_of_larger",
    "density_of_denser",
)


# The first of the sums over a contact.
AREA = 0


@dataclass
class Parts:
    """Additive measurements of parts and of how they touch; merging two is adding rows.

    Parameters
    ----------
    sums : (M, 5) ndarray of float64
        Of every label: voxels, log density, its square, depth (mm), area to background (mm^2).
    contacts : PairSums
        Of every pair that touches: area (mm^2), and the sums over it (times face area) of the mean
        log density on both sides and of its absolute step.
    hulls : list of (K, 3) ndarray
        The furthest corners of every label's convex hull, mm; see `support_points`.
    hull_volumes : (M,) ndarray of float64
        mm^3.
    voxel : float
        Volume of a voxel, mm^3.
    """

    sums: NDArray[np.float64]
    contacts: PairSums
    hulls: list[NDArray[np.float64]]
    hull_volumes: NDArray[np.float64]
    voxel: float

    def join(self, one: int, two: int) -> None:
        """Add part `two` to part `one` and empty it.

        Parameters
        ----------
        one, two : int
            Labels.
        """
        self.sums[one] += self.sums[two]
        self.sums[two] = 0
        self.contacts.join(one, two)
        self.hulls[one] = support_points(np.concatenate([self.hulls[one], self.hulls[two]]))
        self.hull_volumes[one] = hull_volume(self.hulls[one])
        self.hulls[two] = self.hulls[two][:0]

    def surface(self, one: int) -> float:
        """Return the area over which a part touches others or the background, mm^2."""
        return self.contacts.total(one, AREA) + float(self.sums[one, 4])


def measure_parts(
    labels: NDArray[np.int32],
    lifted: NDArray[np.float32],
    spacing: Spacing,
    share: Share = SILENT,
) -> Parts:
    """Measure every label and every touching pair.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        Parts 1, 2, ..., 0 background.
    lifted : (Z, Y, X) ndarray of float32
        Log density, see `log_density`.
    spacing : (float, float, float) of mm, z y x
    share : Share
    """
    count = int(labels.max()) + 1
    depth = label_depths(labels, spacing)
    share(0.3)
    faces = np.prod(spacing) / np.array(spacing)
    sums, near = np.zeros((count, 5)), find_neighbours(labels, spacing)
    shared = np.zeros((len(near.other), 3))
    _measure(labels, lifted, depth, faces, sums, near.start, near.other, shared)
    # Both directions are there; the kernel fills the one from the lower label.
    once = np.repeat(np.arange(count), np.diff(near.start)) < near.other
    contacts = PairSums(count, near.pairs()[0], shared[once])
    boxes = label_boxes(labels)
    hulls = [np.zeros((0, 3))] * count
    volumes = np.zeros(count)
    for name in share.part(0.5, 1.0).over(boxes.ids.tolist()):
        box = boxes.slices(name)
        first = np.array([b.start for b in box])
        corners = support_points(mask_corners(labels[box] == name, first, spacing))
        hulls[name], volumes[name] = corners, hull_volume(corners)
    return Parts(sums, contacts, hulls, volumes, float(np.prod(spacing)))


@njit(cache=True, nogil=True)
def _measure(labels, lifted, depths, faces, sums, start, others, shared):  # type: ignore[no-untyped-def]
    """Add up what `Parts` holds of labels and of pairs of them, by the faces between them."""
    depth, height, width = labels.shape
    for z in range(depth):
        for y in range(height):
            for x in range(width):
                here, value = labels[z, y, x], lifted[z, y, x]
                if here:
                    sums[here, 0] += 1
                    sums[here, 1] += value
                    sums[here, 2] += value * value
                    sums[here, 3] += depths[z, y, x]
                for axis in range(3):
                    k, j, i = z + (axis == 0), y + (axis == 1), x + (axis == 2)
                    if k == depth or j == height or i == width:
                        continue
                    other = labels[k, j, i]
                    if other == here:
                        continue
                    if other == 0:
                        sums[here, 4] += faces[axis]
                    elif here == 0:
                        sums[other, 4] += faces[axis]
                    else:
                        beyond = lifted[k, j, i]
                        one, two = min(here, other), max(here, other)
                        row, above = start[one], start[one + 1]
                        # Rows are sorted: halve until it is the first not below.
                        while row < above:
                            middle = (row + above) // 2
                            if others[middle] < two:
                                row = middle + 1
                            else:
                                above = middle
                        shared[row, 0] += faces[axis]
                        shared[row, 1] += faces[axis] * (value + beyond) / 2
                        shared[row, 2] += faces[axis] * abs(value - beyond)


def pair_features(parts: Parts, one: int, two: int) -> NDArray[np.float64]:
    """Measure how two touching parts meet.

    Parameters
    ----------
    parts : Parts
        All parts.
    one, two : int
        Two that touch.

    Returns
    -------
    (20,) ndarray of float64
        In the order of `PAIR_FEATURES`. Shares are of a part's whole surface; thickness is four
        times the mean depth over the cube root of the volume; hull_overlap is the volume of both
        hulls less that of their union's hull, over the smaller hull; dip is how far the log
        density at the contact lies below the lesser of both means, step its mean change across
        the contact; neck is the contact over volume^(2/3) of the smaller.
    """
    small, large = sorted((one, two), key=lambda k: (parts.sums[k, 0], k))
    s, b = parts.sums[small], parts.sums[large]
    volumes = np.array([s[0], b[0]]) * parts.voxel
    contact, middle, step = parts.contacts.between(one, two)
    surface = np.array([parts.surface(small), parts.surface(large)])
    means = np.array([s[1] / s[0], b[1] / b[0]])
    spreads = np.sqrt(np.maximum([s[2] / s[0] - means[0] ** 2, b[2] / b[0] - means[1] ** 2], 0))
    thickness = np.array([4 * s[3] / s[0], 4 * b[3] / b[0]]) / np.cbrt(volumes)
    hulls = parts.hull_volumes[[small, large]]
    both = hull_volume(np.concatenate([parts.hulls[one], parts.hulls[two]]))
    return np.array(
        [
            contact / surface[0],
            contact / surface[1],
            s[4] / surface[0],
            b[4] / surface[1],
            abs(means[0] - means[1]),
            means[0] - means[1],
            np.log(volumes[1] / volumes[0]),
            np.log(volumes[0]),
            thickness[0],
            thickness[1],
            volumes[0] / hulls[0],
            volumes[1] / hulls[1],
            volumes.sum() / both,
            (hulls.sum() - both) / hulls[0],
            means.min() - middle / contact,
            step / contact,
            contact / volumes[0] ** (2 / 3),
            spreads[0],
            spreads[1],
            means.max(),
        ]
    )


@dataclass(frozen=True, eq=False)
class PairClassifier:
    """A small neural network over features of pairs.

    Parameters
    ----------
    center, scale : (F,) ndarray of float64
        z-score.
    weights, offsets : tuple of ndarray
        Of the layers; tanh between them, a logistic at the end.
    features : tuple of str
        Names of the features.
    """

    center: NDArray[np.float64]
    scale: NDArray[np.float64]
    weights: tuple[NDArray[np.float64], ...]
    offsets: tuple[NDArray[np.float64], ...]
    features: tuple[str, ...] = PAIR_FEATURES

    def probability(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the probability that each of (N, F) pairs is one object."""
        values = np.clip((rows - self.center) / self.scale, -6, 6)
        for weight, offset in zip(self.weights[:-1], self.offsets[:-1], strict=True):
            values = np.tanh(values @ weight + offset)
        final = (values @ self.weights[-1] + self.offsets[-1])[:, 0]
        return np.asarray(1 / (1 + np.exp(-np.clip(final, -40, 40))))

    def save(self, path: str | Path) -> None:
        """Write the network as an npz of plain arrays."""
        layers = {f"weight{k}": w for k, w in enumerate(self.weights)}
        layers |= {f"offset{k}": o for k, o in enumerate(self.offsets)}
        layers |= {"center": self.center, "scale": self.scale}
        with written_atomically(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, features=np.array(self.features), **layers)  # type: ignore[arg-type]

    @staticmethod
    def load(path: str | Path, features: tuple[str, ...] = PAIR_FEATURES) -> PairClassifier:
        """Read a network over the features of these names.

        Parameters
        ----------
        path : str or Path
        features : tuple of str

        Raises
        ------
        ValueError
            If the file was made for other features, or is damaged.
        """
        with read_errors_told(Path(path), "a classifier"):
            found, _ = load_arrays(path)
        if tuple(found.get("features", ())) != features:
            raise ValueError(f"{path} is not a classifier of this version; train it again")
        count = sum(name.startswith("weight") for name in found)
        return PairClassifier(
            found["center"],
            found["scale"],
            tuple(found[f"weight{k}"].astype(np.float64) for k in range(count)),
            tuple(found[f"offset{k}"].astype(np.float64) for k in range(count)),
            features,
        )


PairProbability = Callable[[int, int, NDArray[np.float64]], float]

FEW_PAIRS = 30
"""Fewer say nothing about how well a classifier tells pairs apart."""


def discrimination(chances: NDArray[np.float64]) -> float:
    """Return how well probabilities claim to tell pairs apart: 1 surely, 0 not at all.

    Parameters
    ----------
    chances : (N,) ndarray of float64
        Probabilities that pairs are one object.

    Notes
    -----
    Tjur 2009, "Coefficients of determination in logistic regression models": the mean probability
    of pairs that are one object, less that of the others. It needs no truth where probabilities
    are calibrated, for which it is their variance over that of the truth, m (1 - m) for mean m.
    """
    if len(chances) < FEW_PAIRS:
        return 1.0
    mean = float(chances.mean())
    return float(chances.var()) / max(mean * (1 - mean), np.finfo(np.float64).tiny)


TOUCHING = 0.003
"""Share of the smaller surface from which two parts touch, and are classified.

A corner against a corner merges nothing; the blades and handles of scissors, and the folds of
cloth, touch over less than a hundredth.
"""


def agglomerate(
    parts: Parts,
    classifier: PairProbability,
    least: float = 0.5,
    log: JoinLog | None = None,
    share: Share = SILENT,
    least_discrimination: float = 0.0,
) -> NDArray[np.int64]:
    """Merge touching parts while any two are more likely one object; return (M,) owners.

    Parameters
    ----------
    parts : Parts
        Measurements; used up.
    classifier : callable
        `classifier(one, two, features) -> probability` that two parts are one object.
    least : float
        Probability below which nothing is merged.
    log : JoinLog, optional
        Where merges are noted, and what was not merged.
    share : Share
    least_discrimination : float
        Nothing is merged where the classifier tells the pairs of these parts less well apart.
    """
    # Best first with a heap: a merge classifies only the merged part's neighbours anew. About a
    # millisecond a pair, most of it in convex hulls. Ties are broken by label.
    count = len(parts.sums)
    owner = np.arange(count)
    version = np.zeros(count, np.int64)
    heap: list[tuple[float, int, int, int, int]] = []

    def consider(one: int, two: int) -> float:
        one, two = min(one, two), max(one, two)
        chance = classifier(one, two, pair_features(parts, one, two))
        if chance >= least:
            heapq.heappush(heap, (-chance, one, two, int(version[one]), int(version[two])))
        elif log is not None:
            log.apart[one, two] = chance
        return chance

    surface = np.array([parts.surface(k) for k in range(count)])
    pairs, areas = parts.contacts.pairs(AREA)
    near = areas > TOUCHING * surface[pairs].min(axis=1)
    chances = [consider(*pair) for pair in share.part(0.0, 0.5).over(pairs[near].tolist())]
    if least_discrimination > 0 and discrimination(np.array(chances)) < least_discrimination:
        return owner
    merged = 0
    while heap:
        lacking, one, two, first, second = heapq.heappop(heap)
        # Entries of the heap are not removed; one of a part that has changed is out of date.
        if version[one] != first or version[two] != second:
            continue
        merged += 1
        share(0.5 + 0.5 * merged / count)
        parts.join(one, two)
        owner[owner == two] = one
        if log is not None:
            log.joined.append((one, two, -lacking))
        version[one] += 1
        version[two] = -1
        surface[one] = parts.surface(one)
        for other, row in sorted(parts.contacts.of(one).items()):
            if row[AREA] > TOUCHING * min(surface[one], surface[other]):
                consider(one, other)
    return owner
