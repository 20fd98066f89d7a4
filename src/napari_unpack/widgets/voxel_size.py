"""How large a voxel is, and the unit in which lengths and volumes are told."""

from __future__ import annotations

import math
import re
from contextlib import suppress
from typing import TYPE_CHECKING

from qtpy.QtCore import Signal
from qtpy.QtWidgets import QGridLayout, QLineEdit, QSizePolicy, QWidget

from napari_unpack.geometry.length_unit import MM, UNITS, LengthUnit
from napari_unpack.layers.placement import assumed_of, spacing_of, unit_of
from napari_unpack.widgets.narrow import SIZED, Choice
from napari_unpack.widgets.notifications import errors_shown
from napari_unpack.widgets.number_box import THOUSANDS
from napari_unpack.widgets.section import label
from napari_unpack.widgets.theme import GAP

if TYPE_CHECKING:
    from napari.layers import Layer
    from qtpy.QtGui import QResizeEvent


TYPED = "Type others, such as 3 0.5 0.5, and press Enter."


class VoxelSize(QWidget):
    """The voxel size of a layer, to be typed, with a choice of its unit.

    `chosen` is emitted with a `LengthUnit` when a person chooses one, `shown` with every one that
    is shown, `typed` with the mm z y x of another size. The unit leaves the numbers of the layer
    as they are: a file may say mm and mean µm.
    """

    chosen = Signal(object)
    shown = Signal(object)
    typed = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self._spacing = (1.0, 1.0, 1.0)
        self._own = self.unit = MM
        self._layer: Layer | None = None
        self._chosen: str | None = None
        self._text = ""
        self.size = QLineEdit()
        self.size.setAccessibleName("Edges of a voxel along z, y and x")
        self.size.setToolTip(f"Edges of a voxel along z, y and x. {TYPED}")
        # Numbers of many digits must not widen the panel.
        self.size.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self.names = Choice(*UNITS)
        # The numbers want the room.
        self.names.setMinimumContentsLength(3)
        self.names.setAccessibleName("Unit of lengths")
        self.names.setToolTip(
            "What the numbers of the file are: mm, µm, or nothing known, which is counted in "
            "voxels. Table, facts, measurements, scale bar and exports follow."
        )
        self.assumed = label("", "hint", wrap=True)
        self.assumed.setAccessibleName("What had to be assumed of the file")
        self.assumed.setToolTip("The file does not say it: measurements are right if this is so.")
        self.assumed.hide()
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setSpacing(GAP)
        grid.addWidget(self.size, 0, 0)
        grid.addWidget(self.names, 0, 1)
        grid.addWidget(self.assumed, 1, 0, 1, 2)
        grid.setColumnStretch(0, 1)
        self.names.activated.connect(lambda _: self._choose())
        self.size.editingFinished.connect(self._read)

    def show_layer(self, layer: Layer, unit: LengthUnit | None = None) -> None:
        """Show the voxel size of a layer.

        Parameters
        ----------
        layer : napari layer
        unit : LengthUnit, optional
            By default the layer's own, where napari knows it.
        """
        if layer is not self._layer:
            # What is half typed is of the layer before.
            self.size.setModified(False)
        told = assumed_of(layer)
        self.assumed.setText("Of the file: " + "; ".join(told) + ".")
        self.assumed.setVisible(bool(told))
        own = unit_of(layer)
        # The same layer anew, after a change of its scale or name: a choice by hand holds.
        kept = self._chosen if layer is self._layer and own.per_mm == self._own.per_mm else None
        self._layer, self._spacing, self._own, self._chosen = layer, spacing_of(layer), own, kept
        self._show(unit or (own if kept is None else self._named(kept)))

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Write the numbers as wide as there is room."""
        super().resizeEvent(event)
        if self._layer is not None:
            self._show(self.unit)

    def _show(self, unit: LengthUnit) -> None:
        self.unit = unit
        self.names.setCurrentText(unit.name)
        edges = [edge * unit.per_mm for edge in self._spacing]
        # Three digits of each; less where that finds no room beside the choice.
        forms = (("\u2009×\u2009", 3), ("×", 3), (" ", 3), (" ", 2))
        texts = [times.join(f"{edge:.{digits}g}" for edge in edges) for times, digits in forms]
        width, room = self.size.fontMetrics().horizontalAdvance, self._room()
        # Unless somebody types.
        if not self.size.isModified() or not self.size.hasFocus():
            self._text = next((text for text in texts if width(text) <= room), texts[-1])
            self.size.setText(self._text)
            # Of too many digits, the first are seen.
            self.size.setCursorPosition(0)
        whole = " × ".join(f"{edge:.6g}" for edge in edges)
        self.size.setToolTip(f"Edges of a voxel along z, y and x: {whole} {unit.name}. {TYPED}")
        self.shown.emit(unit)

    def _room(self) -> int:
        """Return the width that numbers may have, pixels."""
        letters = SIZED * self.size.fontMetrics().horizontalAdvance("x")
        frame = self.size.sizeHint().width() - letters
        return int(self.size.width() - frame)

    def _read(self) -> None:
        if not self.size.isModified():
            return
        typed = self.size.text()
        self.size.setModified(False)
        with errors_shown():
            edges, before = edges_of(typed), edges_of(self._text)
            if self.unit.name == "voxels":
                # What is typed is a length, and voxels are none.
                self.names.setCurrentText(MM.name)
                self._choose()
                before = (math.nan,) * 3
            # What was left as it stood was rounded to be shown.
            self.typed.emit(
                tuple(
                    mm if edge == shown else edge / self.unit.per_mm
                    for mm, edge, shown in zip(self._spacing, edges, before, strict=True)
                )
            )
        # Where it cannot be read that is told, and the size stays.
        self._show(self.unit)

    def _choose(self) -> None:
        self._chosen = self.names.currentText()
        self._show(self._named(self._chosen))
        self.chosen.emit(self.unit)

    def _named(self, name: str) -> LengthUnit:
        if name == "voxels":
            return LengthUnit.voxels(self._spacing)
        # The layer's own numbers: its mm, or its µm where it has those.
        return LengthUnit(name, 1.0 if self._own.name == "voxels" else self._own.per_mm)


# Between numbers; a comma among digits may be within one.
BETWEEN = re.compile(r"(?:[\s×x;]|,(?!\d)|(?<!\d),)+")


def edges_of(text: str) -> tuple[float, float, float]:
    """Read the edges of a voxel, z y x; a comma may stand between them, or for a decimal point.

    Raises
    ------
    ValueError
        If they are not three positive numbers, or may be others.
    """
    parts = BETWEEN.split(text.strip().lower())
    if len(parts) == 1:
        parts = parts[0].split(",")
    with_comma = [part for part in parts if "," in part]
    told = not with_comma or not all(map(THOUSANDS.fullmatch, with_comma))
    with suppress(ValueError):
        z, y, x = (float(part.replace(",", ".")) for part in parts)
        if told and all(0 < edge < math.inf for edge in (z, y, x)):
            return z, y, x
    raise ValueError(
        "a voxel size must be three positive numbers, of z, y and x, as in 3 0.5 0.5, without "
        f"commas that may mean thousands; got {text!r}"
    )
