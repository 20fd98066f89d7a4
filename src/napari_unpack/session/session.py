"""The session: virtual unpacking of one bag, without a screen or with one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from napari_unpack.geometry.axes import Matrix, Vector
from napari_unpack.geometry.transforms import Pose
from napari_unpack.rendering.scene import Scene
from napari_unpack.session.asking import OcclusionAnswer
from napari_unpack.session.errors import BlockedError, NoTableError
from napari_unpack.session.label_edits import LabelEditor
from napari_unpack.session.queries import Queries
from napari_unpack.session.scene_description import SceneDescription
from napari_unpack.session.state import Placement, SessionState
from napari_unpack.session.steps import SessionSteps
from napari_unpack.session.validation import checked_count, checked_ids
from napari_unpack.unpacking import named

Group = tuple[int, ...]


class Session(SessionSteps):
    """A bag being unpacked: what is where, who leaves next, and the verbs that change it.

    Pure state: no window, no GL. Arguments as for `SessionCore`.

    Notes
    -----
    Li et al. 2012, section 5. Verbs that cannot do what they are told raise `ValueError` with a
    sentence and change nothing; what is merely already so is no error.
    """

    @cached_property
    def queries(self) -> Queries:
        """What is derived by casting rays, with its tasks."""
        return Queries(self)

    @cached_property
    def label_editor(self) -> LabelEditor:
        """The tasks that change labels."""
        return LabelEditor(self)

    def unpack(self, n_or_ids: int | Iterable[int] = 1) -> Group:
        """Take objects out of the bag.

        Parameters
        ----------
        n_or_ids : int or iterable of int
            How many from the head of the queue, or which objects. Objects that hold together
            leave together, so more may leave than were asked for.

        Returns
        -------
        tuple of int
            Who left, in order. Objects already outside or hidden are passed over.

        Raises
        ------
        NobodyFreeError
            If nobody is free and `take_least_occluded` is False (a ValueError).
        BlockedError
            If a chosen object is blocked by one that was not chosen (a ValueError).
        ValueError
            If an ID is unknown or the number is below 1.
        """
        if isinstance(n_or_ids, int | np.integer):
            count = checked_count(int(n_or_ids))
            situation, left = self._take_next(count, replace(self._situation, inspected=None))
        else:
            situation, left = self._take_chosen(checked_ids(n_or_ids, self._known, "n_or_ids"))
        if not left:
            self.events.message.emit("There is nothing left to unpack.")
            return ()
        self._do("unpack", situation)
        return left

    def reveal(
        self, object_id: int, direction: str | Sequence[float] | Vector | None = None
    ) -> Group:
        """Take out the smallest set of objects that frees a buried one, and it as well.

        Parameters
        ----------
        object_id : int
            A packed object.
        direction : str or (3,) sequence of float, optional
            Along which they leave: by default D, which stays as it is; "any" takes the one of
            26 along which the fewest leave (see `unearthing`).

        Returns
        -------
        tuple of int
            Who left, in order.

        Raises
        ------
        ValueError
            If the object is not packed, or there is no table of blockers.
        """
        object_id, packed = self._buried(object_id)
        situation = replace(self._situation, inspected=None)
        if direction is None:
            along = self.unpack_direction
        elif isinstance(direction, str):
            along = (
                named(direction) if direction != "any" else self.reveal_plan(object_id).direction
            )
        else:
            along = named(tuple(direction))
        answer = self.answer_along(along)
        if answer.blocking is None:
            raise NoTableError.of(len(packed))
        graph = answer.blocking.among(packed)
        left: list[int] = []
        for group in graph.removals(graph.needed(object_id)):
            situation = self._leave(situation, group, along, answer)
            left.extend(group)
        self._do("reveal", situation)
        return tuple(left)

    def force_unpack(self, object_id: int) -> None:
        """Take an object out whatever it meets, as the lid of a container is taken off.

        Raises
        ------
        ValueError
            If the object is not packed.
        """
        object_id, _ = self._buried(object_id)
        self._do("take off", self._leave(self._situation, (object_id,)))

    def restore(self, n_or_ids: int | Iterable[int] = 1) -> Group:
        """Put objects back into the bag, at the head of the queue.

        Parameters
        ----------
        n_or_ids : int or iterable of int
            How many of the latest, or which objects. Objects that left as a group return as
            one. Objects in the bag are passed over.

        Returns
        -------
        tuple of int
            Who returned, in order.

        Raises
        ------
        ValueError
            If an ID is unknown or the number is below 1.
        """
        situation = self._situation
        seen = [i for i in reversed(situation.out) if i not in situation.hidden]
        if isinstance(n_or_ids, int | np.integer):
            wanted = seen[: checked_count(int(n_or_ids))]
        else:
            chosen = set(checked_ids(n_or_ids, self._known, "n_or_ids"))
            wanted = [i for i in seen if i in chosen]
        mates = {mate for i in wanted for mate in situation.out[i].group}
        # A hidden one of a group returns with it, and stays hidden.
        back = [i for i in reversed(situation.out) if i in mates]
        if not back:
            self.events.message.emit("There is nothing to restore.")
            return ()
        if situation.inspected in mates:
            situation = replace(situation, inspected=None)
        # The one restored last was the first to leave, so it stands at the head.
        self._do("restore", situation.with_back(reversed(back)))
        return tuple(back)

    def inspect(self, object_id: int) -> None:
        """Look at one object alone; a flight of its own ends, another inspection too.

        Not undoable: looking changes nothing. Undo and redo end it.

        Raises
        ------
        ValueError
            If there is no such object, or it is hidden.
        """
        (object_id,) = checked_ids(object_id, self._known, "object_id")
        if object_id in self._situation.hidden:
            raise ValueError(f"{self._names([object_id])} is hidden: show it first")
        if object_id != self._situation.inspected:
            self._enter(replace(self._situation, inspected=object_id))

    def leave(self) -> None:
        """End the inspection: the object is again where it was."""
        if self._situation.inspected is not None:
            self._enter(replace(self._situation, inspected=None))

    def place(self, object_id: int, pose: Pose) -> None:
        """Put an unpacked object somewhere else in pivot space; successive moves are one step.

        Raises
        ------
        ValueError
            If it is not outside the bag.
        """
        placement = replace(self._outside(object_id), placed=pose, within=self.slots.window_mm)
        if not np.array_equal(placement.rotation, pose.rotation):
            picture = self.bag.picture(object_id, pose.rotation, self._camera.stretch)
            placement = placement.turned(pose.rotation, picture)
        out = {**self._situation.out, object_id: placement}
        self._do(f"move {object_id}", replace(self._situation, out=out), merge=True)

    def pose_turned(self, object_id: int, rotation: Matrix) -> Pose:
        """Return the pose an unpacked object would have, held another way in its place.

        Its picture keeps its size, unless it would stand out of its place so.

        Raises
        ------
        ValueError
            If it is not outside the bag.
        """
        return self._pose(self._turned(object_id, rotation))

    def turn(self, object_id: int, rotation: Matrix) -> None:
        """Hold an unpacked object another way; successive turns and moves are one step.

        Parameters
        ----------
        object_id : int
        rotation : (3, 3) ndarray of float64
            From (stretched) world axes to pivot axes.

        Raises
        ------
        ValueError
            If it is not outside the bag.
        """
        placement = self._turned(object_id, rotation)
        out = {**self._situation.out, object_id: placement}
        self._do(f"move {object_id}", replace(self._situation, out=out), merge=True)

    def _turned(self, object_id: int, rotation: Matrix) -> Placement:
        placement = self._outside(object_id)
        picture = self.bag.picture(object_id, rotation, self._camera.stretch)
        return placement.turned(rotation, picture)

    def _outside(self, object_id: int) -> Placement:
        (object_id,) = checked_ids(object_id, self._known, "object_id")
        if object_id not in self._situation.out:
            raise ValueError(f"{self._names([object_id])} is not unpacked: unpack it first")
        return self._situation.out[object_id]

    def scene(self) -> Scene:
        """Return what images show of this session now; cheap, on the main thread."""
        return self._scene_description.of(self)

    @cached_property
    def _scene_description(self) -> SceneDescription:
        return SceneDescription()

    def _forget_answers(self) -> None:
        super()._forget_answers()
        self._answer = self._other_answer = self._credited = self._survey = None
        self._glimpse = None
        self.__dict__.pop("bag_up", None)

    def _take_chosen(self, ids: list[int]) -> tuple[SessionState, Group]:
        situation = replace(self._situation, inspected=None)
        packed = self._packed(situation)
        wanted = packed.intersection(ids)
        if not wanted:
            return situation, ()
        glimpse = self._seen_free(situation, wanted)
        if glimpse is not None:
            for group in glimpse.groups:
                situation = self._leave(situation, group, answer=glimpse)
            return situation, tuple(i for (i,) in glimpse.groups)
        answer = self._known_answer(packed)
        if answer.blocking is None:
            if wanted - answer.free:
                answer = self._known_answer(packed, afresh=True)
            blocked = wanted - answer.free
            if blocked:
                raise BlockedError(f"{self._names(blocked)} cannot leave: other objects block it.")
            groups: list[Group] = [(i,) for i in ids if i in wanted]
        else:
            graph = answer.blocking.among(packed)
            whole = [set(g) for g in graph.removals(packed) if wanted.intersection(g)]
            wanted = wanted.union(*(g for g in whole if len(g) <= self.max_group_size))
            blockers = graph.blockers(wanted)
            if blockers and wanted != {*self._least_if_stuck(packed, answer)}:
                raise BlockedError(
                    f"{self._names(wanted)} cannot leave along this direction before "
                    f"{self._names(blockers)}: unpack those first, reveal it, or choose another "
                    "direction."
                )
            groups = graph.removals(wanted)
        for group in groups:
            situation = self._leave(situation, group)
        return situation, tuple(i for group in groups for i in group)

    def _least_if_stuck(self, packed: frozenset[int], answer: OcclusionAnswer) -> Group:
        if not self.take_least_occluded or answer.groups(packed, self.max_group_size):
            return ()
        return (self._known_answer(packed, afresh=True).least_occluded(packed),)
