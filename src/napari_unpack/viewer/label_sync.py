"""The user's own Labels layer and the session's labels, kept equal both ways."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar
from weakref import WeakSet

import numpy as np
from napari.layers import Labels, Layer
from numpy.typing import NDArray

from napari_unpack.geometry.boxes import LabelBoxes
from napari_unpack.layers.compat import unwrap
from napari_unpack.session.errors import OutsideError
from napari_unpack.tasks import Cancelled, Task
from napari_unpack.viewer.protocols import Event
from napari_unpack.viewer.scheduler import Scheduler, Worker

if TYPE_CHECKING:
    from napari_unpack.session import Session
    from napari_unpack.session.label_edits import EditedLabels

T = TypeVar("T")

# After the last stroke of a brush: a hand draws the next one within it.
QUIET_MS = 300

_open: WeakSet[LabelSync] = WeakSet()
"""All that follow layers now, of every viewer of the process."""


class LabelSync:
    """Follows brushes on the layers the session's labels came from, and shows repairs there.

    Parameters
    ----------
    session : Session
    scheduler : Scheduler
    sources : sequence of napari layers
        The user's own that the session is of, and those that share their memory. Its labels are
        those of the Labels of its shape among them.
    run : callable
        Given a task of `LabelEditor`, what is given its result, and what is given its error, has
        it run on another thread; returns False where that must wait.
    message : callable
        Given a sentence for the user.
    recoloring : callable
        Returns whether the plugin is giving the layers other colours.
    refusal : str, optional
        Why nothing can be painted now: strokes are taken back with this sentence.

    Notes
    -----
    A stroke is compared with the session's labels once the brush has been quiet for a moment, and
    once at the start: one may have come after the session took its labels. Where the layer's array
    is the one the session was made of, the session first takes a copy, or it would never know
    what was there before the stroke. What cannot be taken over is taken back: every comparison
    is of the whole layer, and would meet it again. Layers that read their voxels when they are
    looked at (dask, zarr, several resolutions), and arrays of another shape, are not followed,
    which is said at the first stroke: every comparison would read all of them. A time series of
    which a followed layer is one time point, in the same memory, is followed with it. A layer that
    the session of another viewer follows is not followed here, and one whose array that session
    follows in another layer is given a copy: two sessions would take each other's repairs for
    strokes, and each might refuse the other's. Both are said.
    """

    def __init__(
        self,
        session: Session,
        scheduler: Scheduler,
        sources: Sequence[Layer],
        run: Callable[
            [
                Task[EditedLabels | None],
                Callable[[EditedLabels | None], None],
                Callable[[Exception], None],
            ],
            bool,
        ],
        message: Callable[[str], None],
        recoloring: Callable[[], bool],
        refusal: str = "",
    ) -> None:
        self._session, self._scheduler, self._refusal = session, scheduler, refusal
        self._run, self._message, self._recoloring = run, message, recoloring
        elsewhere = [x for sync in _open for x in sync._layers if sync._fits(x)]
        self._layers: list[Labels] = [
            x for x in sources if isinstance(x, Labels) and self._is_free(x, elsewhere)
        ]
        for layer in filter(self._fits, self._layers):
            self._part(layer, elsewhere)
        _open.add(self)
        session.own_labels([layer.data for layer in self._layers if _is_array(layer)])
        self._seen, self._boxes = session.labels, session.boxes
        self._writing = self._stroke = self._took_back = False
        self._told: set[Labels] = set()
        for event in _edits(self._layers):
            event.connect(self._on_painted)
        session.events.labels.connect(self._show)
        for layer in self._layers:
            if _is_array(layer) and self._followed(layer) is None:
                self._tell(layer)
        self._painted = next(filter(self._fits, self._layers), None)
        if self._painted is not None and not refusal:
            # By itself: nobody has asked for it, and repairs do not wait for it.
            self._submit(
                session.label_editor.paint_task(np.asarray(self._painted.data)), self._take
            )

    @property
    def pending(self) -> bool:
        """Whether a stroke has not been compared yet."""
        return self._scheduler.pending(self._compare)

    @property
    def has_stroke(self) -> bool:
        """Whether something may have been painted that the session does not know yet.

        Looking at another slice, which is compared too, is none.
        """
        return self._stroke

    @property
    def followed(self) -> tuple[Labels, ...]:
        """The layers on which a stroke of a brush is an edit."""
        return tuple(layer for layer in self._layers if self._followed(layer) is not None)

    def take_back(self, layer: Labels) -> bool:
        """Take a layer's last stroke back before it is compared; return whether that was done.

        Once until the next stroke: an earlier one may be a step of the session already, and of
        repairs that came between napari knows nothing.
        """
        if not self.pending or self._took_back:
            return False
        self._took_back = True
        layer.undo()
        return True

    def close(self) -> None:
        """Follow and show nothing more."""
        _open.discard(self)
        self._scheduler.forget(self._compare)
        self._scheduler.cancel(self)
        self._session.events.labels.disconnect(self._show, missing_ok=True)
        for event in _edits(self._layers):
            event.disconnect(self._on_painted)
        self._layers = []

    def _is_free(self, layer: Labels, elsewhere: Sequence[Labels]) -> bool:
        """Return whether a layer is no other session's, and say so where it is."""
        free = all(layer is not x for x in elsewhere)
        if not free:
            self._message(
                f"{layer.name} is open in another window too. What is painted on it and repaired "
                "goes by the objects there; repairs here are not shown in it."
            )
        return free

    def _part(self, layer: Labels, elsewhere: Sequence[Labels]) -> None:
        """Give a layer an array of its own, where another session follows it in another layer."""
        if any(_share_memory(layer, x) for x in elsewhere):
            layer.data = layer.data.copy()
            self._message(
                f"The array of {layer.name} is also that of labels that are open in another "
                "window. Here it is a copy from now on, so that repairs in one change nothing in "
                "the other."
            )

    def _on_painted(self, event: Any) -> None:
        layer = event.source
        # Our own writing raises the same events as a brush.
        if self._writing or self._recoloring() or layer not in self._layers:
            return
        followed = self._followed(layer)
        if followed is not None:
            self._told.discard(layer)
            self._painted = followed
            # Looking at another slice is no stroke, and neither is napari's undo.
            if event.type != "set_data":
                self._stroke, self._took_back = True, False
            self._wait()
        # Which is also raised when another slice is looked at.
        elif event.type != "set_data":
            self._tell(layer)

    def _tell(self, layer: Labels) -> None:
        """Say why a layer is not followed, once until it is."""
        if layer in self._told:
            return
        self._told.add(layer)
        lost = "changes no object, and repairs are not shown there"
        if not _is_array(layer):
            self._message(
                f"Painting on {layer.name} {lost}, because its labels are read piece by piece. "
                "To repair objects with the brush, open the labels as an array in memory and "
                "choose them in step 1; Split, Merge and Delete work as they are."
            )
            return
        given, wanted = (
            " x ".join(map(str, shape)) for shape in (layer.data.shape, self._session.labels.shape)
        )
        self._message(
            f"Painting on {layer.name} {lost}, because its labels are {given} now and those of the "
            f"objects {wanted}. To unpack other labels, choose them in step 1."
        )

    def _wait(self) -> None:
        self._scheduler.debounce(QUIET_MS, self._compare)

    def _compare(self) -> None:
        layer = self._painted
        if layer is None or layer not in self._layers or not self._fits(layer):
            self._stroke = False
            return
        if self._refusal:
            self._give_up(ValueError(self._refusal))
            return
        task = self._session.label_editor.paint_task(np.asarray(layer.data))
        if not self._run(task, self._take, self._give_up):
            self._wait()

    def _fits(self, layer: Labels) -> bool:
        # Another array may have been put into the layer: no stroke of a brush.
        return _is_array(layer) and layer.data.shape == self._session.labels.shape

    def _followed(self, layer: Labels) -> Labels | None:
        """Return the layer of the session's labels that a stroke on this one changes."""
        if self._fits(layer):
            return layer
        ours = filter(self._fits, self._layers)
        return next((x for x in ours if _share_memory(x, layer)), None)

    def _take(self, edited: EditedLabels | None) -> None:
        """Apply what a brush has changed, and take out of the layers what is refused."""
        try:
            applied = edited is None or self._session.label_editor.apply(edited)
        except OutsideError:
            applied = False
        except ValueError as error:
            self._give_up(error)
            return
        if not applied:
            # Another change came between: the stroke is still in the layer.
            self._wait()
            return
        self._stroke &= self.pending
        refused = None if edited is None else edited.refused
        if refused is not None and len(refused.where):
            shape = self._session.labels[refused.box].shape
            self._write(refused.box, np.unravel_index(refused.where, shape))
            self._message(
                "Objects must be in the bag to be painted on: restore them first. The strokes on "
                "those outside are taken back, all others count."
            )

    def _give_up(self, error: Exception) -> None:
        """Take out of the layers all that the session has not taken over."""
        if isinstance(error, Cancelled):
            return
        given, labels = self._given(), self._session.labels
        shown = [np.asarray(layer.data) for layer in self._layers if self._fits(layer)]
        task = Task(object(), lambda _: [_differing(given, labels, each) for each in shown])
        self._submit(task, partial(self._take_back, error))

    def _take_back(
        self, error: Exception, found: list[tuple[slice, NDArray[np.bool_]] | None]
    ) -> None:
        self._stroke &= self.pending
        painted = [one for one in found if one is not None]
        for planes, where in painted:
            self._write((planes, slice(None), slice(None)), where)
        # Looking at another slice raises the same events as a stroke.
        if self._refusal and not painted:
            return
        # Anything else is a defect, and no fault of the brush.
        if not isinstance(error, ValueError):
            raise error
        self._message(f"What was painted is taken back: {error}.")

    def _submit(self, task: Task[T], done: Callable[[T], None]) -> None:
        self._scheduler.submit(task, Worker.LONG, done, failed=self._give_up, slot=self)

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
            for layer in filter(self._fits, self._layers):
                if np.array_equal(layer.data[box][where], wanted):
                    continue
                dtype, top = layer.data.dtype, wanted.max()
                # A new object's ID may be larger than all that were given.
                if top > np.iinfo(dtype).max:
                    dtype = np.promote_types(dtype, np.min_scalar_type(top))
                if dtype != layer.data.dtype or not layer.data.flags.writeable:
                    layer.data = layer.data.astype(dtype)
                layer.data[box][where] = wanted
            # Those too that show the same memory.
            for layer in self._layers:
                if self._followed(layer) is not None:
                    layer.refresh()
        finally:
            self._writing = False

    def _given(self) -> NDArray[np.int64]:
        session = self._session
        given = np.zeros(session.ids[-1] + 1, np.int64)
        given[list(session.ids)] = [session.label_of(i) for i in session.ids]
        return given


