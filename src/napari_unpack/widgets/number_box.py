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

SEVERAL = "A number has one point or comma, before its decimals, as in 1234.5."


class NumberBox(QDoubleSpinBox):
    """Shows a decimal point whatever the system's numbers are, and takes a comma for it too.

    A comma that is typed becomes a point at once. One that comes with its number, as by a paste,
    and may stand for thousands is refused in a sentence: the number before stays. So is a second
    comma or point.
    """

    def __init__(self) -> None:
        super().__init__()
        # As all other numbers of the panel are written.
        self.setLocale(QLocale.c())
        # What is wrong with the text that was looked at last.
        self._fault = ""
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
        self._fault = doubt_of(doubtful[1]) if doubtful else ""
        if doubtful:
            return QValidator.State.Invalid, text, place
        # Letter for letter, so that the cursor stays where it is.
        digits = re.sub(r"\d", lambda found: str(int(found[0])), COMMAS.sub(".", text))
        if digits.count(".") > 1:
            self._fault = SEVERAL
        state, text, place = super().validate(digits, place)
        return state, text, place

    def _tell(self) -> None:
        if self._fault:
            notifications.warn(self._fault)


def doubt_of(number: str) -> str:
    """Return what to ask of a number whose comma may stand for thousands."""
    point, plain = number.replace(",", "."), number.replace(",", "")
    return f"{number} may be {point} or {plain}: write one of these."
