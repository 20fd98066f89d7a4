"""Lengths and angles that a person measured between points of objects."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import triple
from napari_unpack.geometry.length_unit import MM, LengthUnit
from napari_unpack.session.quantities import angle_words, length_words
from napari_unpack.session.validation import checked_whole

if TYPE_CHECKING:
    from napari_unpack.session.document import Document


@dataclass(frozen=True)
class SurfacePoint:
    """A point of an object, or of the scan.

    Parameters
    ----------
    object_id : int
        Which it is a point of, and goes along with; 0 for none.
    at : (float, float, float)
        Where it is in the scan, world mm z y x, wherever the object is now.

    Raises
    ------
    TypeError, ValueError
        If `object_id` is no whole number from 0.
    """

    object_id: int
    at: tuple[float, float, float]

    def __post_init__(self) -> None:
        """Keep plain numbers, whatever array they were taken from."""
        object.__setattr__(self, "object_id", checked_whole(self.object_id, "object_id"))
        object.__setattr__(self, "at", triple(self.at))


@dataclass(frozen=True)
class Measurement:
    """A length between two points, or the angle at the second of three.

    Parameters
    ----------
    points : tuple of SurfacePoint

    Raises
    ------
    ValueError
        If there are neither two nor three points, or one stands where the next does.
    """

    points: tuple[SurfacePoint, ...]

    def __post_init__(self) -> None:
        """Refuse what measures nothing."""
        if len(self.points) not in (2, 3):
            raise ValueError(
                f"a measurement takes two points, or three for an angle, got {len(self.points)}"
            )
        if not np.isfinite(self.ends).all() or not all(self.lengths):
            raise ValueError(
                "the points of a measurement must be finite and apart from one another: "
                "choose two that are"
            )

    @property
    def ends(self) -> NDArray[np.float64]:
        """Its points, (2 or 3, 3), mm of the scan."""
        return np.array([point.at for point in self.points], dtype=np.float64)

    @property
    def lengths(self) -> tuple[float, ...]:
        """Of its lines, mm."""
        return tuple(float(v) for v in np.linalg.norm(np.diff(self.ends, axis=0), axis=1))

    @property
    def angle(self) -> float | None:
        """At the middle one of three points, degrees; None for two."""
        if len(self.points) == 2:
            return None
        first, middle, last = self.ends
        a, b = first - middle, last - middle
        # Exact for small angles too, where the arc cosine is not.
        return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))

    @property
    def objects(self) -> frozenset[int]:
        """The objects its points are on; 0 for points on none."""
        return frozenset(point.object_id for point in self.points)

    @property
    def words(self) -> str:
        """What was measured, for people: "34.2 mm", or "90.0° (12.0 mm, 34.2 mm)"."""
        return self.words_in(MM)

    def numbers_in(self, unit: LengthUnit) -> tuple[str, ...]:
        """Return each length in a unit, then the angle, in words."""
        lengths = tuple(length_words(mm, unit) for mm in self.lengths)
        return lengths if self.angle is None else (*lengths, angle_words(self.angle))

    def words_in(self, unit: LengthUnit) -> str:
        """Say what was measured in a unit of lengths."""
        numbers = self.numbers_in(unit)
        return numbers[0] if len(numbers) == 1 else f"{numbers[2]} ({numbers[0]}, {numbers[1]})"


def owner_after(
    point: SurfacePoint,
    before: NDArray[np.integer],
    after: NDArray[np.integer],
    spacing: NDArray[np.float64],
) -> int:
    """Return which object has the voxel that a point is on, after labels were edited.

    Parameters
    ----------
    point : SurfacePoint
    before, after : (Z, Y, X) ndarray of int
    spacing : (3,) ndarray of float64, mm z y x
    """
    place = np.array(point.at) / spacing
    # A point of a surface lies beside its voxel.
    low = np.maximum(np.rint(place).astype(int) - 1, 0)
    box = tuple(slice(first, first + 3) for first in low)
    voxels = np.argwhere(before[box] == point.object_id)
    if not len(voxels):
        return point.object_id
    nearest = voxels[np.linalg.norm(voxels + low - place, axis=1).argmin()]
    # What was erased leaves its points behind.
    return int(after[box][tuple(nearest)]) or point.object_id


def _among(measurement: Measurement, known: frozenset[int]) -> Measurement:
    """Return a measurement whose points on objects that are no more are points of none."""
    if measurement.objects <= known | {0}:
        return measurement
    points = measurement.points
    return Measurement(tuple(p if p.object_id in known else SurfacePoint(0, p.at) for p in points))


class Measurements:
    """The measurements of a session, in the order in which they were made.

    Parameters
    ----------
    document : Document
    """

    def __init__(self, document: Document) -> None:
        self._doc = document

    def __iter__(self) -> Iterator[Measurement]:
        # The state keeps which object a point was on, for undo of its deletion.
        known = self._doc.label_data.known
        return (_among(one, known) for one in self._doc.state.measurements)

    def __len__(self) -> int:
        return len(self._doc.state.measurements)

    @property
    def shown(self) -> bool:
        """Whether they are drawn: in the 3D view and in slices, in pictures and films."""
        return self._doc.view_state.decorations.measurements

    @shown.setter
    def shown(self, shown: bool) -> None:
        self._doc.show_measurements(bool(shown))

    def add(self, points: Iterable[SurfacePoint]) -> Measurement:
        """Add a measurement, which can be undone; return it.

        Raises
        ------
        ValueError
            If the points measure nothing, or one is of no object of the session.
        """
        made = Measurement(tuple(points))
        self._doc.checked(made.objects - {0}, "points")
        state = self._doc.state
        new = replace(state, measurements=(*state.measurements, made))
        self._doc.commit("measure", new)
        return made

    def remove(self, index: int) -> None:
        """Remove a measurement by its place in the order.

        Raises
        ------
        IndexError
            If there is none.
        """
        kept = list(self._doc.state.measurements)
        if not 0 <= index < len(kept):
            raise IndexError(f"there are {len(kept)} measurements, counted from 0; got {index}")
        del kept[index]
        new = replace(self._doc.state, measurements=tuple(kept))
        self._doc.commit("remove a measurement", new)
