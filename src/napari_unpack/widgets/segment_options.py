"""What a person may tell the segmentation; most never need to."""

from __future__ import annotations

from typing import Any

from qtpy.QtWidgets import QCheckBox, QDoubleSpinBox, QLineEdit

from napari_unpack.widgets.section import Disclosure, form

SMALLEST = 0.5
"""Default size below which nothing is an object, cm³."""


class SegmentOptions(Disclosure):
    """The threshold of matter, the smallest object, and what is left out."""

    def __init__(self) -> None:
        super().__init__("Details", "How objects are found; the defaults suit CT of bags.")
        self.threshold = QLineEdit()
        self.threshold.setPlaceholderText("automatic")
        self.threshold.setToolTip(
            "Density above which there is matter, in the volume's own values; "
            "found from the histogram where this is empty."
        )
        self.smallest = QDoubleSpinBox()
        self.smallest.setDecimals(3)
        self.smallest.setRange(0.001, 1000.0)
        self.smallest.setStepType(QDoubleSpinBox.StepType.AdaptiveDecimalStepType)
        self.smallest.setSuffix(" cm³")
        self.smallest.setValue(SMALLEST)
        self.smallest.setToolTip(
            "Smaller things are joined to a neighbour, or left out if they have none."
        )
        self.supports = QCheckBox("Leave out the scanner's table")
        self.supports.setToolTip("Flat matter that lies under everything else is no object.")
        self.shell = QCheckBox("Leave out the bag itself")
        self.shell.setToolTip("The thin wall around everything else is no object.")
        for box in (self.supports, self.shell):
            box.setChecked(True)
        self.contents.addLayout(form(Threshold=self.threshold, Smallest=self.smallest))
        self.contents.addWidget(self.supports)
        self.contents.addWidget(self.shell)

    def settings(self) -> dict[str, Any]:
        """Return keyword arguments of `napari_unpack.segment`.

        Raises
        ------
        ValueError
            If the threshold is no number.
        """
        text = self.threshold.text().strip().replace(",", ".")
        try:
            threshold = float(text) if text else None
        except ValueError as error:
            raise ValueError(
                f"the density from which there is matter must be a number, got {text!r}; "
                "leave it empty for automatic"
            ) from error
        return {
            "threshold": threshold,
            "smallest": 1000.0 * self.smallest.value(),
            "supports": self.supports.isChecked(),
            "shell": self.shell.isChecked(),
        }
