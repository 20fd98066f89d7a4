"""What a session shows and in which colours: hide, show, isolate, recolour, select, rename."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.appearance import Decorations, TransferFunction, assign_hues
from napari_unpack.appearance.minimum_opacity import at_least, minimum_opacity, surely_seen
from napari_unpack.rendering import interference_in
from napari_unpack.rendering.object_style import ObjectStyle
from napari_unpack.session.state import ObjectState
from napari_unpack.session.tinting import SessionTints
from napari_unpack.session.validation import checked_ids, checked_planes

DISTANCE = 5.0
"""DT of eq. 1, pixels of the canvas."""

LAYERS = 2
"""LT of eq. 1."""

MOST_PIXELS = 640
"""Longer side of the object-ID image hues are chosen from; larger canvases are scaled down."""

_NO_STUDY = ObjectStyle()


@dataclass(frozen=True, eq=False)
class HueQuestion:
    """The question which hues keep neighbours apart in a view.

    Parameters
    ----------
    answer : callable
        Returns {id: hue} of the objects in view; may run on any thread.
    """

    answer: Callable[[], dict[int, float]]


class SessionSight(SessionTints):
    """The verbs that change how things look and not where they are.

    Attributes
    ----------
    locked_hues : frozenset of int
        Objects whose hue recolouring leaves alone.
    hue_margin : float
        Fraction of every hue arc left empty; neighbours come out at least hue_margin / C apart.
    """

    locked_hues: frozenset[int] = frozenset()
    hue_margin = 0.4
    _colored = False
    _veils: tuple[object, dict[int, TransferFunction]] = (None, {})
    _surroundings: Decorations | None = None

    @property
    def transfer_function(self) -> TransferFunction:
        """The master transfer function; setting it can be undone."""
        return self._situation.transfer_function

    @transfer_function.setter
    def transfer_function(self, transfer_function: TransferFunction) -> None:
        if not isinstance(transfer_function, TransferFunction):
            raise TypeError(
                f"transfer_function must be a TransferFunction, got {transfer_function!r}"
            )
        situation = replace(self._situation, transfer_function=transfer_function)
        self._do("transfer function", situation, merge=True)

    @property
    def clipping(self) -> NDArray[np.float64]:
        """Planes that cut the packed bag open, (N, 2, 3): point and normal, voxels z y x.

        What lies behind one, (p - point) . normal < 0, is not shown; nothing else changes, so
        that what is cut away still blocks. Setting it takes None for no plane, is told as a
        change of the transfer function, and is not undoable.
        """
        return self._clipping

    @clipping.setter
    def clipping(self, planes: ArrayLike | None) -> None:
        wanted = checked_planes(planes)
        if not np.array_equal(wanted, self._clipping):
            self._clipping = wanted
            self.events.transfer_function.emit(self.transfer_function)

    @property
    def surroundings(self) -> Decorations:
        """Background, box and scale bar of every picture; not undoable."""
        if self._surroundings is None:
            self._surroundings = Decorations.of("dark")
        return self._surroundings

    @surroundings.setter
    def surroundings(self, surroundings: Decorations) -> None:
        self._surroundings = surroundings
        self.events.surroundings.emit(surroundings)

    def study(self, object_id: int) -> ObjectStyle:
        """Return the opacity and the cut an object has of its own."""
        return self._situation.studies.get(object_id, _NO_STUDY)

    def transfer_function_of(self, object_id: int) -> TransferFunction:
        """Return the transfer function an object is shown with outside the bag.

        Its own, or the master's; where that would show next to nothing of it, with a veil: who
        takes something out of a bag expects to see it leave.
        """
        own = self.study(object_id).transfer_function
        return self._veiled(object_id) if own is None else own

    def _veiled(self, object_id: int) -> TransferFunction:
        shown, boxes = self._situation.transfer_function, self.boxes
        key = (self._edition, shown)
        if self._veils[0] != key:
            self._veils = key, {}
        known = self._veils[1]
        if object_id not in known:
            row, facts = boxes.index(object_id), self._facts.loc[object_id]
            edges = boxes.upper[row] - boxes.lower[row]
            least = 0.0
            if not surely_seen(int(boxes.counts[row]), edges, facts["mean_density"], shown):
                part = boxes.slices(object_id)
                least = minimum_opacity(self.labels[part] == object_id, self.volume[part], shown)
            known[object_id] = at_least(shown, least) if least else shown
        return known[object_id]

    def set_study(self, object_id: int, study: ObjectStyle | None) -> None:
        """Give an object an opacity or a cut of its own; None takes both away.

        Successive changes are one step of undo. The bag shows nothing of it.
        """
        (object_id,) = checked_ids(object_id, self._known, "object_id")
        studies = {i: one for i, one in self._situation.studies.items() if i != object_id}
        if study is not None and (study.transfer_function or study.cut):
            studies[object_id] = study
        self._do(f"study {object_id}", replace(self._situation, studies=studies), merge=True)

    @property
    def selected(self) -> frozenset[int]:
        """IDs selected in the picture or in the table."""
        return self._selected

    def select(self, ids: int | Iterable[int] = ()) -> None:
        """Select objects, and only these; not undoable."""
        wanted = frozenset(checked_ids(ids, self._known))
        if wanted != self._selected:
            self._selected = wanted
            self.events.selected.emit(wanted)

    def rename(self, object_id: int, name: str) -> None:
        """Give an object a name.

        Raises
        ------
        ValueError
            If there is no such object or the name is blank.
        """
        (object_id,) = checked_ids(object_id, self._known, "object_id")
        if not name.strip():
            raise ValueError("name must not be blank")
        names = {**self._situation.names, object_id: name.strip()}
        self._do("rename", replace(self._situation, names=names))

    @property
    def examples(self) -> frozenset[int]:
        """The objects marked as examples of whole ones, to train the confidence on."""
        return self._situation.good & self._known

    def mark_examples(self, ids: int | Iterable[int], examples: bool = True) -> None:
        """Mark objects as examples of whole ones, or take the mark away."""
        wanted = frozenset(checked_ids(ids, self._known))
        now = self._situation.good
        after = now | wanted if examples else now - wanted
        if after != now:
            self._do("mark" if examples else "unmark", replace(self._situation, good=after))

    def hide(self, ids: int | Iterable[int]) -> None:
        """Put objects out of sight, in the bag or outside; a flight of theirs ends."""
        wanted = checked_ids(ids, self._known)
        fresh = [i for i in wanted if i not in self._situation.hidden]
        if fresh:
            self._do("hide", self._situation.with_hidden(fresh))

    def show(self, ids: int | Iterable[int] | None = None) -> None:
        """Bring objects into sight again where they were, by default all."""
        wanted = self._ids if ids is None else checked_ids(ids, self._known)
        if self._situation.hidden.intersection(wanted):
            self._do("show", self._situation.with_shown(wanted))

    def isolate(self, ids: int | Iterable[int]) -> None:
        """Show these objects and hide all others.

        Raises
        ------
        ValueError
            If no object is given, or one that is not of this session.
        """
        wanted = checked_ids(ids, self._known)
        if not wanted:
            raise ValueError("ids must name at least one object to isolate, got none")
        hidden = self._known.difference(wanted)
        if hidden != self._situation.hidden:
            shown = self._situation.with_shown(wanted)
            self._do("isolate", shown.with_hidden(hidden))

    def recolor(self, keep: bool = True, undoable: bool = True) -> dict[int, float]:
        """Give what is packed hues that its neighbours in this view do not have.

        Parameters
        ----------
        keep : bool
            Keep hues that still separate; False starts afresh.
        undoable : bool
            False where the camera came to rest and nobody asked.

        Returns
        -------
        dict of int to float
            All hues.
        """
        found = self.__dict__.pop("_hues_found", None)
        self.accept_hues(self.hue_question(keep).answer() if found is None else found, undoable)
        return self.hues

    def hue_question(self, keep: bool = True) -> HueQuestion:
        """Return the question `recolor` asks, to be answered on another thread."""
        size = self._canvas_size
        scale = min(1.0, MOST_PIXELS / max(size))
        shape = max(1, round(size[0] * scale)), max(1, round(size[1] * scale))
        visible = self._table(i for i, s in self.states.items() if s is ObjectState.PACKED)
        camera, cast = self._camera, self.casters.ids
        previous = self._situation.hues if keep and self._colored else None
        margin, locked, backend = self.hue_margin, self.locked_hues, self.backend

        def answer() -> dict[int, float]:
            ids = cast(camera, visible, shape, LAYERS)
            graph = interference_in(ids, DISTANCE * scale, LAYERS, backend)
            return assign_hues(graph, previous, margin, locked=locked)

        return HueQuestion(answer)

    def accept_hues(self, hues: Mapping[int, float], undoable: bool = True) -> None:
        """Take over new hues; objects not among them keep theirs."""
        checked_ids(hues, self._known, "hues")
        merged = {**self._situation.hues, **hues}
        self._colored = True
        if merged == self._situation.hues:
            return
        situation = replace(self._situation, hues=merged)
        if undoable:
            self._do("recolor", situation)
        else:
            self._enter(situation)

    def _table(self, ids: Iterable[int]) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        visible = np.zeros(self._top + 1, dtype=np.bool_)
        visible[list(ids)] = True
        return visible
