"""Where an object of a session is; a module of its own, since widgets load it with their window."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum


class ObjectState(Enum):
    """Where an object is; it is in exactly one of these."""

    PACKED = "packed"
    FLYING_OUT = "flying out"
    UNPACKED = "unpacked"
    FLYING_BACK = "flying back"
    INSPECTED = "inspected"
    HIDDEN = "hidden"

    @property
    def is_outside(self) -> bool:
        """Whether the object has left the bag or is leaving: restoring brings it back."""
        return self in (ObjectState.FLYING_OUT, ObjectState.UNPACKED, ObjectState.INSPECTED)

    @property
    def is_flying(self) -> bool:
        """Whether the object is on its way out or back."""
        return self in (ObjectState.FLYING_OUT, ObjectState.FLYING_BACK)


def ids_in(states: Mapping[int, ObjectState], *wanted: ObjectState) -> list[int]:
    """Return the IDs of the objects that are in one of some states.

    Parameters
    ----------
    states : mapping of int to ObjectState
        Of each object by ID; that of a session is `session.states`.
    *wanted : ObjectState
    """
    return [i for i, state in states.items() if state in wanted]
