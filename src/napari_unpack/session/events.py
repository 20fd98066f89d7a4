"""What a session tells those who listen.

The record of departures: what the paper's figure 7 is drawn from.
"""

from __future__ import annotations

from dataclasses import dataclass

from psygnal import Signal, SignalGroup


class SessionEvents(SignalGroup):
    """Signals of a session.

    Each is emitted after the change, from the thread that made it.
    """

    states = Signal(frozenset, description="IDs whose state, pose or name changed")
    labels = Signal(frozenset, description="IDs that came, went or have other voxels now")
    hues = Signal(dict, description="{id: hue}, all of them")
    transfer_function = Signal(object, description="the new TransferFunction")
    queue = Signal(tuple, description="IDs that can leave, the next one first")
    view = Signal(object, description="the new Camera")
    surroundings = Signal(object, description="the new Decorations: background, box, scale")
    selected = Signal(frozenset, description="IDs selected")
    message = Signal(str, description="a sentence for the user")


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
