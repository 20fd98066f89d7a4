"""What a session tells those who listen."""

from __future__ import annotations

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
    surroundings = Signal(object, description="the new Surroundings: background, box, scale")
    selected = Signal(frozenset, description="IDs selected")
    message = Signal(str, description="a sentence for the user")
