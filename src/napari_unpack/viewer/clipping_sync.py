"""napari's clipping planes of the packed layer, handed to the session and back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from napari.layers import Layer
from numpy.typing import NDArray

if TYPE_CHECKING:
    from napari_unpack.session import Session


class ClippingSync:
    """Keeps a session cut open where the packed layer is.

    Parameters
    ----------
    layer : PackedLayer
        Its `experimental_clipping_planes` are in data coordinates, which are voxels.
    session : Session
        Its `clipping` follows them, and they follow it.
    sources : sequence of napari layers
        The user's own; the first with clipping planes lends them where the session has none.
    changed : callable
        Called when other objects than before may be in view.
    """

    def __init__(
        self, layer: Layer, session: Session, sources: Sequence[Layer], changed: Callable[[], None]
    ) -> None:
        self._layer, self._session, self._changed = layer, session, changed
        self._writing = False
        lent = (enabled_planes(source) for source in sources)
        if not len(session.clipping):
            session.clipping = next((planes for planes in lent if len(planes)), None)
        self._follow_session()
        layer.experimental_clipping_planes.events.connect(self._follow_layer)
        session.events.transfer_function.connect(self._follow_session)

    def close(self) -> None:
        """Follow no more; the session stays cut as it is."""
        self._layer.experimental_clipping_planes.events.disconnect(self._follow_layer)
        self._session.events.transfer_function.disconnect(self._follow_session, missing_ok=True)

    def _follow_layer(self, event: Any = None) -> None:
        planes = enabled_planes(self._layer)
        if not self._writing and not same_planes(planes, self._session.clipping):
            self._session.clipping = planes
            self._changed()

    def _follow_session(self) -> None:
        wanted = self._session.clipping
        if same_planes(enabled_planes(self._layer), wanted):
            return
        # Setting planes raises the event that we follow.
        self._writing = True
        try:
            self._layer.experimental_clipping_planes = [
                {"position": tuple(point), "normal": tuple(normal), "enabled": True}
                for point, normal in wanted
            ]
        finally:
            self._writing = False
        self._changed()


def same_planes(a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    """Tell whether planes are the same but for rounding: napari makes normals unit vectors anew.

    Parameters
    ----------
    a, b : (N, 2, 3) ndarray of float64
    """
    return a.shape == b.shape and bool(np.allclose(a, b, rtol=0, atol=1e-9))


def enabled_planes(layer: Layer) -> NDArray[np.float64]:
    """Return a layer's clipping planes that are on, (N, 2, 3): point and normal, voxels z y x."""
    planes = getattr(layer, "experimental_clipping_planes", ())
    rows = [(p.position, p.normal) for p in planes if p.enabled]
    return np.array(rows, dtype=np.float64).reshape(-1, 2, 3)
