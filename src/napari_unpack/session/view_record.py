"""Camera and view as plain data, and back."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.view import Camera, View
from napari_unpack.session.fields import Fields


def camera_record(camera: Camera) -> dict[str, Any]:
    """Return a camera as plain data."""
    return {
        "rotation": camera.rotation.tolist(),
        "center": camera.center.tolist(),
        "height": camera.height,
        "fov": camera.fov,
        "stretch": camera.stretch.tolist(),
    }


def camera_from(fields: Fields) -> Camera:
    """Make the camera a record was made of."""
    return Camera(
        fields.rotation(),
        fields.array("center", (3,)),
        fields.positive("height"),
        _angle(fields),
        _stretch(fields) if fields.has("stretch") else np.eye(3),
    )


def view_record(view: View) -> dict[str, Any]:
    """Return a view, as it was asked for, as plain data."""
    return {
        "direction": list(view.direction),
        "up": None if view.up is None else list(view.up),
        "center": None if view.center is None else list(view.center),
        "height": view.height,
        "fov": view.fov,
    }


def view_from(fields: Fields) -> View:
    """Make the view a record was made of."""

    def triple(name: str) -> tuple[float, float, float] | None:
        if not fields.has(name):
            return None
        z, y, x = (float(v) for v in fields.array(name, (3,)))
        return z, y, x

    height = fields.positive("height") if fields.has("height") else None
    direction = triple("direction") or (0.0, 0.0, 1.0)
    return View(direction, triple("up"), triple("center"), height, _angle(fields))


def _stretch(fields: Fields) -> NDArray[np.float64]:
    stretch = fields.array("stretch", (3, 3))
    upright = stretch * np.sign(np.linalg.det(stretch))
    lengths = np.linalg.eigvalsh(upright)
    same = np.allclose(stretch, stretch.T, atol=1e-6)
    if not same or lengths.min() <= 1e-3 or abs(np.prod(lengths) - 1) > 1e-3:
        raise ValueError(
            "session.camera.stretch must be symmetric, definite and of determinant 1 or -1, got "
            f"{stretch.tolist()}"
        )
    return stretch


def _angle(fields: Fields) -> float:
    fov = fields.number("fov")
    if not 0.0 <= fov < 170.0:
        raise ValueError(f"session.camera.fov must be in [0, 170), got {fov}")
    return fov
