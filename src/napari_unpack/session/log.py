"""The record of departures: what the paper's figure 7 is drawn from."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LogEntry:
    """One departure, for the paper's figure 7.

    Parameters
    ----------
    event : {"query run", "queue reuse"}
        Whether rays were cast for it.
    ids : tuple of int
        Who left.
    packed : int
        Objects in the bag before.
    ratio : float
        Occlusion ratio (`first_hit`): 0 but where the least occluded object was taken.
    seconds : float
        What the query took; 0 for reuse.
    """

    event: str
    ids: tuple[int, ...]
    packed: int
    ratio: float
    seconds: float
