"""The user's own Labels layer and the session's labels, kept equal both ways."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.boxes import LabelBoxes
from napari_unpack.viewer.jobs import single_shot, stop
from napari_unpack.viewer.slice_sync import shows_labels

QUIET_MS = 300
"""After the last stroke of a brush."""

STROKES = ("labels_update", "paint")
EDITED = ("labels_update", "paint", "data", "set_data")


class LabelSync:
    """Hears brushes on the layers the session's labels came from, and shows repairs there.

    Parameters
    ----------
    session : Session
    sources : sequence of napari layers
        The user's own.
    ask : callable
        Given a task of `LabelEditor`, has it run on another thread and applied; returns False
        where that must wait.
    told : callable
        Given a sentence for the user.

    Notes
    -----
    A stroke is compared with the session's labels once the brush has been quiet for a moment.
    Where the layer's array is the one the session was made of, the session first takes a copy,
    or it would never know what was there before the stroke. Layers that read their voxels when
    they are looked at (dask, zarr, several resolutions) are not followed, which is said at the
    first stroke: every comparison would read all of them.
    """

    def __init__(
        self,
        session: Any,
        sources: Sequence[Any],
        ask: Callable[[Any], bool],
        told: Callable[[str], None],
    ) -> None:
        self._session, self._ask, self._told = session, ask, told
        showing = [layer for layer in sources if shows_labels(layer, session)]
        self._layers = [layer for layer in showing if _is_array(layer)]
        self._lazy = [layer for layer in showing if not _is_array(layer)]
        for layer in self._lazy:
            for name in STROKES:
                if hasattr(layer.events, name):
                    getattr(layer.events, name).connect(self._on_lazy)
        session.own_labels([layer.data for layer in self._layers])
        self._seen, self._boxes = session.labels, session.boxes
        self._writing = False
        self._painted: Any = None
        self._timer = single_shot(self._compare, QUIET_MS)
        for layer in self._layers:
            for name in EDITED:
                if hasattr(layer.events, name):
                    getattr(layer.events, name).connect(self._on_painted)
        session.events.labels.connect(self._show)

    @property
    def waiting(self) -> bool:
        """Whether a stroke has not been compared yet."""
        return bool(self._timer.isActive())

    def close(self) -> None:
        """Hear and show nothing more."""
        stop(self._timer)
        self._session.events.labels.disconnect(self._show, missing_ok=True)
        for layer in self._layers:
            for name in EDITED:
                if hasattr(layer.events, name):
                    getattr(layer.events, name).disconnect(self._on_painted)
        self._leave_lazy(self._lazy)
        self._layers = []

    def _leave_lazy(self, layers: Sequence[Any]) -> None:
        for layer in layers:
            for name in STROKES:
                if hasattr(layer.events, name):
                    getattr(layer.events, name).disconnect(self._on_lazy)
        self._lazy = [layer for layer in self._lazy if layer not in layers]

    def _on_lazy(self, event: Any) -> None:
        layer = event.source
        if layer in self._lazy:
            self._leave_lazy([layer])
            self._told(
                f"Painting on {layer.name} changes no object, because its labels are read piece by "
                "piece. To repair objects with the brush, open the labels as an array in memory "
                "and choose them in step 1; Split, Merge and Delete work as they are."
            )

    def _on_painted(self, event: Any) -> None:
        layer = event.source
        if self._writing or layer not in self._layers:
            return
        self._painted = layer
        self._timer.start()

    def _compare(self) -> None:
        layer = self._painted
        if layer is None or layer not in self._layers:
            return
        if np.shape(layer.data) != self._session.labels.shape:
            return
        if not self._ask(self._session.label_editor.paint_task(np.asarray(layer.data))):
            self._timer.start()

    def _show(self, ids: Iterable[int]) -> None:
        """Write what the session has changed of some objects into the layers."""
        before, labels = self._seen, self._session.labels
        box = _around(ids, self._boxes, self._session.boxes)
        self._seen, self._boxes = labels, self._session.boxes
        if box is None:
            return
        # Elsewhere in the box a stroke may wait to be compared.
        away = before[box] != labels[box]
        wanted = self._given()[labels[box][away]]
        self._writing = True
        try:
            for layer in self._layers:
                if np.array_equal(layer.data[box][away], wanted):
                    continue
                if not layer.data.flags.writeable:
                    layer.data = layer.data.copy()
                layer.data[box][away] = wanted.astype(layer.data.dtype)
                layer.refresh()
        finally:
            self._writing = False

    def _given(self) -> NDArray[np.int64]:
        session = self._session
        given = np.zeros(session.ids[-1] + 1, np.int64)
        given[list(session.ids)] = [session.label_of(i) for i in session.ids]
        return given


def _is_array(layer: Any) -> bool:
    return not getattr(layer, "multiscale", False) and isinstance(layer.data, np.ndarray)


def _around(ids: Iterable[int], *boxes: LabelBoxes) -> tuple[slice, ...] | None:
    """Return the box around where some objects were and are; None for nowhere."""
    wanted = list(ids)
    rows = [np.isin(each.ids, wanted) for each in boxes]
    low = np.concatenate([each.lower[row] for each, row in zip(boxes, rows, strict=True)])
    high = np.concatenate([each.upper[row] for each, row in zip(boxes, rows, strict=True)])
    if not len(low):
        return None
    ends = zip(low.min(axis=0), high.max(axis=0), strict=True)
    return tuple(slice(int(a), int(b)) for a, b in ends)
