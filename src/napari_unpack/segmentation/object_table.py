"""The table of objects, and their IDs: 1, 2, ... from the largest to the smallest."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from napari_unpack.geometry.boxes import label_boxes
from napari_unpack.kernels import njit
from napari_unpack.segmentation.common.array_source import Box, face_steps, framed
from napari_unpack.segmentation.common.density_regions import air_offset
from napari_unpack.segmentation.common.region import Oracle, Region
from napari_unpack.segmentation.common.validation import Spacing, in_common_range
from napari_unpack.segmentation.confidence.oracle import default_oracle
from napari_unpack.tasks import SILENT, Share


@dataclass(frozen=True, eq=False)
class ObjectSums:
    """What is added up over the voxels of every label, block by block.

    Parameters
    ----------
    totals : (M, 6) ndarray of float64
        By label: voxels, the sums of z, y and x (voxels), density, voxels with a finite density.
    area : (M,) ndarray of float64
        Faces to other labels, background and the volume's border, mm^2.
    """

    totals: NDArray[np.float64]
    area: NDArray[np.float64]

    @classmethod
    def empty(cls, top: int) -> ObjectSums:
        """Return sums of nothing for labels up to `top`."""
        return cls(np.zeros((top + 1, 6)), np.zeros(top + 1))

    def add(
        self,
        labels: NDArray[np.int32],
        density: NDArray[np.generic],
        spacing: Spacing,
        start: tuple[int, int, int] = (0, 0, 0),
        inner: Box | None = None,
        share: Share = SILENT,
    ) -> None:
        """Add a block.

        Parameters
        ----------
        labels : (Z, Y, X) ndarray of int32
            The block, with the voxels around it where the volume has them.
        density : (Z, Y, X) ndarray
            Density of the same voxels.
        spacing : (float, float, float) of mm, z y x
        start : (int, int, int)
            First of these voxels in the volume.
        inner : tuple of slice, optional
            Those of them that count; the others are neighbours only. By default all.
        share : Share
        """
        box = inner or (
            slice(0, labels.shape[0]),
            slice(0, labels.shape[1]),
            slice(0, labels.shape[2]),
        )
        faces, first = np.repeat(np.prod(spacing) / np.array(spacing), 2), box[0].start
        for slab in share.slabs((box[0].stop - first, *labels.shape[1:])):
            part = slice(slab[0] + first, slab[1] + first), box[1], box[2]
            # Framed by a voxel, where the kernel need not ask whether there are neighbours; of one
            # type, so that it is compiled once.
            near = framed(labels, part, 1, np.int32)
            values = np.ascontiguousarray(density[part], np.float64)
            place = np.array([o + s.start for o, s in zip(start, part, strict=True)])
            steps = face_steps(near.shape)
            _add(near.reshape(-1), values, place, steps, faces, self.totals, self.area)

    def table(
        self, spacing: Spacing, confidence: Mapping[int, float] | None = None
    ) -> pd.DataFrame:
        """Return the table of all labels that have voxels, columns as in `Segmentation`.

        Parameters
        ----------
        spacing : (float, float, float) of mm, z y x
        confidence : mapping of int to float, optional
            By label; without it there is no such column.
        """
        ids = np.flatnonzero(self.totals[:, 0])
        totals, counts = self.totals[ids], self.totals[ids, 0]
        volume = counts * float(np.prod(spacing))
        centers = totals[:, 1:4] / counts[:, None] * np.array(spacing)
        table = pd.DataFrame(
            {
                "voxels": counts.astype(np.int64),
                "volume_mm3": volume,
                "mean_density": totals[:, 4] / np.where(totals[:, 5] > 0, totals[:, 5], np.nan),
                "z": centers[:, 0],
                "y": centers[:, 1],
                "x": centers[:, 2],
                "isoperimetric_ratio": self.area[ids] / volume,
            },
            index=pd.Index(ids, name="id"),
        )
        if confidence is not None:
            table["confidence"] = np.array([confidence[k] for k in ids.tolist()], np.float64)
        return table


def object_table(
    labels: NDArray[np.int32],
    density: NDArray[np.generic],
    spacing: Spacing,
    oracle: Oracle | None = None,
    share: Share = SILENT,
) -> pd.DataFrame:
    """Measure every object; columns as in `pipeline.Segmentation`.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
    density : (Z, Y, X) ndarray
    spacing : (float, float, float) of mm, z y x
    oracle : callable, optional
        Confidence of a region; by default the oracle that ships with the package.
    share : Share
    """
    sums = ObjectSums.empty(int(labels.max(initial=0)))
    sums.add(labels, density, spacing)
    return sums.table(spacing, confidences(labels, density, spacing, oracle, share))


def confidence_in(oracle: Oracle, region: Region) -> float:
    """Rate an object, in [0, 1]; 0 where the oracle has no number, as of densities too large.

    Parameters
    ----------
    oracle : callable
    region : Region
    """
    value = float(oracle(region))
    return min(max(value, 0.0), 1.0) if np.isfinite(value) else 0.0


def confidences(
    labels: NDArray[np.integer],
    density: NDArray[np.generic],
    spacing: Spacing,
    oracle: Oracle | None = None,
    share: Share = SILENT,
    ids: Iterable[int] | None = None,
) -> dict[int, float]:
    """Rate every object, by label, as `confidence_in` does.

    Parameters
    ----------
    labels, density, spacing, oracle, share
        As for `object_table`.
    ids : iterable of int, optional
        Labels of those to rate; by default all.
    """
    boxes, density = label_boxes(labels), in_common_range(density)[0]
    air = air_offset(density, labels)
    confidence_of = oracle or default_oracle()
    found = {}
    for name in share.over(boxes.ids.tolist() if ids is None else list(ids)):
        box = boxes.slices(name)
        region = Region.of(labels[box] == name, density, box, spacing, air)
        found[name] = confidence_in(confidence_of, region)
    return found


@njit(cache=True, nogil=True)
def _add(labels, density, start, steps, faces, totals, area):  # type: ignore[no-untyped-def]
    """Add the voxels of a block, whose labels have a frame and are flat, to their labels' sums."""
    depth, height, width = density.shape
    for z in range(depth):
        for y in range(height):
            row = (z + 1) * steps[1] + (y + 1) * steps[3] + 1
            for x in range(width):
                label = labels[row + x]
                if label == 0:
                    continue
                sums = totals[label]
                sums[0] += 1
                sums[1] += z + start[0]
                sums[2] += y + start[1]
                sums[3] += x + start[2]
                value = density[z, y, x]
                if np.isfinite(value):
                    sums[4] += value
                    sums[5] += 1
                for k in range(6):
                    if labels[row + x + steps[k]] != label:
                        area[label] += faces[k]


def ranks(voxels: NDArray[np.number]) -> NDArray[np.int32]:
    """Return the new name of every label, the largest first, from their voxels, (M,).

    0 for background, label 0, and for those without voxels.
    """
    counts = voxels.copy()
    counts[0] = 0
    present = int(np.count_nonzero(counts))
    names = np.zeros(len(counts), np.int32)
    names[np.argsort(-counts, kind="stable")[:present]] = np.arange(1, present + 1)
    return names


def rank_labels(labels: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return (Z, Y, X) int32 labels renumbered 1, 2, ... from the largest to the smallest."""
    return ranks(np.bincount(labels.reshape(-1)))[labels]
