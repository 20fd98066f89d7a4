"""Errors of a session, as sentences for people, and how numbers are put in words."""

from __future__ import annotations

from collections.abc import Iterable

NOTHING_UNPACKABLE = "Nothing is unpackable this way"


class NobodyFreeError(ValueError):
    """Nothing in the bag is unpackable along D, and the rules force nothing."""


class BlockedError(ValueError):
    """An object chosen to leave has others in front of it."""


class OutsideError(ValueError):
    """Objects outside the bag are not repaired: they must be restored first."""


class NoTableError(ValueError):
    """It is not known what blocks what."""

    @classmethod
    def of(cls, packed: int) -> NoTableError:
        """Make the error for a bag with so many packed objects."""
        return cls(
            "reveal needs to know which objects block which, and only the rule 'exact' finds that, "
            f"up to 4,096 objects; {packed} are packed: choose that rule, or hide or unpack some "
            "first"
        )


def listed(names: Iterable[str]) -> str:
    """Join names for a sentence, three and a number where they are many."""
    found = list(names)
    # Of four, "three and one other" would be longer than the fourth name.
    if len(found) > 4:
        found = [*found[:3], f"{len(found) - 3} others"]
    return found[0] if len(found) == 1 else f"{', '.join(found[:-1])} and {found[-1]}"


def listed_objects(names: Iterable[str]) -> str:
    """Join names for a sentence: "Objects 5 and 6" of "Object 5" and "Object 6"."""
    found = list(names)
    numbers = [name.removeprefix("Object ") for name in found]
    # Default names alone; names that people gave, and those of parts, stay whole.
    if len(found) > 1 and all(
        name == f"Object {n}" and n.isdecimal() for name, n in zip(found, numbers, strict=True)
    ):
        return f"Objects {listed(numbers)}"
    return listed(found)


def share_of(ratio: float) -> str:
    """Write a share for a sentence; a small one never as 0 %."""
    return f"{100 * ratio:.0f} %" if ratio >= 0.01 else "under 1 %"


def percent(confidence: float) -> str:
    """Write a confidence; never as 100 %, since no oracle is that sure."""
    return f"{min(100 * confidence, 99):.0f} %"
