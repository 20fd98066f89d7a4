"""The same moment drawn by both casters."""

from __future__ import annotations

from typing import Any

import numpy as np

from napari_unpack.layers.rendered_image import CanvasImage
from viewer_fixtures import canvas


def pictures_of_both(viewer: Any, controller: Any) -> dict[str, np.ndarray]:
    """Return what the canvas shows by either backend; the session's clock must stand still."""
    pictures = {}
    for backend in ("cpu", "gl"):
        controller.backend = backend
        for _ in range(3):
            controller.step(20)
        assert controller.casts_with == backend
        assert isinstance(controller.packed.image, CanvasImage) == (backend == "gl")
        assert sorted(controller.transition.images) == sorted(controller.session.flights)
        pictures[backend] = canvas(viewer)
    assert pictures["cpu"].std() > 10
    return pictures


def assert_alike(pictures: dict[str, np.ndarray]) -> None:
    """Compare two pictures but for outlines of what moves, cast on pixels of another size."""
    difference = np.abs(pictures["gl"] - pictures["cpu"]).max(axis=2)
    assert np.quantile(difference, 0.97) <= 3.0
    assert difference.mean() < 0.8
