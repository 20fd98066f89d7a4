"""Errors of a session, as sentences for people, and how numbers are put in words."""

from __future__ import annotations

from collections.abc import Iterable


class NobodyFreeError(ValueError):
    """No object is unpackable along the direction, and the session may not force one."""


class BlockedError(ValueError):
    """An object chosen to leave has others in front of it."""


class NoTableError(ValueError):
    """It is not known which objects block which."""

    @classmethod
    def of(cls, packed: int) -> NoTableError:
        """Make the error for a bag with so many packed objects."""
        return cls(
            "reveal needs to know which objects block which, and only the rule 'exact' finds that, "
            f"up to 4,096 objects; {packed} are packed: choose that rule, or hide or unpack some"
        )


def listed(names: Iterable[str]) -> str:
    """Join names for a sentence, three and a number where they are many."""
    found = list(names)
    if len(found) > 4:
        found = [*found[:3], f"{len(found) - 3} others"]
    return found[0] if len(found) == 1 else f"{', '.join(found[:-1])} and {found[-1]}"


def share_of(ratio: float) -> str:
    """Write a share for a sentence; a small one never as 0 %."""
    return f"{100 * ratio:.0f} %" if ratio >= 0.01 else "less than 1 %"


def percent(confidence: float) -> str:
    """Write a confidence; never as 100 %, since no oracle is that sure."""
    return f"{min(100 * confidence, 99):.0f} %"
