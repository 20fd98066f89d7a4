"""Repair by hand: split, merge and delete objects, and take over what a brush has painted."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.appearance import golden_hue
from napari_unpack.segmentation.repair import (
    LabelEdit,
    delete_objects,
    difference,
    merge_objects,
    split_between,
)
from napari_unpack.session.errors import listed
from napari_unpack.session.labels import Edit, Judge, LabelData
from napari_unpack.session.sight import SessionSight
from napari_unpack.session.validation import MOST_ID, checked_ids
from napari_unpack.tasks import Progress, Task
from napari_unpack.unpacking import Queue


@dataclass(frozen=True, eq=False)
class Repair:
    """Labels as a repair leaves them, ready to be taken over.

    Parameters
    ----------
    verb : str
        What was done.
    source, contents : LabelData
        What it was done to, and the result.
    """

    verb: str
    source: LabelData
    contents: LabelData

    @property
    def new(self) -> tuple[int, ...]:
        """Objects that were not there before."""
        return tuple(int(i) for i in np.setdiff1d(self.contents.boxes.ids, self.source.boxes.ids))


@dataclass(frozen=True, eq=False)
class RepairQuestion:
    """The question what the labels are after a repair.

    Parameters
    ----------
    answer : callable
        Returns a `Repair`, None where nothing changes; may run on any thread.
    """

    answer: Callable[[], Repair | None]


@dataclass(frozen=True, eq=False)
class LabelsQuestion:
    """The question what the labels were or will be.

    Parameters
    ----------
    source : LabelData
        The labels of now.
    edit : Edit or None
        The last change made to those asked for.
    """

    source: LabelData
    edit: Edit | None

    def answer(self) -> LabelData:
        """Work it out, on any thread."""
        return self.source.at(self.edit)


class SessionRepair(SessionSight):
    """The verbs that change the labels; every one is undoable, to the voxel.

    Attributes
    ----------
    judge : callable, optional
        Returns the confidence of a `segmentation.Region`; by default the oracle that ships with
        the package. Asked for touched objects where any confidence is known.

    Notes
    -----
    Objects outside the bag must be restored first: their sprites show the voxels they left with.
    """

    judge: Callable[[Any], float] | None = None

    def split(self, object_id: int, a: Sequence[int], b: Sequence[int]) -> int:
        """Split an object so that each part holds one of two voxels.

        Parameters
        ----------
        object_id : int
        a, b : (3,) sequence of int
            Voxels of it, z y x.

        Returns
        -------
        int
            The new object; the larger part keeps the ID.

        Raises
        ------
        ValueError
            If there is no such object, it is outside the bag, or the voxels are not in it.
        """
        repair = self.split_question(object_id, a, b).answer()
        assert repair is not None, "a split always changes something"
        self.accept_repair(repair)
        return repair.new[0]

    def merge(self, ids: Iterable[int]) -> int:
        """Make one object of several; return its ID, the largest's.

        Raises
        ------
        ValueError
            If there are fewer than two, one is unknown, or one is outside the bag.
        """
        wanted = checked_ids(ids, self._known)
        repair = self.merge_question(wanted).answer()
        assert repair is not None, "a merge always changes something"
        self.accept_repair(repair)
        return next(i for i in wanted if i in self._known)

    def delete(self, ids: int | Iterable[int]) -> None:
        """Make background of objects.

        Raises
        ------
        ValueError
            If none is given or left, one is unknown, or one is outside the bag.
        """
        repair = self.delete_question(checked_ids(ids, self._known)).answer()
        assert repair is not None, "a deletion always changes something"
        self.accept_repair(repair)

    def split_question(self, object_id: int, a: Sequence[int], b: Sequence[int]) -> RepairQuestion:
        """Return the question of `split`, to be answered on another thread."""
        (object_id,) = checked_ids(object_id, self._known, "object_id")
        self._refuse_outside([object_id])
        for name, point in (("a", a), ("b", b)):
            spot = np.asarray(point)
            inside = spot.shape == (3,) and ((spot >= 0) & (spot < self.labels.shape)).all()
            if not inside or self.labels[tuple(spot.astype(int))] != object_id:
                raise ValueError(f"{name} must be a voxel of object {object_id}, got {point}")
        new_id = self._unused_id()
        return self._question_of(
            "split",
            lambda now: split_between(
                now.labels, now.boxes, self.volume, self.spacing.tolist(), a, b, new_id
            ),
        )

    def merge_question(self, ids: Iterable[int]) -> RepairQuestion:
        """Return the question of `merge`."""
        wanted = checked_ids(ids, self._known)
        if len(wanted) < 2:
            raise ValueError(f"ids must name at least two objects to merge, got {wanted}")
        self._refuse_outside(wanted)
        return self._question_of("merge", lambda now: merge_objects(now.labels, now.boxes, wanted))

    def delete_question(self, ids: Iterable[int]) -> RepairQuestion:
        """Return the question of `delete`."""
        wanted = checked_ids(ids, self._known)
        if not wanted or len(wanted) == len(self._ids):
            raise ValueError(
                f"ids must name some objects and leave at least one, got {len(wanted)} of "
                f"{len(self._ids)}"
            )
        self._refuse_outside(wanted)
        return self._question_of(
            "delete", lambda now: delete_objects(now.labels, now.boxes, wanted)
        )

    def paint_question(self, painted: ArrayLike) -> RepairQuestion:
        """Return the question what a brush has changed.

        Parameters
        ----------
        painted : (Z, Y, X) array_like of int
            Labels with the IDs people know objects by (`label_of`); compared when it is answered.
        """
        given = np.asarray(painted)
        if given.shape != self.labels.shape:
            raise ValueError(
                f"painted must have the labels' shape {self.labels.shape}, got {given.shape}"
            )
        return self._question_of("paint", lambda now: difference(now.labels, self._own_ids(given)))

    def accept_repair(self, repair: Repair | None) -> bool:
        """Take over a repair; return False, having done nothing, where it is out of date.

        Raises
        ------
        ValueError
            If it touches an object outside the bag, or leaves none.
        """
        if repair is None or repair.source is not self._contents:
            return False
        edit = repair.contents.edit
        assert edit is not None, "a repair has an edit"
        self._refuse_outside(self._known & edit.change.touched)
        known = frozenset(int(i) for i in repair.contents.boxes.ids)
        if not known:
            raise ValueError("at least one object must be left, none is")
        now = self._situation
        hues = {i: hue for i, hue in now.hues.items() if i in known}
        hues |= {i: golden_hue(i) for i in known - hues.keys()}
        inspected = None if now.inspected in edit.change.touched else now.inspected
        self._prepared = repair.contents
        self._do(
            repair.verb,
            replace(
                now,
                hues=hues,
                names={i: name for i, name in now.names.items() if i in known},
                hidden=now.hidden & known,
                good=now.good & known,
                inspected=inspected,
                queue=Queue(),
                ahead=(),
                edit=edit,
            ),
        )
        return True

    def own_labels(self, others: Iterable[NDArray[Any]]) -> None:
        """Keep labels that nobody else can write to, where one of these arrays is ours as well."""
        kept = self._contents.arrays
        if any(np.may_share_memory(theirs, ours) for theirs in others for ours in kept):
            self._hold(replace(self._contents, labels=self.labels.copy(), _kept=None))

    def labels_question(self, way: Literal["undo", "redo"]) -> LabelsQuestion | None:
        """Return the question what the labels are after the next step back or forth.

        None where that is known at once: most steps leave the labels alone, and those before
        the last repair are kept. On another thread it takes a second for a large volume.
        """
        source = self._contents
        edit = self.history.edit_after(way, self._situation.edit)
        return None if source.knows(edit) else LabelsQuestion(source, edit)

    def accept_labels(self, answer: LabelData | None) -> None:
        """Take note of what labels will be; of no use where another step is taken."""
        self._prepared = answer

    def _question_of(
        self, verb: str, change: Callable[[LabelData], LabelEdit | None]
    ) -> RepairQuestion:
        source, judge = self._contents, self._judge()

        def answer() -> Repair | None:
            made = change(source)
            if made is None or not len(made.where):
                return None
            ids = self._given_ids
            if ids is not None:
                fresh = np.arange(len(ids), max(made.touched) + 1)
                ids = np.concatenate([ids, ids.max() + 1 + np.arange(len(fresh))])
                self._given_ids = ids
            after = source.edited(made, self.volume, self.spacing, judge, ids)
            return Repair(verb, source, after)

        return RepairQuestion(answer)

    def use_oracle(self, judge: Callable[[Any], float] | None, scores: Mapping[int, float]) -> None:
        """Take another confidence for the table and for repairs to come.

        Parameters
        ----------
        judge : callable or None
            Returns the confidence of a `segmentation.Region`; None is the one that ships.
        scores : mapping of int to float
            The confidence of every object by it.
        """
        self.judge = judge
        facts = self._contents.facts
        facts["confidence"] = [float(scores.get(int(i), float("nan"))) for i in facts.index]

    def _judge(self) -> Judge:
        from napari_unpack.segmentation import Region
        from napari_unpack.segmentation.confidence.oracle import default_oracle

        confidence = self.judge or default_oracle()
        z, y, x = (float(v) for v in self.spacing)

        def judged(
            mask: NDArray[np.bool_], density: NDArray[Any], first: tuple[int, int, int]
        ) -> float:
            return float(confidence(Region(mask, density, first, (z, y, x))))

        return judged

    def _own_ids(self, painted: NDArray[Any]) -> NDArray[np.integer[Any]]:
        if self._given_ids is None:
            top = int(painted.max(initial=0))
            if painted.min(initial=0) < 0 or top > MOST_ID:
                raise ValueError(f"painted labels must be from 0 to {MOST_ID}, got {top}")
            return painted
        order = np.argsort(self._given_ids[1:]) + 1
        given = self._given_ids[order]
        fresh = np.setdiff1d(painted, np.append(given, 0))
        known = np.concatenate([[0], given, fresh])
        own = np.concatenate([[0], order, np.arange(len(fresh)) + len(self._given_ids)])
        if len(fresh):
            self._given_ids = np.concatenate([self._given_ids, fresh])
        place = np.argsort(known)
        return np.asarray(own[place][np.searchsorted(known[place], painted)])

    def _unused_id(self) -> int:
        if self._top < MOST_ID:
            return self._top + 1
        free = np.setdiff1d(np.arange(1, MOST_ID + 1), self.boxes.ids)
        if not len(free):
            raise ValueError(f"there are {MOST_ID} objects already: merge or delete some first")
        return int(free[0])

    def _refuse_outside(self, ids: Iterable[int]) -> None:
        away = [i for i in ids if i in self._situation.out or i in self._flights]
        if away:
            names = self.objects["name"]
            raise ValueError(
                f"{listed(str(names[i]) for i in away)} must be in the bag to be repaired: "
                "restore first"
            )


class LabelEditor:
    """Tasks for split, merge, delete and paint; `apply` takes over a result.

    Parameters
    ----------
    session : SessionRepair
    """

    def __init__(self, session: SessionRepair) -> None:
        self._session = session

    def __getattr__(self, name: str) -> Callable[..., Task[Any]]:
        make = getattr(self._session, name.replace("_task", "_question"))

        def task(*arguments: Any) -> Task[Any]:
            question = make(*arguments)

            def run(_: Progress) -> Any:
                return question.answer()

            return Task(question, run)

        return task

    def apply(self, result: Any) -> bool:
        """Take over an edit; return False where the labels have changed since."""
        return bool(self._session.accept_repair(result))
