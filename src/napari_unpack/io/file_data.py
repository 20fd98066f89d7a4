"""What a file holds, before one volume is chosen from it by the names of its axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import Matrix
from napari_unpack.io.scan import Spacing, checked_volume_array

SPACE = "zyx"

NO_VOXEL_SIZE = "it gives no voxel size: 1 mm was assumed"

LABELS_LEFT_OUT = "its labels have another shape than its volume: they were left out"

NO_UNIT = "it names no unit of length: mm was assumed"

FIRST_LABELS = "its labels are those of the first of"
"""How many time points there are follows."""

UNNAMED = "q"
"""What tifffile calls an axis without a name."""

# What an axis that is none of space is called in messages, by its letter.
_AXIS_NAMES = {"c": "channel", "t": "time point"}

# Lengths in mm, by the names that OME (udunits), OME-XML and ImageJ give them.
_ONE = {
    **dict.fromkeys(("angstrom", "ångström", "Å", "A"), 1e-7),
    **dict.fromkeys(("nanometer", "nm"), 1e-6),
    # There are two micro signs that look alike.
    **dict.fromkeys(("micrometer", "micron", "microns", "um", "µm", "μm"), 1e-3),
    **dict.fromkeys(("millimeter", "mm"), 1.0),
    **dict.fromkeys(("centimeter", "cm"), 10.0),
    **dict.fromkeys(("decimeter", "dm"), 100.0),
    **dict.fromkeys(("meter", "m"), 1000.0),
    **dict.fromkeys(("inch", "in"), 25.4),
    **dict.fromkeys(("foot", "ft"), 304.8),
}

# Letters: all shorter names are signs.
_SHORTEST_WORD = 4

# Some writers name several: "micrometers".
MILLIMETRES = _ONE | {f"{name}s": mm for name, mm in _ONE.items() if name.endswith("er")}


@dataclass(frozen=True, eq=False)
class FileData:
    """What a reader found in a file.

    Parameters
    ----------
    volume : ndarray, optional
        Densities, axes as in `axes`; None where there are labels alone.
    axes : str
        A letter for each axis: z, y, x, c (channel), t (time), or what the file calls it.
    spacing : (float, float, float) of mm, z y x
    labels : ([T,] Z, Y, X) ndarray of int, optional
        Those of each time point where they have an axis more.
    assumed : tuple of str
        A sentence for each thing that the file does not say and that was assumed.
    scanner_from_scan : (4, 4) ndarray of float64, optional
        From mm along the axes z, y, x to the scanner's mm x to the left, y to the back, z to the
        head, where the file says where the scan lies.
    is_density : bool
        The file itself says that its volume is no labels.
    turned : bool
        Its array is not in the order of its file, or not in the one in which other programs put a
        series of slices: axes were swapped or flipped to the scanner's.
    """

    volume: NDArray[Any] | None
    axes: str = SPACE
    spacing: Spacing = (1.0, 1.0, 1.0)
    labels: NDArray[Any] | None = None
    assumed: tuple[str, ...] = ()
    scanner_from_scan: Matrix | None = None
    is_density: bool = False
    turned: bool = False

    def one_volume(self, at: Mapping[str, int], source: object) -> FileData:
        """Return data whose volume has the axes z, y, x.

        Parameters
        ----------
        at : mapping of str to int
            Which element of each other axis that is longer than 1, by its letter.
        source : object
            The file's name, for messages.

        Raises
        ------
        ValueError
            If an axis of space is missing, or an element of another is not chosen or not there.
        """
        if self.volume is None:
            return self
        shape = dict(zip(self.axes, self.volume.shape, strict=True))
        if not set(SPACE) <= set(self.axes):
            raise ValueError(
                f"{source} must hold a volume with axes z, y, x, got {_described(shape)}"
                f"{_advice(shape)}"
            )
        chosen = {axis: at.get(axis, 0) for axis in self.axes if axis not in SPACE}
        for axis, element in chosen.items():
            if axis not in at and shape[axis] > 1:
                raise ValueError(
                    f"{source} holds {_counted(shape[axis], axis)} ({_described(shape)}): "
                    f"choose one, from 0 to {shape[axis] - 1}, such as {axis}=0"
                )
            checked_element(axis, element, shape[axis], source)
        unknown = sorted(set(at) - set(chosen))
        if unknown:
            raise ValueError(
                f"{source} has no axis {', '.join(unknown)} to choose from: {_described(shape)}"
            )
        volume = self.volume[tuple(chosen.get(axis, slice(None)) for axis in self.axes)]
        left = [axis for axis in self.axes if axis in SPACE]
        volume = checked_volume_array(volume.transpose([left.index(a) for a in SPACE]), source)
        labels = self.labels
        if labels is not None and labels.ndim > len(SPACE):
            labels = labels[chosen["t"]]
        return replace(self, volume=np.ascontiguousarray(volume), axes=SPACE, labels=labels)

    def space_last(self) -> FileData:
        """Return data with the axes of space last, z y x, and those of length 1 left out."""
        if self.volume is None or self.axes == SPACE:
            return self
        kept = [a for a, n in zip(self.axes, self.volume.shape, strict=True) if n > 1 or a in SPACE]
        order = [a for a in kept if a not in SPACE] + [a for a in SPACE if a in kept]
        lone = tuple(i for i, a in enumerate(self.axes) if a not in kept)
        volume = self.volume.squeeze(lone).transpose([kept.index(a) for a in order])
        return replace(self, volume=volume, axes="".join(order))


def size_text(spacing: Spacing) -> str:
    """Return a voxel size as it is told, to more digits than anybody measures."""
    return " x ".join(f"{mm:.5g}" for mm in spacing) + " mm"


def checked_element(axis: str, element: int, length: int, source: object) -> int:
    """Return the number of a channel or time point that is there.

    Parameters
    ----------
    axis : str
        Its letter.
    element, length : int
        Which one, of how many.
    source : object
        The file's name, for messages.

    Raises
    ------
    ValueError
        If it is not there.
    """
    if not 0 <= element < length:
        raise ValueError(
            f"{source} holds {_counted(length, axis)}, numbered from 0: there is no "
            f"{axis}={element}"
        )
    return element


def axis_name(axis: str) -> str:
    """Return what an axis other than those of space is called in messages."""
    return _AXIS_NAMES.get(axis, f"{axis}-element")


def _counted(count: int, axis: str) -> str:
    named = f"{axis_name(axis)}s" if axis != UNNAMED else "elements of an axis without a name"
    return f"{count} {named}"


def plain_unit(unit: str) -> str:
    """Return the name of a unit of length in lower case where it cannot be another's then.

    Words are the same in any case, and MM; Mm are a thousand kilometres.
    """
    known = unit.lower() in MILLIMETRES and len(unit) >= _SHORTEST_WORD
    return unit.lower() if known or unit == "MM" else unit


def in_millimetres(unit: str | None, default: str, assumed: list[str]) -> float:
    """Return the length of a unit, mm, and note where it had to be assumed.

    Parameters
    ----------
    unit : str, optional
        As the file names it.
    default : str
        What the format means where there is no unit.
    assumed : list of str
        Takes a sentence where the unit is not known.
    """
    found = MILLIMETRES.get(default if unit is None else plain_unit(str(unit)))
    if found is None:
        sentence = f"its unit of length {unit!r} is not known: mm was assumed"
        if sentence not in assumed:
            assumed.append(sentence)
        return 1.0
    return found


def _advice(shape: Mapping[str, int]) -> str:
    """Say what to do about a file without slices."""
    pages = [axis for axis in shape if axis not in f"{SPACE}c"]
    if set("yx") <= set(shape) and len(pages) == 1:
        (axis,) = pages
        return f": if its {axis_name(axis)}s are slices, call that axis z where it is saved"
    return ": save all slices as one stack"


def _described(shape: Mapping[str, int]) -> str:
    return "axes " + ", ".join(f"{axis} ({length})" for axis, length in shape.items())
