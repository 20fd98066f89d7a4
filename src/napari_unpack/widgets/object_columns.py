"""The columns of the table of objects: their titles, and what a row says in each."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass, fields, replace
from enum import IntEnum
from functools import cached_property
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from napari_unpack.geometry.length_unit import LengthUnit, VolumeUnit, density_text
from napari_unpack.session.errors import percent
from napari_unpack.session.object_state import ObjectState

if TYPE_CHECKING:
    from napari_unpack.session.state import Flag

Rgb = tuple[float, float, float]
NO_HUE: Rgb = (0.5, 0.5, 0.5)

STATE_WORDS = {
    ObjectState.PACKED: "in the bag",
    ObjectState.FLYING_OUT: "flying",
    ObjectState.UNPACKED: "unpacked",
    ObjectState.FLYING_BACK: "flying",
    ObjectState.INSPECTED: "inspected",
    ObjectState.HIDDEN: "hidden",
}

# What the state column says of some packed objects, and what it means.
UNPACKABLE, TOGETHER, FIRST = "unpackable", "as a group", "take out first"
MARKS = {
    UNPACKABLE: "Unpackable: nothing blocks this object.",
    TOGETHER: "Unpackable as a group: these objects hold each other and leave together.",
    FIRST: "Take this object out first: it blocks the one to be revealed.",
}

FLAG_WORDS: dict[Flag | None, str] = {
    None: "not flagged",
    "suspicious": "suspicious",
    "cleared": "cleared",
}
# The order in which clicks go round, and rows sort: what needs a look comes first.
FLAG_ROUND: tuple[Flag | None, ...] = (None, "suspicious", "cleared")
FLAG_ORDER: tuple[Flag | None, ...] = ("suspicious", None, "cleared")

# Shown until a worker has measured it.
PENDING = "…"


class Column(IntEnum):
    """The columns; `ObjectTable` shows the flag beside the swatch."""

    EYE = 0
    SWATCH = 1
    NAME = 2
    STATE = 3
    VOLUME = 4
    SIZE = 5
    DENSITY = 6
    CONFIDENCE = 7
    FLAG = 8
    ORDER = 9
    BLOCKERS = 10
    NOTE = 11


TITLES = {
    Column.EYE: ("", "Shown or hidden: click an eye to change it."),
    Column.SWATCH: ("", "Colour and opacity in every view: click one to choose another."),
    Column.NAME: ("Name", "Double-click to rename."),
    Column.STATE: ("State", "Where the object is now."),
    Column.VOLUME: ("Volume", "Volume {volume}; step 1 has the choice of units."),
    Column.SIZE: ("Size", "Extents along the object's own axes, longest first, in {length}."),
    Column.DENSITY: ("Mean density", "Mean density in the volume's own values."),
    Column.CONFIDENCE: (
        "Confidence",
        "How sure the segmentation is that this is one whole object.",
    ),
    Column.FLAG: ("", "Your flag: click to flag an object as suspicious, then as cleared."),
    Column.ORDER: ("Order out", "In which step of the unpacking the object left."),
    Column.BLOCKERS: ("Blocked by", "Objects that stand directly in its way."),
    Column.NOTE: ("Note", "Your note: double-click to write one."),
}
# Of a narrow table, whose room is for names.
SHORT_TITLES = {Column.CONFIDENCE: "Conf."}
# What columns without a title are called where one chooses columns.
CHOICES = {Column.EYE: "Shown", Column.SWATCH: "Colour", Column.FLAG: "Flag"}


def choice_of(column: Column) -> str:
    """Return what a column is called where one chooses columns."""
    return CHOICES.get(column) or TITLES[column][0]


def sought(text: str) -> str:
    """Return a text as searches compare it: capitals are alike, and so are accents."""
    # An accent is one letter with its own, or a second one behind it, as macOS writes file names.
    return unicodedata.normalize("NFC", text.casefold())


@dataclass(frozen=True)
class Units:
    """In which lengths and volumes of a table are told.

    Parameters
    ----------
    length : LengthUnit
    volume : VolumeUnit
        One for all objects.
    """

    length: LengthUnit
    volume: VolumeUnit

    @classmethod
    def of(cls, length: LengthUnit, largest_mm3: float) -> Units:
        """Return the units of objects up to a largest.

        Parameters
        ----------
        length : LengthUnit
        largest_mm3 : float
        """
        return cls(length, length.volume_unit(largest_mm3))

    def title(self, column: Column) -> tuple[str, str]:
        """Return a column's title and its tooltip."""
        title, tip = TITLES[column]
        named = {Column.VOLUME: self.volume.name, Column.SIZE: f"{title}, {self.length.name}"}
        told = tip.format(volume=self.volume.words, length=self.length.name)
        return named.get(column, title), told


