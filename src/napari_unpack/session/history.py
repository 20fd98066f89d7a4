"""Undo and redo by keeping states."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Literal

from napari_unpack.session.labels import Edit
from napari_unpack.session.state import SessionState

# States share most of their parts; what they do not share is small, but not nothing.
MOST_STEPS = 500

WORKED_OUT = {"queue", "undone"}
"""Parts of a state that follow from what was done: which objects leave next or again."""


@dataclass(frozen=True, eq=False)
class Step:
    """One command that can be undone.

    Parameters
    ----------
    verb : str
        What was done, for people.
    before, after : SessionState
    """

    verb: str
    before: SessionState
    after: SessionState

    @property
    def changes(self) -> bool:
        """Whether something differs after it that a person has chosen."""
        pairs = (
            (getattr(self.before, f.name), getattr(self.after, f.name))
            for f in fields(SessionState)
            if f.name not in WORKED_OUT
        )
        # Identity first: comparing mappings takes long.
        return any(a is not b and a != b for a, b in pairs)


class History:
    """Steps done and undone."""

    def __init__(self) -> None:
        self._done: list[Step] = []
        self._undone: list[Step] = []

    @property
    def done(self) -> tuple[Step, ...]:
        """Steps that can be undone, the latest last."""
        return tuple(self._done)

    def edit_after(self, way: Literal["undo", "redo"], now: Edit | None) -> Edit | None:
        """Return which edit of the labels there is after the next step back or forth.

        Parameters
        ----------
        way : {"undo", "redo"}
        now : Edit, optional
            The edit there is now.
        """
        steps = self._done if way == "undo" else self._undone
        if not steps:
            return now
        before, after = steps[-1].before.labels_edit, steps[-1].after.labels_edit
        # A step that leaves the labels alone does not say which they are now.
        if before is after:
            return now
        return before if way == "undo" else after

    def clear(self) -> None:
        """Forget all steps."""
        self._done.clear()
        self._undone.clear()

    def every(self, change: Callable[[SessionState], SessionState]) -> None:
        """Change the states of all steps, by what keeps the parts that they share."""

        def changed(step: Step) -> Step:
            return Step(step.verb, change(step.before), change(step.after))

        self._done, self._undone = [*map(changed, self._done)], [*map(changed, self._undone)]

    def push(self, step: Step, merge: bool = False) -> None:
        """Add a step, which ends the possibility to redo; not one that changes nothing.

        Parameters
        ----------
        step : Step
            Done just now.
        merge : bool
            Make one step of it and the last if that was of the same verb, as when dragging.
        """
        if not step.changes:
            return
        self._undone.clear()
        if merge and self._done and self._done[-1].verb == step.verb:
            last = self._done.pop()
            # What has changed between the two otherwise is not the step's to take back.
            before = step.before.with_changes_of(last.after, last.before)
            step = Step(step.verb, before, step.after)
            # There and back again.
            if not step.changes:
                return
        self._done.append(step)
        del self._done[:-MOST_STEPS]

    def undo(self, current: SessionState) -> tuple[Step, SessionState] | None:
        """Return the step taken back and the state then, None where there is none."""
        if not self._done:
            return None
        # Not simply `before`: hues may have been chosen since for another view, without a step.
        step = self._done.pop()
        self._undone.append(step)
        return step, current.with_changes_of(step.after, step.before)

    def redo(self, current: SessionState) -> tuple[Step, SessionState] | None:
        """Return the step done again and the state then, None where there is none."""
        if not self._undone:
            return None
        step = self._undone.pop()
        self._done.append(step)
        return step, current.with_changes_of(step.before, step.after)
