"""What a session refuses, as sentences for people."""

from __future__ import annotations


class NobodyFreeError(ValueError):
    """Nothing in the bag can leave along the direction, and the session may not force it."""


class BlockedError(ValueError):
    """An object chosen to leave has others in front of it."""
