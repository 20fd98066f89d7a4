"""The user's layer may be moved or scaled while its session is open: ours go with it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from napari.layers import Layer

from napari_unpack.geometry.length_unit import MM
from napari_unpack.layers.placement import FIELDS, equal_spacing, place_of, spacing_of
from napari_unpack.viewer.camera_sync import follow_placement

if TYPE_CHECKING:
    import napari

    from napari_unpack.layers.compat import PictureLayer
    from napari_unpack.session import Session


class PlacementSync:
    """Keeps our layers on the layer that the session's volume comes from.

    Parameters
    ----------
    viewer : napari.Viewer
    session : Session
    layers : sequence of PictureLayer
        Ours, the packed one first.
    sources : sequence of napari layers
        The user's own; the first of three dimensions or more is followed.
    rescaled : callable
        Called with a sentence when the voxels have another size than in the session, whose
        lengths and volumes would all be others: that takes a new session.
    """

    def __init__(
        self,
        viewer: napari.Viewer,
        session: Session,
        layers: Sequence[PictureLayer],
        sources: Sequence[Layer],
        rescaled: Callable[[str], None],
    ) -> None:
        self._viewer, self._session, self._layers = viewer, session, tuple(layers)
        self._rescaled = rescaled
        self._source = next((layer for layer in sources if layer.ndim >= 3), None)
        self._told = tuple(session.spacing)
        for event in self._events():
            event.connect(self._follow)

    def close(self) -> None:
        """Follow no more."""
        for event in self._events():
            event.disconnect(self._follow)

    def _events(self) -> list[Any]:
        return [] if self._source is None else [self._source.events[name] for name in FIELDS]

    def _follow(self, _event: Any = None) -> None:
        # Its data may have become a picture, which has no place in space.
        if self._source is None or self._source.ndim < 3:
            return
        spacing = spacing_of(self._source)
        if not equal_spacing(spacing, self._session.spacing):
            # A slider in napari's controls tells of every step on its way.
            if not equal_spacing(spacing, self._told):
                self._told = spacing
                self._rescaled(_words(self._source.name, spacing, self._session))
            return
        self._told = tuple(self._session.spacing)
        for name, value in place_of(self._source).items():
            for layer in self._layers:
                setattr(layer, name, value)
        follow_placement(self._viewer, self._session, self._layers[0])


def _words(name: str, spacing: Sequence[float], session: Session) -> str:
    # In voxels a voxel would always be one.
    unit = MM if session.length_unit.name == "voxels" else session.length_unit
    now, before = (
        " x ".join(f"{unit.per_mm * edge:.4g}" for edge in each)
        for each in (spacing, session.spacing)
    )
    return (
        f"The voxels of '{name}' are {now} {unit.name} now, and {before} {unit.name} in the 3D "
        "view. To measure with the new size, press Use the new voxel size in step 1."
    )
