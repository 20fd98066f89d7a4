"""What some results of `Queries` depend on; the others stand beside what works them out."""

from __future__ import annotations

from typing import NamedTuple

from napari_unpack.session.labels import Edit, LabelData, Rating
from napari_unpack.session.state import SessionState


class StatesKey(NamedTuple):
    """What the states of all objects depend on."""

    state: SessionState
    flights: int
    revision: int


class SlotsKey(NamedTuple):
    """What the places beside the bag depend on."""

    wanted: int
    radius: float
    canvas_size: tuple[int, int]
    fov: float


class BagUpKey(NamedTuple):
    """What the bag's up depends on."""

    revision: int
    up: tuple[float, ...]


class LabelsKey(NamedTuple):
    """What the labels at another place of the chain of edits depend on."""

    revision: int
    edit: Edit | None
    rating: Rating | None

    def fits(self, data: LabelData) -> bool:
        """Return whether it is of these labels, rated as they are."""
        return self.revision == data.revision and self.rating is data.rating
