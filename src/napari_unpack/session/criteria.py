"""Who may leave: the rules of a session, which make what was asked under others worthless."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

from napari_unpack.session.asking import OcclusionAnswer
from napari_unpack.session.label_edits import SessionRepair
from napari_unpack.unpacking.occlusion import Rule


class SessionCriteria(SessionRepair):
    """The settings by which the queue is filled; none is undoable.

    Setting one that differs empties the queue, so that the next question goes by it.
    """

    _answer: OcclusionAnswer | None = None
    _rule: Rule = "exact"
    _tolerance: float = 0.0
    _most_in_group: int = 4
    _take_least_occluded: bool = True

    @property
    def rule(self) -> Rule:
        """What counts as free; see `unpacking.unpackable_ids`."""
        return self._rule

    @rule.setter
    def rule(self, rule: Rule) -> None:
        if rule not in get_args(Rule):
            raise ValueError(f"rule must be one of {', '.join(get_args(Rule))}, got {rule!r}")
        if rule != self._rule:
            self._rule = rule
            self._ask_anew()

    @property
    def tolerance(self) -> float:
        """Share of an object that may be blocked and it still counts as free."""
        return self._tolerance

    @tolerance.setter
    def tolerance(self, tolerance: float) -> None:
        if not 0.0 <= tolerance < 1.0:
            raise ValueError(f"tolerance must be in [0, 1), got {tolerance!r}")
        if tolerance != self._tolerance:
            self._tolerance = float(tolerance)
            self._ask_anew()

    @property
    def max_group_size(self) -> int:
        """Interlocked groups of up to so many leave together; a larger knot is nobody."""
        return self._most_in_group

    @max_group_size.setter
    def max_group_size(self, most: int) -> None:
        if most < 1:
            raise ValueError(f"max_group_size must be at least 1, got {most!r}")
        if most != self._most_in_group:
            self._most_in_group = int(most)
            self._ask_anew()

    @property
    def take_least_occluded(self) -> bool:
        """What happens when nobody is free: True takes the least occluded, False raises."""
        return self._take_least_occluded

    @take_least_occluded.setter
    def take_least_occluded(self, least: bool) -> None:
        if bool(least) != self._take_least_occluded:
            self._take_least_occluded = bool(least)
            self._ask_anew()

    @property
    def criterion(self) -> tuple[str, float]:
        """Rule and tolerance: what an answer must have been asked with."""
        return self._rule, self._tolerance

    @property
    def _terms(self) -> tuple[object, ...]:
        """All that the queue depends on besides D and who is packed."""
        return (*self.criterion, self._most_in_group, self._take_least_occluded)

    def _ask_anew(self) -> None:
        if self._answer is not None and self._answer.criterion != self.criterion:
            self._answer = None
        queue = replace(self._situation.queue, groups=())
        self._enter(replace(self._situation, queue=queue))
