"""The directions in which objects may leave, by name and in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from napari_unpack.geometry.axes import Vector, unit
from napari_unpack.geometry.view import Camera

Direction = str | tuple[float, float, float] | None
# Shown for a direction that was drawn, or that has no name.
ALONG_ARROW = "Along arrow"

# As `Session.direction` takes them: None is the opposite of the view, "up" the bag's own up.
DIRECTIONS: dict[str, Direction] = {
    "Towards you": None,
    "Out of the bag": "up",
    "Up (−y)": (0.0, -1.0, 0.0),
    "Down (+y)": (0.0, 1.0, 0.0),
    "Left (−x)": (0.0, 0.0, -1.0),
    "Right (+x)": (0.0, 0.0, 1.0),
    "Front (+z)": (1.0, 0.0, 0.0),
    "Back (−z)": (-1.0, 0.0, 0.0),
}


# Along the axes of pivot space, and against them.
WORDS = (("towards you", "away from you"), ("down", "up"), ("to the right", "to the left"))

# Components of a unit vector below this are not named: they turn it by less than 15 degrees.
LEAST_COMPONENT = 0.25


def name_of(direction: Direction) -> str | None:
    """Return the name of a direction, or None where it has none."""
    return next((name for name, each in DIRECTIONS.items() if each == direction), None)


def words_of(
    direction: Sequence[float] | Vector,
    camera: Camera,
    apart_from: Sequence[float] | Vector | None = None,
) -> str:
    """Return a direction in words as the bag is seen now: "up", "to the left and up".

    Parameters
    ----------
    direction : (3,) sequence of float
        World, z y x.
    camera : Camera
    apart_from : (3,) sequence of float, optional
        Another direction; where the same words would say both, this one's say how it differs:
        "towards you, slightly up".

    Returns
    -------
    str
        The largest component first.
    """
    vector = unit(camera.linear @ np.asarray(direction, dtype=float))
    order = np.argsort(-np.abs(vector), kind="stable")
    axes = [k for k in order if abs(vector[k]) > LEAST_COMPONENT]
    words = [WORDS[k][int(vector[k] < 0)] for k in axes]
    told = words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
    if apart_from is not None and told == words_of(apart_from, camera):
        other = unit(camera.linear @ np.asarray(apart_from, dtype=float))
        most = int(np.abs(vector - other).argmax())
        return f"{told}, slightly {WORDS[most][int(vector[most] < other[most])]}"
    return told
