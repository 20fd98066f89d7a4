"""Where one looks from: Fit, the six sides of the bag, and the direction of unpacking."""

from __future__ import annotations

from functools import partial

from qtpy.QtWidgets import QMenu, QWidget

from napari_unpack.geometry.standard_views import Side
from napari_unpack.widgets.commands import Commands
from napari_unpack.widgets.section import button, column, row

VIEWS: dict[str, tuple[str, Side | None]] = {
    "1": ("Front", Side.FRONT),
    "2": ("Back", Side.BACK),
    "3": ("Left", Side.LEFT),
    "4": ("Right", Side.RIGHT),
    "5": ("Top", Side.TOP),
    "6": ("Bottom", Side.BOTTOM),
    "7": ("Direction of unpacking", None),
}
"""What each key looks from; None is where objects leave to."""

FIT_KEY = "F"


class ViewBox(QWidget):
    """A menu of views and the Fit button.

    Parameters
    ----------
    commands : Commands

    Attributes
    ----------
    line : Row
        Both, and room for what else opens a view.
    """

    def __init__(self, commands: Commands) -> None:
        super().__init__()
        self.view = button("View from", "Look at the bag from one of its sides (1 to 7).")
        self.menu = QMenu(self.view)
        for key, (name, side) in VIEWS.items():
            # The key is the viewer's: an action with a shortcut would take it from napari's boxes.
            chosen = self.menu.addAction(f"{name}\t{key}")
            chosen.triggered.connect(partial(self._look, commands, side))
        self.view.setMenu(self.menu)
        self.fit = button(
            "Fit", f"Bring the bag and all unpacked objects into the window ({FIT_KEY})."
        )
        self.fit.clicked.connect(commands.fit)
        self.line = row(self.view, self.fit)
        column(self).addWidget(self.line)

    @staticmethod
    def _look(commands: Commands, side: Side | None, _checked: bool = False) -> None:
        commands.look_from(side)
