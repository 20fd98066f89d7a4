"""Edits of the labels: split, merge, delete, what a brush has painted, and what objects score."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.appearance import golden_hue
from napari_unpack.geometry.axes import triple
from napari_unpack.segmentation.repair import (
    LabelEdit,
    delete_objects,
    difference,
    merge_objects,
    split_between,
)
from napari_unpack.segmentation.review.doubts import Answer
from napari_unpack.session import commands
from napari_unpack.session.errors import OutsideError, listed_objects
from napari_unpack.session.labels import Confidence, LabelData, Rating, touched_between
from napari_unpack.session.measurements import owner_after
from napari_unpack.session.validation import MOST_ID, checked_ids, whole_numbers
from napari_unpack.tasks import Progress, Share, Task

if TYPE_CHECKING:
    from napari_unpack.session.document import Document

GivenIds = NDArray[np.int64] | None
Change = Callable[[LabelData], tuple[LabelEdit | None, GivenIds]]


@dataclass(frozen=True)
class LabelEditKey:
    """What an edit depends on.

    Parameters
    ----------
    verb : str
        What is done.
    revision : int
        Of the labels it is made on.
    """

    verb: str
    revision: int


@dataclass(frozen=True)
class ScoresKey:
    """What scores depend on.

    Parameters
    ----------
    revision : int
        Of the labels.
    rating : Rating
        The model.
    """

    revision: int
    rating: Rating


@dataclass(frozen=True, eq=False)
class EditedLabels:
    """Labels as an edit leaves them, ready to be applied.

    Parameters
    ----------
    verb : str
        What was done.
    revision : int
        Of the labels it was made on.
    data : LabelData
        The result.
    new : tuple of int
        Objects that were not there before.
    refused : LabelEdit, optional
        What a brush did to objects outside the bag; the result is without it.
    painted : bool
        Whether a brush chose voxels; else objects were chosen as wholes.
    """

    verb: str
    revision: int
    data: LabelData
    new: tuple[int, ...]
    refused: LabelEdit | None = None
    painted: bool = False


@dataclass(frozen=True, eq=False)
class Scores:
    """What a model says of objects.

    Parameters
    ----------
    rating : Rating
        The model.
    by_id : mapping of int to float
        Confidences.
    data : LabelData
        The labels that were scored.
    """

    rating: Rating
    by_id: Mapping[int, float]
    data: LabelData

    @property
    def chosen(self) -> bool:
        """Whether the model is another than was in use, and not asked for what it had missed."""
        return self.rating is not self.data.rating


class LabelEditor:
    """Makes tasks that edit the labels, and applies what they return; every edit is undoable.

    Parameters
    ----------
    session : Document

    Notes
    -----
    A task writes nothing: its edit carries the revision it was made on, and `apply` refuses it
    on another. Objects outside the bag must be restored first: their sprites show the voxels
    they left with.
    """

    def __init__(self, session: Document) -> None:
        self._session = session

    @property
    def oracle(self) -> Callable[[Any], float] | None:
        """Returns the confidence of a `segmentation.Region`; None is the one that ships.

        Asked for touched objects where any confidence is known. A session goes on by the one set
        here with the confidences that it has.
        """
        rating = self._session.label_data.rating
        return None if rating is None else rating.oracle

    @oracle.setter
    def oracle(self, oracle: Callable[[Any], float] | None) -> None:
        self._session.label_data = replace(self._session.label_data, rating=Rating(oracle))

    def outside(self, ids: Iterable[int]) -> list[int]:
        """Return those of some objects that must be restored before they can be repaired."""
        session = self._session
        # On its way back too: the flight shows the voxels it left with.
        away = session.state.placements.keys() | session.flights.keys()
        # Each once: both sides of a join are one object.
        return [i for i in dict.fromkeys(ids) if i in away]

    def scores_task(self, oracle: Callable[[Any], float] | None) -> Task[Scores]:
        """Return the task that has another model score every object.

        Parameters
        ----------
        oracle : callable, optional
            As for `Session.use_oracle`.
        """
        return self._scores_task(Rating(oracle), None)

    def missing_scores_task(self) -> Task[Scores] | None:
        """Return the task that has the model in use score what it has not; None where all is.

        Such are objects of before another model was used, which undo or redo brought back, and
        those repaired while it scored the others.
        """
        data = self._session.label_data
        if data.rating is None or not data.unrated:
            return None
        return self._scores_task(data.rating, data.unrated)

    def _scores_task(self, rating: Rating, ids: Sequence[int] | None) -> Task[Scores]:
        session, data = self._session, self._session.label_data
        volume, spacing = session.volume, triple(session.spacing)

        def run(progress: Progress) -> Scores:
            from napari_unpack.segmentation.object_table import confidences

            share = Share(progress, text="Scoring")
            found = confidences(data.labels, volume, spacing, rating.oracle, share, ids)
            return Scores(rating, found, data)

        return Task(ScoresKey(data.revision, rating), run)

    def take_scores(self, scores: Scores) -> None:
        """Use the model of a task, and what it says of objects that are as they were then.

        Of those repaired meanwhile nothing is known, until `missing_scores_task` has run.
        """
        now = self._session.label_data
        known: dict[int, float] = {}
        if not scores.chosen:
            # What was missing of one model is of no use to the next.
            if scores.rating is not now.rating:
                return
            known = now.facts["confidence"].to_dict()
        other = touched_between(scores.data.edit, now.edit)
        fresh = {i: score for i, score in scores.by_id.items() if i not in other}
        self._session.label_data = now.rescored(known | fresh, scores.rating)

    def split_task(
        self, object_id: int, a: Sequence[int], b: Sequence[int]
    ) -> Task[EditedLabels | None]:
        """Return the task that splits an object so that each part holds one of two voxels.

        Parameters
        ----------
        object_id : int
        a, b : (3,) sequence of int
            Voxels of it, z y x. The larger part keeps the ID.

        Raises
        ------
        ValueError
            If there is no such object, it is outside the bag, or the voxels are not in it or one.
        """
        session, now = self._session, self._session.label_data
        (object_id,) = checked_ids(object_id, now.known, "object_id")
        self._refuse_outside([object_id])
        # Checked here and not in the task: a refusal comes at once, beside the click.
        one, two = (_voxel(now, object_id, spot, name) for name, spot in (("a", a), ("b", b)))
        if one == two:
            raise ValueError(f"a and b must be two different voxels, got {a} twice")
        new_id = _unused_id(now)
        volume, mm = session.volume, session.spacing.tolist()
        return self._task(
            "split",
            lambda data: (
                split_between(data.labels, data.boxes, volume, mm, one, two, new_id),
                data.given_ids,
            ),
        )

    def merge_task(self, ids: Iterable[int]) -> Task[EditedLabels | None]:
        """Return the task that makes one object of several; it has the largest one's ID.

        Raises
        ------
        ValueError
            If there are fewer than two, one is unknown, or one is outside the bag.
        """
        wanted = checked_ids(ids, self._session.label_data.known)
        if len(wanted) < 2:
            raise ValueError(f"ids must name at least two objects to merge, got {wanted}")
        self._refuse_outside(wanted)
        return self._task(
            "merge",
            lambda data: (merge_objects(data.labels, data.boxes, wanted), data.given_ids),
        )

    def delete_task(self, ids: int | Iterable[int]) -> Task[EditedLabels | None]:
        """Return the task that makes background of objects.

        Raises
        ------
        ValueError
            If none is given or left, one is unknown, or one is outside the bag.
        """
        # A session without objects has no boxes, no bag and nothing to look at.
        known = self._session.label_data.known
        wanted = checked_ids(ids, known)
        if not wanted or len(wanted) == len(known):
            raise ValueError(
                f"ids must name some objects and leave at least one, got {len(wanted)} of "
                f"{len(known)}"
            )
        self._refuse_outside(wanted)
        return self._task(
            "delete",
            lambda data: (delete_objects(data.labels, data.boxes, wanted), data.given_ids),
        )

    def paint_task(self, painted: ArrayLike) -> Task[EditedLabels | None]:
        """Return the task that takes over what a brush has changed; None where that is nothing.

        Parameters
        ----------
        painted : (Z, Y, X) array_like of int
            Labels with the IDs people know objects by; compared when the task runs. Strokes on
            objects that are outside the bag now are `refused`, the others count.

        Raises
        ------
        ValueError
            If the shape is another.
        """
        given, shape = np.asarray(painted), self._session.label_data.labels.shape
        if given.shape != shape:
            raise ValueError(f"painted must have the labels' shape {shape}, got {given.shape}")

        def change(data: LabelData) -> tuple[LabelEdit | None, GivenIds]:
            known = data.given_ids
            # To translate the IDs of a whole volume takes ten times as long.
            if known is not None and _is_shown(given, data.labels, known):
                return None, known
            own, given_ids = _own_ids(given, known)
            return difference(data.labels, own), given_ids

        outside = self.outside(self._session.label_data.known)
        return self._task("paint", change, outside, painted=True)

    def change_task(
        self, verb: str, ids: list[int], change: Callable[[LabelData, int], LabelEdit | None]
    ) -> Task[EditedLabels | None]:
        """Return the task that changes labels as a function says.

        Parameters
        ----------
        verb : str
            What is done, for people.
        ids : list of int
            Objects that it may touch.
        change : callable
            Given the labels and an ID that no object has, returns the edit.

        Raises
        ------
        ValueError
            If one of the objects is outside the bag.
        """
        self._refuse_outside(ids)
        new_id = _unused_id(self._session.label_data)
        return self._task(verb, lambda data: (change(data, new_id), data.given_ids))

    def apply(self, edited: EditedLabels | None, answers: tuple[Answer, ...] | None = None) -> bool:
        """Make the result of a task the session's labels; return False where it is out of date.

        Parameters
        ----------
        edited : EditedLabels, optional
        answers : tuple of Answer, optional
            A person's of the review then, where the edit is one; by default those that were.

        Raises
        ------
        OutsideError
            If it touches an object outside the bag.
        ValueError
            If it leaves none.
        """
        now, state = self._session.label_data, self._session.state
        # Laid over other labels it would write objects back that are gone.
        if edited is None or edited.revision != now.revision:
            return False
        if edited.data.revision == now.revision:
            # All of a stroke was refused.
            return True
        edit, known = edited.data.edit, edited.data.known
        assert edit is not None, "edited labels have an edit"
        # Again: one may have left while the task ran, and a brush touches anything.
        self._refuse_outside(now.known & edit.change.touched)
        if not known:
            raise ValueError("at least one object must be left, none is")
        # Good enough until hues are chosen for a view again.
        fresh = {i: golden_hue(i) for i in known - state.hues.keys()}
        # Another oracle may have scored the objects while the task ran.
        data = replace(edited.data, facts=now.facts_after(edit), rating=now.rating)
        owner = partial(
            owner_after, before=now.labels, after=data.labels, spacing=self._session.spacing
        )
        whole = None if edited.painted else now.known - known
        new = commands.edit_labels(state, edit, known, fresh, whole, owner)
        new = new if answers is None else replace(new, answers=answers)
        self._session.commit(edited.verb, new, data=data)
        return True

    def _task(
        self, verb: str, change: Change, outside: Sequence[int] = (), painted: bool = False
    ) -> Task[EditedLabels | None]:
        session, source = self._session, self._session.label_data
        # All it needs is read now: the session goes on while the task runs.
        volume, spacing, confidence = session.volume, session.spacing, self._confidence()

        def run(_: object) -> EditedLabels | None:
            made, given_ids = change(source)
            if made is None:
                return None
            made, refused = _parted(made, outside)
            edited = EditedLabels(verb, source.revision, source, (), refused, painted)
            # A step that changes nothing would be undone without effect.
            if not len(made.where):
                return edited if len(refused.where) else None
            given_ids = _extended(given_ids, max(made.touched))
            data = source.edited(made, volume, spacing, confidence, given_ids)
            return replace(edited, data=data, new=tuple(sorted(data.known - source.known)))

        return Task(LabelEditKey(verb, source.revision), run)

    def _confidence(self) -> Confidence:
        from napari_unpack.segmentation import Region
        from napari_unpack.segmentation.common.density_regions import air_offset
        from napari_unpack.segmentation.common.validation import in_common_range
        from napari_unpack.segmentation.confidence.oracle import default_oracle
        from napari_unpack.segmentation.object_table import confidence_in

        oracle = self.oracle or default_oracle()
        spacing = triple(self._session.spacing)
        volume, labels = self._session.volume, self._session.label_data.labels

        # Once asked, by the worker: it looks through the whole volume.
        @cache
        def field() -> tuple[NDArray[np.generic], float]:
            density = in_common_range(volume)[0]
            return density, air_offset(density, labels)

        def confidence(mask: NDArray[np.bool_], box: tuple[slice, slice, slice]) -> float:
            density, air = field()
            # With what is around it, as `confidences` rates all.
            return confidence_in(oracle, Region.of(mask, density, box, spacing, air))

        return confidence

    def _refuse_outside(self, ids: Iterable[int]) -> None:
        away = self.outside(ids)
        if away:
            # What is hidden is not put back.
            first = "restore" if self._session.state.hidden.isdisjoint(away) else "show and restore"
            raise OutsideError(
                f"{listed_objects(self._session.names(away))} must be in the bag to be repaired: "
                f"{first} first"
            )


def _parted(made: LabelEdit, ids: Sequence[int]) -> tuple[LabelEdit, LabelEdit]:
    """Return the part of an edit that touches none of some objects, and the part that does."""
    touches = np.isin(made.before, ids) | np.isin(made.after, ids)
    kept, refused = (
        LabelEdit(made.box, made.where[each], made.before[each], made.after[each])
        for each in (~touches, touches)
    )
    return kept, refused


def _extended(given_ids: GivenIds, largest_id: int) -> GivenIds:
    """Return the IDs people know objects by, with new ones up to the largest object."""
    if given_ids is None:
        return None
    # Above all that were ever given, so that no two objects are shown under one number.
    count, top = max(largest_id + 1 - len(given_ids), 0), int(given_ids.max())
    fresh = np.arange(1, count + 1)
    if top <= np.iinfo(np.int64).max - count:
        return np.concatenate([given_ids, top + fresh])
    # There are no larger ones: the smallest that were never given.
    unused = np.setdiff1d(np.arange(1, len(given_ids) + count + 1), given_ids)
    return np.concatenate([given_ids, unused[:count]])


def _is_shown(
    painted: NDArray[Any], labels: NDArray[np.uint16], given_ids: NDArray[np.int64]
) -> bool:
    planes = zip(labels, painted, strict=True)
    return all(np.array_equal(given_ids[ours], theirs) for ours, theirs in planes)


def _own_ids(
    painted: NDArray[Any], given_ids: GivenIds
) -> tuple[NDArray[np.integer[Any]], GivenIds]:
    """Return painted labels with a session's IDs, and the IDs people know them by then."""
    least, top = int(painted.min(initial=0)), int(painted.max(initial=0))
    most = MOST_ID if given_ids is None else np.iinfo(np.int64).max
    if least < 0 or top > most:
        wrong = least if least < 0 else top
        raise ValueError(f"painted labels must be from 0 to {most}, got {wrong}")
    if given_ids is None:
        return painted, None
    # Of uint64 and int64 numpy makes floats, which merge large IDs.
    painted = painted.astype(np.int64, copy=False)
    order = np.argsort(given_ids[1:]) + 1
    given = given_ids[order]
    fresh = np.setdiff1d(painted, np.append(given, 0))
    # IDs that objects had are not used again: undo may bring these back.
    if len(given_ids) + len(fresh) > MOST_ID + 1:
        raise ValueError(
            f"there is no room for a new object {fresh[0]}: {MOST_ID} objects are or were there "
            "already; paint with the ID of one of them"
        )
    known = np.concatenate([[0], given, fresh])
    own = np.concatenate([[0], order, np.arange(len(fresh)) + len(given_ids)])
    # Binary search wants them in order; new IDs stand at the end until here.
    place = np.argsort(known)
    found = np.asarray(own[place][np.searchsorted(known[place], painted)])
    return found, np.concatenate([given_ids, fresh])


def _voxel(now: LabelData, object_id: int, point: Sequence[int], name: str) -> tuple[int, ...]:
    """Return a voxel of an object as plain numbers; `ValueError` where it is none."""
    spot = whole_numbers(point, 3)
    inside = spot is not None and all(
        0 <= i < n for i, n in zip(spot, now.labels.shape, strict=True)
    )
    if spot is None or not inside or now.labels[spot] != object_id:
        raise ValueError(
            f"{name} must be a voxel of object {object_id}, whole numbers z y x, got {point}"
        )
    return spot


def _unused_id(data: LabelData) -> int:
    if data.largest_id < MOST_ID:
        return data.largest_id + 1
    # An ID used again would name another object after undo, so only for want of new ones.
    unused = np.setdiff1d(np.arange(1, MOST_ID + 1), data.boxes.ids)
    if not len(unused):
        raise ValueError(f"there are {MOST_ID} objects already: merge or delete some first")
    return int(unused[0])
