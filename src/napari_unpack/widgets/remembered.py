"""What the panel remembers from one start of napari to the next, beside the preferences."""

from __future__ import annotations

from collections.abc import Iterable

from qtpy.QtCore import QSettings

from napari_unpack.widgets.object_columns import Column


def remembered() -> QSettings:
    """Return the store, a file of the user's."""
    return QSettings(
        QSettings.Format.IniFormat, QSettings.Scope.UserScope, "napari-unpack", "panel"
    )


class ChosenColumns:
    """The columns that a person chose for a table; None while nobody has.

    Parameters
    ----------
    key : str
        Of the table.
    """

    def __init__(self, key: str) -> None:
        self._key = f"columns/{key}"
        stored = remembered().value(self._key, "")
        names = {column.name: column for column in Column}
        # A file of another version may name columns that there are no more.
        found = {names[name] for name in str(stored or "").split() if name in names}
        self.chosen: set[Column] | None = found | {Column.NAME} if found else None

    def choose(self, columns: Iterable[Column] | None) -> None:
        """Remember columns; None forgets them."""
        self.chosen = None if columns is None else {*columns, Column.NAME}
        store = remembered()
        if self.chosen is None:
            store.remove(self._key)
        else:
            # By name: numbers may change from version to version.
            store.setValue(self._key, " ".join(c.name for c in sorted(self.chosen)))
