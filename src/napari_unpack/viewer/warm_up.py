"""What the first bag needs and takes seconds to load, made ready while a person looks for one.

Modules, the kernels of napari's label colours and those of our rays; on the first day on a machine
these are compiled. All in a worker, from the opening of the panel on.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from functools import cache, partial

import numpy as np

from napari_unpack.tasks import Progress, Task

MODULES = (
    "napari_unpack.viewer.controller",
    "napari_unpack.session.session",
    "napari_unpack.segmentation.pipeline",
    "napari_unpack.segmentation.learned.method",
    "napari_unpack.io.sessions",
    "napari_unpack.io.session_json",
)
# Of the labels that Segment finds.
FOUND = np.dtype(np.int32)
# Voxels: small, and yet three objects have room to block one another.
SHAPE = (20, 24, 28)
PICTURE = (24, 32)


def warm_up_task() -> Task[None]:
    """Return the task; in a process that has done it once there is nothing left to do."""
    return Task("warm up", _warm_up)


def _warm_up(progress: Progress) -> None:
    # In small pieces, so that a panel that is closed waits for none but the one under way.
    for piece in _pieces():
        progress(0.0, "Preparing")
        piece()


def _pieces() -> Iterator[Callable[[], object]]:
    yield from (partial(importlib.import_module, name) for name in MODULES)
    yield from (_tints, _cast, partial(color_labels, FOUND))


@cache
def _tints() -> None:
    from napari_unpack.appearance import tints_of
    from napari_unpack.appearance.tints import MODES

    for mode in MODES:
        tints_of({1: 0.5}, 1, mode=mode)


@cache
def color_labels(kind: np.dtype[np.generic], count: int = 1) -> None:
    """Have napari compile what colours labels of a type, in slices and in 3D; for workers.

    Parameters
    ----------
    kind : dtype
    count : int
        How many objects: of many napari numbers the colours in 16 bits, which is other code.
    """
    from napari_unpack.layers import compat
    from napari_unpack.layers.label_colormap import label_colormap

    colors = label_colormap({i + 1: (i / count, 0, 0, 1) for i in range(count)}, np.zeros(4))
    for dimensions in (2, 3):
        labels = np.zeros((2,) * dimensions, kind)
        compat.color_labels(colors, labels)


@cache
def _cast() -> None:
    """Do with a small bag what is done with the first one, on the CPU."""
    from napari_unpack.rendering.compose import scene_image
    from napari_unpack.session import Session
    from napari_unpack.viewer.background_queries import prefetch

    labels = np.zeros(SHAPE, np.uint16)
    labels[4:16, 4:10, 4:24], labels[4:16, 10:16, 4:14], labels[4:10, 16:22, 6:20] = 1, 2, 3
    session = Session(labels * 400 + 20, labels)
    session.backend = "cpu"
    session.recolor()
    session.unpack(1)
    scene, camera = session.scene(), session.overview()
    prefetch(session.bag, scene, camera, session.ids[-1])
    scene_image(scene, camera, PICTURE, backend="cpu")
