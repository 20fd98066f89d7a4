"""What a stage tells those who listen."""

from __future__ import annotations

from psygnal import Signal, SignalGroup


class StageEvents(SignalGroup):
    """What a stage tells.

    frame: a picture of moving objects was shown. landed: a flight has ended, its object's ID.
    message: a sentence for the user. closed: the stage is off. looking: whether a command
    waits until it is known who is free. drawn: a direction was drawn, or
    that was called off.
    """

    frame = Signal()
    landed = Signal(int)
    message = Signal(str)
    closed = Signal()
    drawn = Signal()
    looking = Signal(bool)
