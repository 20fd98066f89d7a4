"""Settings of the segmentation; the defaults serve most scans."""

from __future__ import annotations

from typing import Any

from qtpy.QtCore import QSignalBlocker, Qt

from napari_unpack.geometry.length_unit import MM, LengthUnit
from napari_unpack.widgets.narrow import Check, Choice, Field
from napari_unpack.widgets.number_box import NumberBox
from napari_unpack.widgets.section import Collapsible, form

# Of `napari_unpack.segment`: mm³, or voxels.
AUTOMATIC = 500
# Nothing in a bag is larger than a litre and to be left out.
LARGEST_MM3 = 1e6

FIXED = "Fixed density"
# How matter is told from air: `foreground` of `napari_unpack.segment`, and when to choose it.
FOREGROUND_METHODS = {
    "Two levels, connected": (
        "hysteresis",
        "Light matter counts where it is connected to denser matter; suits most scans.",
    ),
    "Smooth regions": (
        "mumford-shah",
        "For scans in which air or matter grow lighter from one side to the other; slower.",
    ),
    "One level": ("otsu", "Everything above the level between air and matter."),
    FIXED: (None, "Everything above the density given below."),
}

# What is done about noise: `grainy` of `napari_unpack.segment`, and when to choose it.
NOISE = {
    "Automatic": (None, "Noise is removed where the volume is mostly noise, as most CT is not."),
    "Remove": (
        True,
        "For nuclei and cells under a microscope: noise and haze are removed before the "
        "segmentation, and there is no table and no bag.",
    ),
    "Keep": (False, "For CT scans: the volume is segmented as it is."),
}


class SegmentOptions(Collapsible):
    """Foreground, noise, the smallest object, and what is left out."""

    def __init__(self) -> None:
        super().__init__(
            "Details",
            "How objects are found; the defaults suit CT of bags, and nuclei under a microscope.",
        )
        self.supports = Check("Leave out the scanner's table")
        self.supports.setToolTip("The flat support under everything else is no object.")
        self.shell = Check("Leave out the bag itself")
        self.shell.setToolTip("The thin wall around everything else is no object.")
        for box in (self.supports, self.shell):
            box.setChecked(True)
        self.foreground = Choice(*FOREGROUND_METHODS)
        for place, (_, help_text) in enumerate(FOREGROUND_METHODS.values()):
            self.foreground.setItemData(place, help_text, Qt.ItemDataRole.ToolTipRole)
        self.foreground.currentTextChanged.connect(self._explain)
        self.threshold = Field()
        self.threshold.setPlaceholderText("automatic")
        self.threshold.setToolTip(
            "Density above which there is matter, in the volume's own values; "
            "typing one here chooses 'Fixed density'."
        )
        self.threshold.textEdited.connect(self._fix)
        self.noise = Choice(*NOISE)
        for place, (_, help_text) in enumerate(NOISE.values()):
            self.noise.setItemData(place, help_text, Qt.ItemDataRole.ToolTipRole)
        self.noise.currentTextChanged.connect(self._explain)
        self._explain()
        self.smallest = NumberBox()
        self.smallest.setStepType(NumberBox.StepType.AdaptiveDecimalStepType)
        self.smallest.setSpecialValueText("automatic")
        self._smallest_mm3 = 0.0
        self._volumes = MM.volume_unit(0.0)
        self.show_unit(MM)
        self.smallest.valueChanged.connect(self._keep_smallest)
        self.contents.addLayout(
            form(
                Matter=self.foreground,
                Density=self.threshold,
                Noise=self.noise,
                Smallest=self.smallest,
            )
        )
        self.contents.addWidget(self.supports)
        self.contents.addWidget(self.shell)

    def show_unit(self, unit: LengthUnit) -> None:
        """Tell the smallest volume in a unit of lengths; it stays as large as it was."""
        self._volumes = volumes = unit.volume_unit(0.0)
        # What this unit has no digits for is not forgotten.
        with QSignalBlocker(self.smallest):
            self.smallest.setDecimals(0 if volumes.name == "voxels" else 2)
            self.smallest.setRange(0.0, LARGEST_MM3 * volumes.per_mm3)
            self.smallest.setSuffix(f" {volumes.name}")
            self.smallest.setValue(self._smallest_mm3 * volumes.per_mm3)
        automatic = f"{AUTOMATIC * volumes.per_mm3:.6g} {volumes.name}"
        self.smallest.setToolTip(
            "Smaller objects are joined to a neighbour, or left out if they have none. "
            f"Automatic: {automatic}, or {AUTOMATIC} voxels in a small volume, and less where most "
            "things are smaller; 0 brings it back."
        )

    def _keep_smallest(self, shown: float) -> None:
        # The largest in whole voxels may be rounded up.
        self._smallest_mm3 = min(shown / self._volumes.per_mm3, LARGEST_MM3)

    def _explain(self, _text: str = "") -> None:
        method, help_text = FOREGROUND_METHODS[self.foreground.currentText()]
        self.foreground.setToolTip(f"How matter is told from air. {help_text}")
        # A number left there would look as if it counted.
        if method is not None:
            self.threshold.clear()
        grainy, help_text = NOISE[self.noise.currentText()]
        self.noise.setToolTip(f"What is done about noise and haze. {help_text}")
        for box in (self.supports, self.shell):
            # Nuclei lie on no table.
            box.setEnabled(grainy is not True)

    def _fix(self, text: str) -> None:
        if text.strip():
            self.foreground.setCurrentText(FIXED)

    def settings(self) -> dict[str, Any]:
        """Return keyword arguments of `napari_unpack.segment`.

        Raises
        ------
        ValueError
            If the fixed density is no number.
        """
        method, _ = FOREGROUND_METHODS[self.foreground.currentText()]
        return {
            "foreground": self._density() if method is None else method,
            "grainy": NOISE[self.noise.currentText()][0],
            # 0 is shown as "automatic".
            "smallest": self._smallest_mm3 if self.smallest.value() else None,
            "supports": self.supports.isChecked(),
            "shell": self.shell.isChecked(),
        }

    def _density(self) -> float:
        # Many people type a decimal comma.
        text = self.threshold.text().strip().replace(",", ".")
        try:
            return float(text)
        except ValueError as error:
            raise ValueError(
                f"the density above which there is matter must be a number, got {text!r}; "
                "or let it be found: choose another method than the fixed density"
            ) from error
