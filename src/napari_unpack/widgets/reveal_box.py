"""What must leave for a buried object: a sentence and two buttons."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from qtpy.QtWidgets import QWidget

from napari_unpack.session.errors import listed
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
            names = session.objects["name"]
            first = [str(names[i]) for i in sorted(one.first)]
            words = words_of(one.direction, session.camera)
            self.news.setText(sentence(str(names[one.target]), first, words))


def sentence(name: str, first: Sequence[str], way: str) -> str:
    """Return what must happen before an object is free, naming who must leave if they are few."""
    if not first:
        return f"{name} can leave now, {way}."
    return f"{name}: {listed(first)} must leave first or with it, {way}."
