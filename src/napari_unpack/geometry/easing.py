"""How everything that moves or fades starts and stops: one function for all animation."""

from __future__ import annotations


def ease(share: float) -> float:
    """Return how far a movement is after a share of its time, at rest at both ends.

    3 s^2 - 2 s^3, the smoothstep of graphics: the lowest polynomial without speed at its ends.
    Before 0 it has not begun, after 1 it is over.
    """
    s = min(max(share, 0.0), 1.0)
    return s * s * (3.0 - 2.0 * s)