def _differing(
    given: NDArray[np.int64], labels: NDArray[np.uint16], shown: NDArray[Any]
) -> tuple[slice, NDArray[np.bool_]] | None:
    """Return the planes between which a layer shows other labels, and where; None for nowhere."""
    pairs = list(zip(labels, shown, strict=True))
    other = [z for z, (ours, theirs) in enumerate(pairs) if not np.array_equal(given[ours], theirs)]
    if not other:
        return None
    planes = slice(other[0], other[-1] + 1)
    return planes, np.stack([given[ours] != theirs for ours, theirs in pairs[planes]])


def with_sharing(sources: Sequence[Layer], layers: Iterable[Layer]) -> list[Layer]:
    """Return sources, and the series that one of them is a part of, in the same memory.

    Another part of it, as another time point, is no other view of the objects.

    Parameters
    ----------
    sources : sequence of napari layers
    layers : iterable of napari layers
        Among which they are looked for.
    """
    series = [
        x
        for x in map(unwrap, layers)
        if any(x.ndim > each.ndim and _share_memory(x, each) for each in sources)
    ]
    return list(dict.fromkeys((*sources, *series)))


def _share_memory(*layers: Layer) -> bool:
    arrays = [x.data for x in layers if isinstance(x, Labels) and _is_array(x)]
    return len(arrays) == 2 and np.may_share_memory(*arrays)


def _edits(layers: Iterable[Labels]) -> list[Event]:
    told = ("labels_update", "paint", "data", "set_data")
    return [layer.events[name] for layer in layers for name in told]


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