@dataclass(frozen=True)
class Row:
    """What is known of an object; the fields from `name` on may change at any moment.

    Parameters
    ----------
    id, label : int
        In the session, and in the user's own labels, which the session may have renumbered.
    volume : float
        mm³.
    density, confidence : float
        NaN where it is not known.
    name : str
    edges : tuple of float, optional
        Extents in mm, longest first; None until they are measured.
    state : ObjectState
    hue : float, optional
    color : (float, float, float)
        As it is drawn, sRGB.
    opacity : float
    own_color : bool
        Whether a person chose it.
    mark : str
        One of `MARKS`, or empty.
    is_example : bool
    note : str
    flag : str, optional
    order : int, optional
        Of the step that took it out.
    """

    id: int
    label: int
    volume: float
    density: float
    confidence: float
    name: str = ""
    edges: tuple[float, ...] | None = None
    state: ObjectState = ObjectState.HIDDEN
    hue: float | None = None
    color: Rgb = NO_HUE
    opacity: float = 1.0
    own_color: bool = False
    mark: str = ""
    is_example: bool = False
    note: str = ""
    flag: Flag | None = None
    order: int | None = None

    def changed(self, **now: Any) -> Row:
        """Return the row with some fields as they are now: itself where they are as they were."""
        return self if now.items() <= self.__dict__.items() else replace(self, **now)

    @property
    def state_words(self) -> str:
        """What the state column says."""
        packed = self.state is ObjectState.PACKED
        return self.mark if self.mark and packed else STATE_WORDS[self.state]

    @cached_property
    def searched(self) -> str:
        """What a search looks in: name, note and flag."""
        words = (self.name, self.note, FLAG_WORDS[self.flag] if self.flag else "")
        return sought("\n".join(words))

    @cached_property
    def _counted_name(self) -> str:
        # Digits are padded, so that object 2 comes before object 10.
        return re.sub(r"\d+", lambda found: found[0].zfill(12), self.name.casefold())

    def text(self, column: Column, units: Units) -> str:
        """Return what a cell shows.

        Parameters
        ----------
        column : Column
        units : Units
        """
        match column:
            case Column.NAME:
                return self.name
            case Column.STATE:
                return self.state_words
            case Column.VOLUME:
                return units.volume.text(self.volume)
            case Column.SIZE if self.edges is not None:
                return units.length.edges(self.edges)
            case Column.SIZE:
                return PENDING
            case Column.DENSITY:
                return density_text(self.density)
            case Column.CONFIDENCE:
                return "–" if np.isnan(self.confidence) else percent(self.confidence)
            case Column.ORDER:
                return "" if self.order is None else str(self.order)
            case Column.NOTE:
                return self.note
        return ""

    def sort_key(self, column: Column) -> Any:
        """Return what a column sorts this row by."""
        match column:
            case Column.EYE:
                return self.state is ObjectState.HIDDEN
            case Column.SWATCH:
                return -1.0 if self.hue is None else self.hue
            case Column.NAME:
                return self._counted_name
            case Column.STATE:
                return self.state_words
            case Column.VOLUME:
                return self.volume
            case Column.SIZE:
                return 0.0 if self.edges is None else self.edges[0]
            case Column.DENSITY:
                return -np.inf if np.isnan(self.density) else self.density
            case Column.FLAG:
                return FLAG_ORDER.index(self.flag)
            case Column.ORDER:
                # What is not out comes after what is.
                return np.inf if self.order is None else self.order
            case Column.NOTE:
                return (not self.note, self.note.casefold())
        return -1.0 if np.isnan(self.confidence) else self.confidence

    def tooltip(self, column: Column, units: Units) -> str:
        """Return what the mouse over a cell is told.

        Parameters
        ----------
        column : Column
        units : Units
        """
        match column:
            case Column.STATE if self.state_words in MARKS:
                return MARKS[self.state_words]
            case Column.EYE:
                return TITLES[column][1]
            case Column.SWATCH:
                whose = "own" if self.own_color else "automatic"
                return f"{self.name}: {whose} colour. Click to choose another."
            case Column.FLAG:
                return f"{self.name}: {FLAG_WORDS[self.flag]}. Click to change the flag."
            case Column.NOTE:
                return self.note or TITLES[column][1]
        number = "" if self.name == f"Object {self.label}" else f", object {self.label}"
        lines = [
            f"{self.name}{number}, {self.state_words}",
            f"{self.text(Column.VOLUME, units)} {units.volume.name}",
            f"mean density {self.text(Column.DENSITY, units)}",
        ]
        if self.edges is not None:
            lines[1] += f", {self.text(Column.SIZE, units)} {units.length.name}"
        if not np.isnan(self.confidence):
            lines.append(f"confidence {percent(self.confidence)} that this is one whole object")
        if self.is_example:
            lines.append("an example to train the confidence on")
        if self.flag:
            lines.append(FLAG_WORDS[self.flag])
        return "\n".join([*lines, *([f"“{self.note}”"] if self.note else [])])

    def spoken(self, column: Column) -> str:
        """Return what a drawn cell says to a screen reader."""
        match column:
            case Column.EYE:
                return "hidden" if self.state is ObjectState.HIDDEN else "shown"
            case Column.SWATCH:
                return "own colour" if self.own_color else "automatic colour"
            case Column.FLAG:
                return FLAG_WORDS[self.flag]
        return ""


BESIDE_HUE = attrgetter(*(each.name for each in fields(Row) if each.name not in ("hue", "color")))
"""Of a row, all but the hue of this view."""
