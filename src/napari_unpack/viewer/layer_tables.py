"""The three layers as tables of objects: what **Duplicate** and **Save** make of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.appearance import tints_of
from napari_unpack.session.errors import percent
from napari_unpack.session.quantities import volume_words

if TYPE_CHECKING:
    from napari_unpack.session import Session


@dataclass(frozen=True, eq=False)
class ObjectTable:
    """Some objects as points at their centres, in their hues, with `session.objects` as features.

    Parameters
    ----------
    session : Session
    ids : callable
        Returns which, those unknown to the session's boxes left out.
    """

    session: Session
    ids: Callable[[], Iterable[int]]

    def points(self) -> NDArray[np.float64]:
        """Return (N, 3) centres, voxels z y x."""
        low, high = self._ends(self._known())
        return (low + high - 1) / 2

    def state(self) -> dict[str, Any]:
        """Return what else a Points layer of them is told."""
        session, known = self.session, self._known()
        low, high = self._ends(known)
        edges = (high - low).max(axis=1) if known else np.zeros(0)
        own = session.annotations.colors
        tints = tints_of(session.hues, session.ids[-1], mode=session.tint_mode, colors=own)
        # A table of the user's own may have the column too.
        facts = session.objects.reindex(known).drop(columns="id", errors="ignore")
        return {
            "features": facts.rename_axis("id").reset_index(),
            # napari takes no array of no colours.
            "face_color": tints[known, :3] if known else "white",
            "border_color": "transparent",
            # Points to be seen, but that leave their neighbours visible.
            "size": np.maximum(edges / 6, 1.0),
        }

    def _known(self) -> list[int]:
        # States may still name an object that a repair has just removed.
        return sorted(set(self.ids()) & set(self.session.boxes.ids.tolist()))

    def _ends(self, known: list[int]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        boxes = self.session.boxes
        rows = np.searchsorted(boxes.ids, known)
        return boxes.lower[rows], boxes.upper[rows]


def describe(session: Session, object_id: int) -> str:
    """Return what an object is called, and its confidence where there is one.

    Parameters
    ----------
    session : Session
    object_id : int
    """
    row = session.objects.loc[object_id]
    name = str(row.get("name", f"Object {session.label_of(object_id)}"))
    confidence = float(row.get("confidence", np.nan))
    return name if np.isnan(confidence) else f"{name}, confidence {percent(confidence)}"


def hint(session: Session, object_id: int) -> str:
    """Return what the mouse is on, in few words: name and volume.

    Parameters
    ----------
    session : Session
    object_id : int
    """
    row = session.objects.loc[object_id]
    return f"{row['name']}, {volume_words(float(row['volume_mm3']), session.length_unit)}"
