"""The directions in which objects may leave, by name."""

from __future__ import annotations

TOWARDS_ME = "Towards me"
DIRECTIONS: dict[str, tuple[float, float, float] | None] = {
    TOWARDS_ME: None,
    "Up (−y)": (0.0, -1.0, 0.0),
    "Down (+y)": (0.0, 1.0, 0.0),
    "Left (−x)": (0.0, 0.0, -1.0),
    "Right (+x)": (0.0, 0.0, 1.0),
    "Front (+z)": (1.0, 0.0, 0.0),
    "Back (−z)": (-1.0, 0.0, 0.0),
}
"""World directions (z, y, x); None is the opposite of the view, wherever that points."""


def name_of(direction: tuple[float, float, float] | None) -> str | None:
    """Return the name of a direction, or None where it has none."""
    if direction is None:
        return TOWARDS_ME
    wanted = tuple(float(part) for part in direction)
    return next((name for name, vector in DIRECTIONS.items() if vector == wanted), None)
