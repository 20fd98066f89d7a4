"""A box with a number that is written alike in every country."""

from __future__ import annotations

import re

from qtpy.QtCore import QLocale
from qtpy.QtGui import QValidator
from qtpy.QtWidgets import QDoubleSpinBox

# A decimal comma, and that of Arabic digits.
COMMAS = re.compile("[,\u066b]")


class NumberBox(QDoubleSpinBox):
    """Shows a decimal point whatever the system's numbers are, and takes a comma for it too."""

    def __init__(self) -> None:
        super().__init__()
        # As all other numbers of the panel are written.
        self.setLocale(QLocale.c())

    def validate(self, text: str, place: int) -> tuple[QValidator.State, str, int]:
        """Return whether a text may stand, the text as it is to stand, and where the cursor is.

        Parameters
        ----------
        text : str
        place : int
            Of the cursor.
        """
        # Letter for letter, so that the cursor stays where it is.
        digits = re.sub(r"\d", lambda found: str(int(found[0])), COMMAS.sub(".", text))
        state, text, place = super().validate(digits, place)
        return state, text, place
