"""How large a voxel is, and the unit in which lengths and volumes are told."""

from __future__ import annotations

from typing import TYPE_CHECKING

from qtpy.QtCore import Signal
from qtpy.QtWidgets import QGridLayout, QSizePolicy, QWidget

from napari_unpack.geometry.length_unit import MM, UNITS, LengthUnit
from napari_unpack.layers.placement import assumed_of, spacing_of, unit_of
from napari_unpack.widgets.narrow import Choice
from napari_unpack.widgets.section import label
from napari_unpack.widgets.theme import GAP

if TYPE_CHECKING:
    from napari.layers import Layer
    from qtpy.QtGui import QResizeEvent


class VoxelSize(QWidget):
    """The voxel size of a layer, with a choice of its unit.

    `chosen` is emitted with a `LengthUnit` when a person chooses one, `shown` with every one that
    is shown. The numbers stay those of the layer: a file may say mm and mean µm.
    """

    chosen = Signal(object)
    shown = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self._spacing = (1.0, 1.0, 1.0)
        self._own = self.unit = MM
        self._layer: Layer | None = None
        self._chosen: str | None = None
        self.size = label("", "status")
        # Numbers of many digits must not widen the panel.
        self.size.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self.names = Choice(*UNITS)
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

    def show_layer(self, layer: Layer, unit: LengthUnit | None = None) -> None:
        """Show the voxel size of a layer.

        Parameters
        ----------
        layer : napari layer
        unit : LengthUnit, optional
            By default the layer's own, where napari knows it.
        """
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
        # Three digits of each with thin spaces; less where that finds no room beside the choice.
        forms = (("\u2009×\u2009", 3), ("×", 3), ("×", 2))
        texts = [times.join(f"{edge:.{digits}g}" for edge in edges) for times, digits in forms]
        width = self.size.fontMetrics().horizontalAdvance
        fits = (text for text in texts if width(text) <= self.size.width())
        self.size.setText(next(fits, texts[-1]))
        whole = " × ".join(f"{edge:.6g}" for edge in edges)
        self.size.setToolTip(f"Edges of a voxel along z, y and x: {whole} {unit.name}.")
        self.shown.emit(unit)

    def _choose(self) -> None:
        self._chosen = self.names.currentText()
        self._show(self._named(self._chosen))
        self.chosen.emit(self.unit)

    def _named(self, name: str) -> LengthUnit:
        if name == "voxels":
            return LengthUnit.voxels(self._spacing)
        # The layer's own numbers: its mm, or its µm where it has those.
        return LengthUnit(name, 1.0 if self._own.name == "voxels" else self._own.per_mm)
