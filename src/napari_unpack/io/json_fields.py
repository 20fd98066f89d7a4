"""Plain data read with care: what a file says is checked before it is believed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.transforms import is_rotation

LARGEST = 1e12
"""Of any number that is no density: a billion kilometres, or 30,000 years of seconds."""


class Fields:
    """A JSON object, field by field.

    Parameters
    ----------
    data : object
        As JSON gave it.
    where : str
        Its name in error messages.

    Raises
    ------
    ValueError
        If it is no object; and from every method if the field is missing or of another kind,
        naming the field.
    """

    def __init__(self, data: Any, where: str) -> None:
        if not isinstance(data, dict):
            raise ValueError(f"{where} must be an object, got {_short(data)}")
        self._data, self._where = data, where

    def has(self, name: str) -> bool:
        """Tell whether a field is there and not null."""
        return self._data.get(name) is not None

    def holds(self, name: str) -> bool:
        """Tell whether a field is there, null or not."""
        return name in self._data

    def __getitem__(self, name: str) -> Any:
        """Return a field as it is."""
        if name not in self._data:
            raise ValueError(f"{self._where} lacks {name!r}")
        return self._data[name]

    def part(self, name: str) -> Fields:
        """Return a field that is an object."""
        return Fields(self[name], f"{self._where}.{name}")

    def parts(self, name: str) -> Iterator[Fields]:
        """Yield the objects of a list."""
        for k, item in enumerate(self.items(name)):
            yield Fields(item, f"{self._where}.{name}[{k}]")

    def text(self, name: str, among: tuple[str, ...] = ()) -> str:
        """Return a text, one of some where these are given.

        Parameters
        ----------
        name : str
        among : tuple of str
            What it may be; any text where empty.
        """
        value = self[name]
        # Types are checked, never converted: a text "3" for 3 means that another program wrote it.
        if not isinstance(value, str) or (among and value not in among):
            self._refuse(name, f"one of {', '.join(among)}" if among else "text", value)
        return str(value)

    def flag(self, name: str) -> bool:
        """Return true or false."""
        value = self[name]
        if not isinstance(value, bool):
            self._refuse(name, "true or false", value)
        return bool(value)

    def integer(self, name: str, least: int = 0) -> int:
        """Return a whole number.

        Parameters
        ----------
        name : str
        least : int
            What it is at least.
        """
        value = self[name]
        # JSON's true is an int to Python.
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            self._refuse(name, f"a whole number from {least}", value)
        return int(value)

    def number(self, name: str) -> float:
        """Return a finite number."""
        return float(self.array(name, ()))

    def positive(self, name: str) -> float:
        """Return a finite number above 0, and not below any that means something."""
        value = self.number(name)
        if value < 1 / LARGEST:
            self._refuse(name, f"positive, from {1 / LARGEST:g}", value)
        return value

    def rotation(self) -> NDArray[np.float64]:
        """Return "rotation", a proper (3, 3) one."""
        rotation = self.array("rotation", (3, 3))
        if not is_rotation(rotation):
            self._refuse("rotation", "a rotation", rotation.tolist())
        return rotation

    def array(self, name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
        """Return finite numbers in a shape.

        Parameters
        ----------
        name : str
        shape : tuple of int
            Of the array.
        """
        value = self[name]
        try:
            found = np.array(value, dtype=np.float64)
            # An empty list has no second axis: (0, 2, 3) comes as (0,).
            found = found.reshape(shape) if found.size == 0 == np.prod(shape) else found
        except (TypeError, ValueError, OverflowError):
            found = np.array(np.nan)
        if found.shape != shape or not (np.abs(found) <= LARGEST).all():
            wanted = " x ".join(map(str, shape)) + " finite numbers" if shape else "a finite number"
            wanted += f" up to {LARGEST:g}"
            self._refuse(name, wanted, value)
        return found

    def ids(self, name: str, known: frozenset[int] | None = None) -> tuple[int, ...]:
        """Return object IDs, each once.

        Parameters
        ----------
        name : str
        known : frozenset of int, optional
            IDs of the objects in the labels; None for any.
        """
        values = self.items(name)
        whole = all(isinstance(i, int) and not isinstance(i, bool) and i > 0 for i in values)
        ours = whole and (known is None or known.issuperset(values))
        if not ours or len(set(values)) != len(values):
            self._refuse(name, "IDs of objects in the labels, each once", values)
        return tuple(values)

    def given_ids(self, name: str) -> NDArray[np.int64]:
        """Return IDs as labels were given with, exactly: no float holds all of them."""
        values = self.items(name)
        # Whole floats are of versions whose brush turned IDs of 64 bits into such.
        if not all(
            isinstance(i, int | float)
            and not isinstance(i, bool)
            and i % 1 == 0
            and 0 <= i <= np.iinfo(np.int64).max
            for i in values
        ):
            self._refuse(name, "IDs from 0 to below 2**63", values)
        return np.array([int(i) for i in values], dtype=np.int64)

    def groups(self, name: str, known: frozenset[int]) -> tuple[tuple[int, ...], ...]:
        """Return lists of known object IDs, no ID twice in all of them.

        Parameters
        ----------
        name : str
        known : frozenset of int
        """
        lists = self.items(name)
        flat = [i for group in lists for i in (group if isinstance(group, list) else [group])]
        # All at once, so that an ID in two groups is found too.
        Fields({name: flat}, self._where).ids(name, known)
        if not all(isinstance(group, list) for group in lists):
            self._refuse(name, "lists of IDs", lists)
        return tuple(tuple(group) for group in lists)

    def by_id(self, name: str, known: frozenset[int]) -> dict[int, Any]:
        """Return an object whose keys are known object IDs.

        Parameters
        ----------
        name : str
        known : frozenset of int
        """
        found = {}
        for key, value in self.part(name)._data.items():
            # JSON's keys are text, and int() also takes "١" and "1_0".
            if not (key.isascii() and key.isdigit() and int(key) in known):
                self._refuse(name, "keyed by IDs of objects in the labels", key)
            found[int(key)] = value
        return found

    def items(self, name: str) -> list[Any]:
        """Return a list."""
        value = self[name]
        if not isinstance(value, list):
            self._refuse(name, "a list", value)
        return list(value)

    def texts(self, name: str) -> tuple[str, ...]:
        """Return a list of texts."""
        value = self.items(name)
        if not all(isinstance(text, str) for text in value):
            self._refuse(name, "a list of texts", value)
        return tuple(value)

    def columns(self, name: str) -> dict[str, Any]:
        """Return values by name; numbers with nulls among them are floats with NaN."""
        part = self.part(name)
        found: dict[str, Any] = {key: part.items(key) for key in part._data}
        for key, values in found.items():
            # JSON has no NaN: it was written as null.
            known = [v for v in values if v is not None]
            if len(known) == len(values) or not all(type(v) in (int, float) for v in known):
                continue
            # No float holds all IDs of 64 bits.
            if any(isinstance(v, int) and abs(v) > 2**53 for v in known):
                found[key] = np.array(values, dtype=object)
            else:
                found[key] = [np.nan if v is None else float(v) for v in values]
        return found

    def _refuse(self, name: str, wanted: str, value: Any) -> None:
        raise ValueError(f"{self._where}.{name} must be {wanted}, got {_short(value)}")


def _short(value: Any) -> str:
    text = repr(value)
    # A message with a whole list in it is read by no one.
    return text if len(text) <= 60 else f"{text[:57]}..."
