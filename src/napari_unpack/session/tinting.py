"""The tints of a session: tables by ID of what is packed, and of one object alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from napari_unpack.appearance import tints_of
from napari_unpack.appearance.tints import MODES, Mode
from napari_unpack.session.core import SessionCore

VEIL = (0.8, 0.8, 0.8, 0.3)
"""Straight RGBA of matter without a label: grey, and so thin that objects are seen through it."""

LEGIBLE = 0.2
"""Opacity per voxel that an object alone has at its mean density at least."""

MOST_GAIN = 8.0


class SessionTints(SessionCore):
    """How hues become the tints that pictures are multiplied with."""

    @property
    def tint_mode(self) -> Mode:
        """How hues become tints; setting it is told as a change of hues, and is not undoable."""
        return self._tint_mode

    @tint_mode.setter
    def tint_mode(self, mode: Mode) -> None:
        if mode not in MODES:
            raise ValueError(f"tint_mode must be one of {', '.join(MODES)}, got {mode!r}")
        if mode != self._tint_mode:
            self._tint_mode = mode
            self._changes += 1
            self.events.hues.emit(self.hues)

    @property
    def show_unlabelled(self) -> bool:
        """Whether matter that belongs to no object shows, as a veil; not undoable.

        Setting it is told as a change of the transfer function: all must be cast anew.
        """
        return self._show_unlabelled

    @show_unlabelled.setter
    def show_unlabelled(self, shown: bool) -> None:
        if bool(shown) != self._show_unlabelled:
            self._show_unlabelled = bool(shown)
            self._changes += 1
            self.events.transfer_function.emit(self._situation.transfer_function)

    def packed_tints(self) -> NDArray[np.float32]:
        """Return the (M, 4) float32 tints of what is packed; zero for all else. Read-only.

        Row 0, matter without a label, is zero unless `show_unlabelled`.
        """
        now, kept = self._changes, self._tints
        if kept[0] != now:
            hues = self._situation.hues
            shown = {i: hues[i] for i, state in self.states.items() if state.value == "packed"}
            table = tints_of(shown, self._top, mode=self.tint_mode)
            if self._show_unlabelled:
                table[0] = VEIL
            table.flags.writeable = False
            kept = self._tints = now, table
        return kept[1]

    def solo_tints(self, object_id: int) -> NDArray[np.float32]:
        """Return the (M, 4) float32 tints that show one object alone.

        Its alpha is above 1 where the object's typical density is so faint under the master
        transfer function that it could not be made out on its own.
        """
        table = np.zeros((self._top + 1, 4), np.float32)
        table[object_id] = self.tint_alone(object_id)
        return table

    def tint_alone(self, object_id: int) -> NDArray[np.float32]:
        """Return the (4,) float32 row of an object in its `solo_tints`; kept until a change."""
        if self._tints_alone[0] != self._changes:
            self._tints_alone = self._changes, {}
        known = self._tints_alone[1]
        if object_id not in known:
            known[object_id] = self._tint_alone(object_id)
        return known[object_id]

    def _tint_alone(self, object_id: int) -> NDArray[np.float32]:
        situation = self._situation
        tint = tints_of({1: situation.hues[object_id]}, 1, mode=self.tint_mode)[1]
        study = situation.studies.get(object_id)
        own = None if study is None else study.transfer_function
        if own is None:
            density = float(self._facts.at[object_id, "mean_density"])
            opacity = float(situation.transfer_function.opacity_at(density))
            tint[3] = np.clip(LEGIBLE / max(opacity, 1e-6), 1.0, MOST_GAIN)
        return tint
