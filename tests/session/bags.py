"""Small bags, and ray queries written for the tests, along axes only."""

from __future__ import annotations

import numpy as np

from napari_unpack.geometry.occlusion_counts import OcclusionCounts
from napari_unpack.geometry.view import View
from napari_unpack.session import Session


class AxisRays:
    """Cast along the axis nearest the direction of looking, voxel by voxel."""

    can_sweep = False

    def __init__(self, labels: np.ndarray) -> None:
        self.labels = labels
        self.asked = 0
        self.visible: list[set[int]] = []

    def rays(self, camera, visible):
        axis = int(np.abs(camera.direction).argmax())
        lines = np.moveaxis(self.labels, axis, -1)
        if camera.direction[axis] < 0:
            lines = lines[..., ::-1]
        shown = np.where(visible[lines], lines, 0)
        self.visible.append({int(i) for i in np.flatnonzero(visible)})
        return shown

    def occlusion_counts(self, camera, visible, size, backend):
        self.asked += 1
        top = len(visible)
        counts = np.zeros((5, top), np.int64)
        blocks = np.zeros((top, top), bool)
        shown = self.rays(camera, visible)
        for ray in shown.reshape(-1, shown.shape[-1]):
            seen: list[int] = []
            for label in ray:
                if label == 0:
                    continue
                if label not in seen:
                    seen.append(int(label))
                    counts[1, label] += 1
                    counts[2, label] += len(seen) > 1
                counts[0, label] += 1
                counts[3, label] += label != seen[0]
                counts[4, label] += len(seen) > 1
                for other in seen:
                    if other != label:
                        blocks[other, label] = True
        ids = np.flatnonzero(counts[0])
        return OcclusionCounts(ids, *counts, blocks=blocks[np.ix_(ids, ids)])

    def object_ids(self, camera, visible, size, layers, clipping, backend):
        shown = self.rays(camera, visible)
        out = np.zeros((layers, *shown.shape[:2]), np.int32)
        for row in range(shown.shape[0]):
            for col in range(shown.shape[1]):
                found = list(dict.fromkeys(int(i) for i in shown[row, col] if i))
                for k, label in enumerate(found[:layers]):
                    out[k, row, col] = label
        return out

    def sweep_table(self, direction, visible, moved):
        raise AssertionError("voxels cannot be moved")

    sweep_test = sweep_table


def stack_of_plates(count: int = 5) -> np.ndarray:
    """Plates 1 to `count` behind each other along z, 1 having the least z."""
    labels = np.zeros((3 * count + 1, 6, 8), np.uint16)
    for i in range(count):
        labels[3 * i + 1 : 3 * i + 3, 1:5, 1:7] = i + 1
    return labels


def hooked() -> np.ndarray:
    """Two hooks (1, 2) that hold each other along z, and a plate (3) behind them."""
    labels = np.zeros((9, 6, 6), np.uint16)
    labels[1, 1:5, 1:3] = 1
    labels[3, 1:5, 1:5] = 2
    labels[5, 1:5, 3:5] = 1
    labels[7, 1:5, 1:5] = 3
    return labels


def session_of(labels: np.ndarray, **arguments) -> Session:
    """Make a session looking along z, with density by label and the rays above."""
    volume = np.where(labels > 0, 1000.0 + 10 * labels, 0.0).astype(np.float32)
    session = Session(volume, labels, casters=AxisRays(labels), **arguments)
    session.view = View(direction=(1.0, 0.0, 0.0))
    return session
