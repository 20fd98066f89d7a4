"""What must leave for a buried object: a sentence and two buttons."""

from __future__ import annotations

from typing import Any

from qtpy.QtWidgets import QWidget

from napari_unpack.widgets.directions import words_of
from napari_unpack.widgets.section import button, column, label, row
from napari_unpack.widgets.ways import Ways


class RevealBox(QWidget):
    """Shown while it is known what frees a buried object.

    Parameters
    ----------
    ways : Ways
    """

    def __init__(self, ways: Ways) -> None:
        super().__init__()
        self._ways = ways
        self._found: Any = None
        self.news = label("", "hint", wrap=True)
        self.take = button("Unpack just those", "Fly them out, the buried one last.", True)
        self.cancel = button("Not now", "Show this no more (Escape).")
        contents = column(self)
        contents.addWidget(self.news)
        contents.addLayout(row(self.take, self.cancel))
        self.take.clicked.connect(ways.unpack_found)
        self.cancel.clicked.connect(ways.forget)
        self.hide()

    def show_found(self, one: Any, session: Any) -> None:
        """Say what must leave; None hides the box."""
        self._found = one
        self.setVisible(one is not None)
        self.look(session)

    def look(self, session: Any) -> None:
        """Say which way it is in the picture of now."""
        one = self._found
        if one is not None and session is not None:
            name = str(session.objects["name"][one.target])
            words = words_of(one.direction, session.camera)
            self.news.setText(sentence(name, len(one.first), words))


def sentence(name: str, first: int, way: str) -> str:
    """Return what must happen before an object is free."""
    if not first:
        return f"{name} can leave now, {way}."
    count = "1 object" if first == 1 else f"{first} objects"
    return f"{name}: {count} must leave first, {way}."
