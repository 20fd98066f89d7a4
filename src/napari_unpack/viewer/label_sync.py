"""The user's own Labels layer and the session's labels, kept equal both ways."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from napari.layers import Labels, Layer
from numpy.typing import NDArray

from napari_unpack.geometry.boxes import LabelBoxes
from napari_unpack.viewer.protocols import Event
from napari_unpack.viewer.scheduler import Scheduler
from napari_unpack.viewer.slice_sync import shows_labels

if TYPE_CHECKING:
    from napari_unpack.session import Session
    from napari_unpack.session.label_edits import EditedLabels
    from napari_unpack.tasks import Task

# After the last stroke of a brush: a hand draws the next one within it.
QUIET_MS = 300


class LabelSync:
    """Follows brushes on the layers the session's labels came from, and shows repairs there.

    Parameters
    ----------
    session : Session
    scheduler : Scheduler
    sources : sequence of napari layers
        The user's own.
    run : callable
        Given a task of `LabelEditor` and what applies its result, has it run on another thread
        and applied; returns False where that must wait.
    message : callable
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
        session: Session,
        scheduler: Scheduler,
        sources: Sequence[Layer],
        run: Callable[[Task[Any], Callable[[EditedLabels | None], bool]], bool],
        message: Callable[[str], None],
    ) -> None:
        self._session, self._scheduler = session, scheduler
        self._run, self._message = run, message
        showing = [layer for layer in sources if shows_labels(layer, session)]
        self._layers = [layer for layer in showing if _is_array(layer)]
        self._lazy = [layer for layer in showing if not _is_array(layer)]
        for event in _strokes(self._lazy):
            event.connect(self._on_lazy)
        session.own_labels([layer.data for layer in self._layers])
        self._seen, self._boxes = session.labels, session.boxes
        self._writing = False
        self._painted: Labels | None = None
        for event in _edits(self._layers):
            event.connect(self._on_painted)
        session.events.labels.connect(self._show)

    @property
    def pending(self) -> bool:
        """Whether a stroke has not been compared yet."""
        return self._scheduler.pending(self._compare)

    def close(self) -> None:
        """Follow and show nothing more."""
        self._scheduler.forget(self._compare)
        self._session.events.labels.disconnect(self._show, missing_ok=True)
        for event in _edits(self._layers):
            event.disconnect(self._on_painted)
        self._leave_lazy(self._lazy)
        self._layers = []

    def _leave_lazy(self, layers: Sequence[Labels]) -> None:
        for event in _strokes(layers):
            event.disconnect(self._on_lazy)
        self._lazy = [layer for layer in self._lazy if layer not in layers]

    def _on_lazy(self, event: Any) -> None:
        layer = event.source
        if layer in self._lazy:
            self._leave_lazy([layer])
            self._message(
                f"Painting on {layer.name} changes no object, because its labels are read piece by "
                "piece. To repair objects with the brush, open the labels as an array in memory "
                "and choose them in step 1; Split, Merge and Delete work as they are."
            )

    def _on_painted(self, event: Any) -> None:
        layer = event.source
        # Our own writing raises the same events as a brush.
        if self._writing or layer not in self._layers:
            return
        self._painted = layer
        self._scheduler.debounce(self._compare, QUIET_MS, self._compare)

    def _compare(self) -> None:
        layer = self._painted
        if layer is None or layer not in self._layers or not self._fits(layer):
            return
        task = self._session.label_editor.paint_task(np.asarray(layer.data))
        if not self._run(task, self._take):
            self._scheduler.debounce(self._compare, QUIET_MS, self._compare)

    def _fits(self, layer: Labels) -> bool:
        # Another array may have been put into the layer: no stroke of a brush.
        return _is_array(layer) and layer.data.shape == self._session.labels.shape

    def _take(self, edited: EditedLabels | None) -> bool:
        """Apply what a brush has changed, and take out of the layers what is refused."""
        done = edited is None or self._session.label_editor.apply(edited)
        refused = None if edited is None else edited.refused
        if done and refused is not None and len(refused.where):
            shape = self._session.labels[refused.box].shape
            self._write(refused.box, np.unravel_index(refused.where, shape))
            self._message(
                "Objects must be in the bag to be painted on: restore them first. The strokes on "
                "those outside are taken back, all others count."
            )
        return done

    def _show(self, ids: Iterable[int]) -> None:
        """Write what the session has changed of some objects into the layers."""
        before, labels = self._seen, self._session.labels
        box = _around(ids, self._boxes, self._session.boxes)
        self._seen, self._boxes = labels, self._session.boxes
        if box is not None:
            # Elsewhere in the box a stroke may wait to be compared.
            self._write(box, before[box] != labels[box])

    def _write(self, box: tuple[slice, ...], where: Any) -> None:
        wanted = self._given()[self._session.labels[box][where]]
        self._writing = True
        try:
            for layer in self._layers:
                if not self._fits(layer) or np.array_equal(layer.data[box][where], wanted):
                    continue
                dtype, top = layer.data.dtype, wanted.max()
                # A new object's ID may be larger than all that were given.
                if top > np.iinfo(dtype).max:
                    dtype = np.promote_types(dtype, np.min_scalar_type(top))
                if dtype != layer.data.dtype or not layer.data.flags.writeable:
                    layer.data = layer.data.astype(dtype)
                layer.data[box][where] = wanted
                layer.refresh()
        finally:
            self._writing = False

    def _given(self) -> NDArray[np.int64]:
        session = self._session
        given = np.zeros(session.ids[-1] + 1, np.int64)
        given[list(session.ids)] = [session.label_of(i) for i in session.ids]
        return given


def _strokes(layers: Iterable[Labels]) -> list[Event]:
    return [e for layer in layers for e in (layer.events.labels_update, layer.events.paint)]


def _edits(layers: Sequence[Labels]) -> list[Event]:
    sets = [e for layer in layers for e in (layer.events.data, layer.events.set_data)]
    return _strokes(layers) + sets


def _is_array(layer: Labels) -> bool:
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
