"""A box with a number that is written alike in every country."""

from __future__ import annotations

import re

from qtpy.QtCore import QLocale
from qtpy.QtGui import QValidator
from qtpy.QtWidgets import QDoubleSpinBox

from napari_unpack.widgets import notifications

# A decimal comma, and that of Arabic digits.
COMMAS = re.compile("[,\u066b]")
# A comma here may as well stand for thousands.
THOUSANDS = re.compile(r"[1-9]\d{0,2},\d{3}")
# The same in a box, which may have a sign and a unit.
DOUBTFUL = re.compile(rf"\s*[-+]?({THOUSANDS.pattern})(?!\d)")


class NumberBox(QDoubleSpinBox):
    """Shows a decimal point whatever the system's numbers are, and takes a comma for it too.

    A comma that is typed becomes a point at once. One that comes with its number, as by a paste,
    and may stand for thousands is refused in a sentence: the number before stays.
    """

    def __init__(self) -> None:
        super().__init__()
        # As all other numbers of the panel are written.
        self.setLocale(QLocale.c())
        # Of the text that was looked at last.
        self._doubt = ""
        self.lineEdit().inputRejected.connect(self._tell)

    def validate(self, text: str, place: int) -> tuple[QValidator.State, str, int]:
        """Return whether a text may stand, the text as it is to stand, and where the cursor is.

        Parameters
        ----------
        text : str
        place : int
            Of the cursor.
        """
        doubtful = DOUBTFUL.match(text)
        self._doubt = doubtful[1] if doubtful else ""
        if doubtful:
            return QValidator.State.Invalid, text, place
        # Letter for letter, so that the cursor stays where it is.
        digits = re.sub(r"\d", lambda found: str(int(found[0])), COMMAS.sub(".", text))
        state, text, place = super().validate(digits, place)
        return state, text, place

    def _tell(self) -> None:
        if self._doubt:
            point, plain = self._doubt.replace(",", "."), self._doubt.replace(",", "")
            notifications.warn(f"{self._doubt} may be {point} or {plain}: write one of these.")
