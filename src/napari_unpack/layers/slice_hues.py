"""The session's hues on the user's own Labels layer, so that 2D slices show the same colours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from napari.layers import Labels

from napari_unpack.appearance import tints_of
from napari_unpack.layers.label_colors import label_colormap

STRIDE = 7
"""Every so many voxels are compared to tell whether a layer holds the session's labels."""


class SliceHues:
    """Lends a colormap to the layers the session's labels came from.

    Parameters
    ----------
    session : Session
        Whose hues.
    sources : sequence of napari layers
        The user's own; only Labels with the session's object IDs are coloured.
    """

    def __init__(self, session: Any, sources: Sequence[Any]) -> None:
        self._session = session
        self._theirs = [
            (layer, layer.colormap) for layer in sources if shows_labels(layer, session)
        ]
        self._brushes = [layer.selected_label for layer, _ in self._theirs]
        if self._theirs:
            session.events.selected.connect(self._choose)

    def paint(self) -> None:
        """Colour the layers in the hues of now."""
        if not self._theirs:
            return
        session = self._session
        tints = tints_of(session.hues, session.ids[-1], mode=session.tint_mode)
        colors = {session.label_of(i): tints[i] for i in session.ids}
        for layer, _ in self._theirs:
            layer.colormap = label_colormap(colors, np.zeros(4, np.float32))

    def close(self) -> None:
        """Give every layer its own colormap back."""
        self._session.events.selected.disconnect(self._choose, missing_ok=True)
        for (layer, colormap), brush in zip(self._theirs, self._brushes, strict=True):
            layer.colormap, layer.selected_label = colormap, brush
        self._theirs = []

    def _choose(self, ids: frozenset[int]) -> None:
        if len(ids) == 1:
            for layer, _ in self._theirs:
                layer.selected_label = self._session.label_of(next(iter(ids)))


def shows_labels(layer: Any, session: Any) -> bool:
    """Tell whether a layer holds the session's labels, as far as some of its voxels show."""
    labels = session.labels
    if not isinstance(layer, Labels) or layer.data.shape != labels.shape:
        return False
    some = (slice(None, None, STRIDE),) * 3
    given = np.zeros(session.ids[-1] + 1, np.int64)
    given[list(session.ids)] = [session.label_of(i) for i in session.ids]
    finest = layer.data[0] if layer.multiscale else layer.data
    return bool(np.array_equal(np.asarray(finest[some]), given[labels[some]]))
