"""The directions in which objects may leave, by name."""

from __future__ import annotations

Direction = str | tuple[float, float, float] | None
TOWARDS_ME = "Towards me"
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


def name_of(direction: Direction) -> str | None:
    """Return the name of a direction, or None where it has none."""
    return next((name for name, each in DIRECTIONS.items() if each == direction), None)
