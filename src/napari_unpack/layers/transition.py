"""The layer of what moves: objects in the air, and the one that is inspected."""

from __future__ import annotations

from collections.abc import Sequence

from napari_unpack.layers.cards_adapter import CardsAdapter
from napari_unpack.layers.compat import PictureLayer, register
from napari_unpack.layers.shots import Shot
from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.visuals.cards import Card


class TransitionLayer(PictureLayer):
    """Objects between the bag and their places, each in a card of its own.

    Parameters
    ----------
    name, spacing, box, **placement
        As for `PictureLayer`; without a box it does not stretch the scene.
    """

    def __init__(self, *args: object, **kwargs: object) -> None:
        self._shots: dict[int, Shot] = {}
        super().__init__(*args, **kwargs)  # type: ignore[arg-type]

    @property
    def shots(self) -> dict[int, Shot]:
        """What is shown, by object."""
        return dict(self._shots)

    def show(self, shots: dict[int, Shot]) -> None:
        """Show these and nothing else."""
        self._shots = dict(shots)
        for shot in list(shots.values())[:1]:
            self.set_picture(shot.patch.rgba)
        self.repaint()

    def cards_at(self, frame: Frame) -> Sequence[Card]:
        """Return a card for each object in the air."""
        super().cards_at(frame)
        return [shot.card(frame.camera) for shot in self._shots.values()]


register(
    TransitionLayer,
    CardsAdapter,
    "Objects on their way out of the bag or back, and the one being inspected. Empty while "
    "nothing moves.",
)
