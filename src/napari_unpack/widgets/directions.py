"""The directions in which objects may leave, by name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from napari_unpack.geometry.axes import unit
from napari_unpack.geometry.view import Camera

Direction = str | tuple[float, float, float] | None
TOWARDS_ME = "Towards me"
ALONG_ARROW = "Along arrow"
DIRECTIONS: dict[str, Direction] = {
    TOWARDS_ME: None,
    "Out of the bag": "up",
    "Up (−y)": (0.0, -1.0, 0.0),
    "Down (+y)": (0.0, 1.0, 0.0),
    "Left (−x)": (0.0, 0.0, -1.0),
    "Right (+x)": (0.0, 0.0, 1.0),
    "Front (+z)": (1.0, 0.0, 0.0),
    "Back (−z)": (-1.0, 0.0, 0.0),
}
"""As `Session.direction` takes them: None is the opposite of the view, "up" the bag's own up."""


WAYS = (("towards you", "away from you"), ("down", "up"), ("to the right", "to the left"))
"""Of the axes of the picture, along them and against them."""


def name_of(direction: Direction) -> str | None:
    """Return the name of a direction, or None where it has none."""
    return next((name for name, each in DIRECTIONS.items() if each == direction), None)


def words_of(direction: Sequence[float], camera: Camera) -> str:
    """Say which way a direction points as the bag is seen now: "up", "to the left and up".

    Parameters
    ----------
    direction : (3,) sequence of float
        World, z y x.
    camera : Camera
        Of the session.

    Returns
    -------
    str
        Its largest part first.
    """
    vector = unit(camera.linear @ np.asarray(direction, dtype=float))
    parts = [k for k in np.argsort(-np.abs(vector), kind="stable") if abs(vector[k]) > 0.25]
    words = [WAYS[k][int(vector[k] < 0)] for k in parts]
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
