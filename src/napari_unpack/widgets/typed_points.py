"""The points of an opacity curve as a line of numbers, to be read and typed."""

from __future__ import annotations

import re
from collections.abc import Iterable
from itertools import pairwise

from qtpy.QtCore import Signal
from qtpy.QtWidgets import QLineEdit

from napari_unpack.widgets.notifications import errors_shown
from napari_unpack.widgets.opacity_editor import Point

# Between pairs; a comma among digits may be within a number.
BETWEEN = re.compile(r";|,(?!\d)|(?<!\d),")


class TypedPoints(QLineEdit):
    """Density and opacity of each point.

    `edited` carries what was typed, once Enter is pressed or the keyboard is elsewhere.
    """

    edited = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self._points: list[Point] = []
        self._written: dict[Point, Point] = {}
        self.setAccessibleName("Points of the opacity curve")
        self.setToolTip(
            "Density and opacity of each point, as in 0 0, 500 0.2, 4000 0.6; press Enter. "
            "Decimal commas are read too."
        )
        self.editingFinished.connect(self._read)

    def show_points(self, points: Iterable[Point]) -> None:
        """Show a curve, unless somebody types."""
        self._points = list(points)
        if not self.isModified() or not self.hasFocus():
            self._write()

    def _write(self) -> None:
        text = points_text(self._points)
        self._written = dict(zip(_numbers(text), self._points, strict=True))
        self.setText(text)
        # Of more than there is room for, the first are seen.
        self.setCursorPosition(0)

    def _read(self) -> None:
        if not self.isModified():
            return
        typed = self.text()
        self.setModified(False)
        with errors_shown():
            # What was left as it stood was rounded to be shown.
            self.edited.emit([self._written.get(point, point) for point in points_of(typed)])
            return
        # What cannot be read is told, and the curve stays as it is.
        self._write()


def points_text(points: Iterable[Point]) -> str:
    """Write points as a line of numbers."""
    points = list(points)
    # Two densities that look alike get more digits: they would ascend no longer.
    rounded = ([_rounded(density, digits) for density, _ in points] for digits in range(3, 18))
    densities = next(texts for texts in rounded if len(set(texts)) == len(points))
    return ", ".join(
        f"{d} {opacity:.3g}" for d, (_, opacity) in zip(densities, points, strict=True)
    )


def points_of(text: str) -> list[Point]:
    """Read points from a line of numbers.

    Raises
    ------
    ValueError
        If it is not two ascending points at least, with opacities from 0 to 1.
    """
    wanted = (
        "points must be pairs of density and opacity with commas between them, densities "
        "ascending and opacities from 0 to 1, as in 0 0, 500 0.2"
    )
    try:
        points = _numbers(text)
    except ValueError as error:
        raise ValueError(f"{wanted}; got {text!r}") from error
    ascending = all(a[0] < b[0] for a, b in pairwise(points))
    if len(points) < 2 or not ascending or not all(0.0 <= a <= 1.0 for _, a in points):
        raise ValueError(f"{wanted}; got {text!r}")
    return points


def _rounded(density: float, digits: int) -> str:
    """Write a density with so many digits, more where it is whole anyway."""
    whole = f"{density:.0f}"
    return whole if len(whole.lstrip("-")) >= digits else f"{density:.{digits}g}"


def _numbers(text: str) -> list[Point]:
    pairs = [part.split() for part in re.split("[,;]", text) if part.strip()]
    if any(len(pair) != 2 for pair in pairs):
        # Commas among digits are within numbers then: read as above, no comma within one leaves
        # pairs.
        pairs = [part.replace(",", ".").split() for part in BETWEEN.split(text) if part.strip()]
    return [(float(density), float(opacity)) for density, opacity in pairs]
