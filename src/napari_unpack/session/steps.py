"""An unpacking as a row of departures, gone along in both directions."""

from __future__ import annotations

from dataclasses import replace

from napari_unpack.session.errors import NobodyFreeError
from napari_unpack.session.leaving import Group, SessionLeaving


class SessionSteps(SessionLeaving):
    """The departures so far, and the way to any of them."""

    @property
    def steps(self) -> tuple[Group, ...]:
        """Departures known: those done, then those `go_to` has taken back."""
        situation = self._situation
        return (*situation.removals, *(tuple(ahead) for ahead in situation.ahead))

    @property
    def step(self) -> int:
        """How many departures are done."""
        return len(self._situation.removals)

    def go_to(self, step: int) -> int:
        """Take back or repeat departures until so many are done; 0 is the packed bag.

        Parameters
        ----------
        step : int
            Beyond the departures known, the next to leave are unpacked as by `unpack`.

        Returns
        -------
        int
            How many are done now; fewer than asked for where nothing is left that can leave.

        Raises
        ------
        ValueError
            If the step is negative.

        Notes
        -----
        Repeated departures end in the same places, turned by hand or not. Successive calls are
        one step of undo.
        """
        if step < 0:
            raise ValueError(f"step must not be negative, got {step!r}")
        situation = replace(self._situation.at_step(int(step)), inspected=None)
        try:
            while len(situation.removals) < step and self._packed(situation):
                situation = self._take_next(1, situation)[0]
        except NobodyFreeError as error:
            self.events.message.emit(str(error))
        if situation.removals != self._situation.removals:
            self._do("scrub", situation, merge=True)
        return self.step
