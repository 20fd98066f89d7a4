"""Which time point, channel or colour of a volume with more axes is unpacked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from qtpy.QtWidgets import QComboBox, QFormLayout, QSpinBox, QWidget

from napari_unpack.widgets.layer_inputs import ExtraAxis, extra_axes
from napari_unpack.widgets.narrow import Choice
from napari_unpack.widgets.section import form, label
from napari_unpack.widgets.theme import LABELS

if TYPE_CHECKING:
    import napari
    from napari.layers import Layer


class IndexChooser(QWidget):
    """One field for each axis beside z, y and x; hidden where there is none."""

    def __init__(self) -> None:
        super().__init__()
        self._axes: tuple[ExtraAxis, ...] = ()
        self._fields: list[QSpinBox | QComboBox] = []
        self._layout: QFormLayout = form()
        self.setLayout(self._layout)
        self.hide()

    def show_axes(self, layer: Layer | None, viewer: napari.Viewer) -> None:
        """Offer the axes of a layer, at first the indices that the viewer shows.

        Parameters
        ----------
        layer : napari layer, optional
        viewer : napari.Viewer
        """
        axes = () if layer is None else extra_axes(layer)
        if axes != self._axes:
            while self._layout.rowCount():
                self._layout.removeRow(0)
            self._axes, self._fields = axes, []
            for axis in axes:
                self._add(axis, viewer.dims.current_step)
        self.setVisible(bool(axes))

    def _add(self, axis: ExtraAxis, steps: Sequence[int]) -> None:
        field: QSpinBox | QComboBox
        if axis.choices:
            field = Choice(*axis.choices)
        else:
            field = QSpinBox()
            field.setRange(0, axis.size - 1)
            # As beside napari's sliders, which count from 0.
            field.setSuffix(f" / {axis.size - 1}")
            if axis.step is not None and len(steps) >= -axis.step:
                field.setValue(steps[axis.step])
        field.setToolTip(f"{axis.title} to unpack: one of {axis.size}, counted from 0.")
        field.setAccessibleName(axis.title)
        title = label(axis.title, "field")
        title.setFixedWidth(LABELS)
        self._layout.addRow(title, field)
        self._fields.append(field)

    @property
    def index(self) -> tuple[int, ...]:
        """The chosen index of each axis."""
        return tuple(
            field.currentIndex() if isinstance(field, QComboBox) else field.value()
            for field in self._fields
        )

    def choose(self, *index: int) -> None:
        """Choose an index of each axis."""
        for field, i in zip(self._fields, index, strict=True):
            if isinstance(field, QComboBox):
                field.setCurrentIndex(i)
            else:
                field.setValue(i)
