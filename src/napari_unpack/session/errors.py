"""What a session refuses, as sentences for people, and how numbers are put in words."""

from __future__ import annotations

from collections.abc import Iterable


class NobodyFreeError(ValueError):
    """Nothing in the bag can leave along the direction, and the session may not force it."""


class BlockedError(ValueError):
    """An object chosen to leave has others in front of it."""


class NoTableError(ValueError):
    """It is not known who blocks whom."""

    @classmethod
    def of(cls, packed: int) -> NoTableError:
        """Say so of a bag with so many objects in it."""
        return cls(
            "reveal needs the table of blockers, which only the rule 'exact' has, and only up to "
            f"4,096 objects; {packed} are packed: choose that rule, or hide or unpack some first"
        )


def listed(names: Iterable[str]) -> str:
    """Join names for a sentence, three and a number where they are many."""
    found = list(names)
    if len(found) > 4:
        found = [*found[:3], f"{len(found) - 3} others"]
    return found[0] if len(found) == 1 else f"{', '.join(found[:-1])} and {found[-1]}"


def share_of(ratio: float) -> str:
    """Say a share for a sentence, never as the nothing that a small one rounds to."""
    return f"{100 * ratio:.0f} %" if ratio >= 0.01 else "less than 1 %"


def percent(confidence: float) -> str:
    """Write a confidence; nobody is sure to 100 %."""
    return f"{min(100 * confidence, 99):.0f} %"
