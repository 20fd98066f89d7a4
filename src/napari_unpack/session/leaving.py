"""Who leaves next, and where to: the queue of a session and the departures from it."""

from __future__ import annotations

from dataclasses import replace

from napari_unpack.geometry.axes import Vector
from napari_unpack.session.asking import OcclusionAnswer, OcclusionQuestion
from napari_unpack.session.errors import NobodyFreeError, share_of
from napari_unpack.session.events import LogEntry
from napari_unpack.session.glimpse import NextUnpackable, SessionGlimpses
from napari_unpack.session.state import Placement, SessionState
from napari_unpack.unpacking import Queue

Group = tuple[int, ...]


class SessionLeaving(SessionGlimpses):
    """The queue, filled from what the ray casters answer, and the departures from its head."""

    _credited: OcclusionAnswer | NextUnpackable | None = None
    _told_stuck: tuple[object, object] | None = None

    @property
    def log(self) -> list[LogEntry]:
        """Every departure so far."""
        return self.__dict__.setdefault("_log", [])

    @property
    def queue(self) -> Queue:
        """The queue as it stands; `unpackable` brings it up to date."""
        return self._situation.queue

    def unpackable(self) -> Group:
        """Return the objects that can leave now, the next one first; casts rays if it must.

        Where nobody is free that is the least occluded object, or nobody, as
        `take_least_occluded` says.
        """
        queue = self._filled_queue(self._situation)[0]
        if queue is not self._situation.queue:
            self._enter(replace(self._situation, queue=queue))
        return queue.ids

    def unpackable_groups(self) -> tuple[Group, ...]:
        """Return who can leave now as far as that is known, groups whole; casts no rays.

        The queue is used up before it is asked anew, so it may hold fewer.
        """
        packed, answer = self._packed(self._situation), self._answer
        fits = answer is not None and answer.criterion == self.criterion
        if answer is not None and fits and answer.serves(self.unpack_direction, packed):
            return tuple(answer.groups(packed, self.max_group_size))
        queue = self._situation.queue
        known = queue.along(self.unpack_direction) and not queue.least_occluded
        return queue.groups if known else ()

    def occlusion_question(self) -> OcclusionQuestion | None:
        """Return the question `unpackable` would have to ask; None where the answer is known.

        Its `answer()` may run on another thread; hand the result to `accept_answer`.
        """
        packed, d = self._packed(self._situation), self.unpack_direction
        known = self._answer is not None and self._answer.serves(d, packed)
        return None if known or not packed else self._question(packed, d)

    def accept_answer(self, answer: OcclusionAnswer) -> bool:
        """Take over an answer; return False, having done nothing, where it is out of date."""
        fits = answer.serves(self.unpack_direction, self._packed(self._situation))
        if not fits or answer.criterion != self.criterion or answer.edition != self._edition:
            return False
        self._answer = answer
        self.unpackable()
        return True

    def _filled_queue(self, situation: SessionState) -> tuple[Queue, OcclusionAnswer | None]:
        """Return the queue, filled where it was dry or for another D, and the answer used."""
        packed, direction = self._packed(situation), self.unpack_direction
        if situation.queue.serves(direction, packed, self._terms):
            return situation.queue, self._answer
        if not packed:
            return situation.queue.refilled((), direction, packed, rules=self._terms), self._answer
        answer = self._known_answer(packed)
        groups = answer.groups(packed, self.max_group_size)
        if not groups:
            answer = self._known_answer(packed, afresh=True)
            groups = answer.groups(packed, self.max_group_size)
        least = not groups and self.take_least_occluded
        if least:
            groups = [(answer.least_occluded(packed),)]
        depths = self.bag.depths(direction)
        queue = situation.queue.refilled(groups, direction, packed, depths, least, self._terms)
        return queue, answer

    def _take_next(self, count: int, situation: SessionState) -> tuple[SessionState, Group]:
        """Return the situation after the next so many have left, and who they were."""
        left: list[int] = []
        glimpse = self._seen(situation, count)
        if glimpse is not None:
            stale = replace(situation.queue, groups=(), least_occluded=False)
            situation = replace(situation, queue=stale)
            for group in glimpse.groups:
                if len(left) < count:
                    situation = self._leave(situation, group, answer=glimpse)
                    left.extend(group)
        while len(left) < count:
            packed = self._packed(situation)
            if not packed:
                break
            queue, answer = self._filled_queue(situation)
            if not queue.groups:
                if left:
                    break
                raise NobodyFreeError(
                    f"No object is unpackable in this direction; {self._stuck(answer, packed)}. "
                    "Choose another direction, or unpack the least occluded object."
                )
            if queue.least_occluded:
                self._tell_stuck(answer, packed, situation)
            situation = replace(situation, queue=queue)
            least = queue.least_occluded
            situation = self._leave(situation, queue.groups[0])
            self._told_stuck = (situation.out, situation.direction) if least else None
            left.extend(queue.groups[0])
        return situation, tuple(left)

    def _leave(
        self,
        situation: SessionState,
        group: Group,
        along: Vector | None = None,
        answer: OcclusionAnswer | NextUnpackable | None = None,
    ) -> SessionState:
        taken = {placement.slot for placement in situation.out.values()}
        places = iter(k for k in range(self._most) if k not in taken)
        camera = self._camera
        direction = self.unpack_direction if along is None else along
        placements: dict[int, Placement] = {
            i: self.bag.placement(i, next(places), group, direction, camera) for i in group
        }
        answer, ratio = answer or self._answer, 0.0
        # The first to leave by an answer stands for its rays, wherever they were cast.
        asked, self._credited = answer is not self._credited, answer
        if isinstance(answer, OcclusionAnswer) and situation.queue.least_occluded:
            ratio = answer.first_hit.get(group[0], 0.0)
        self.log.append(
            LogEntry(
                "query run" if asked else "queue reuse",
                group,
                len(self._packed(situation)),
                ratio,
                answer.seconds if asked and answer else 0.0,
            )
        )
        return situation.with_out(placements)

    def _tell_stuck(
        self, answer: OcclusionAnswer | None, packed: frozenset[int], situation: SessionState
    ) -> None:
        """Say that the least occluded object leaves; once, while one such after another does."""
        told = self._told_stuck
        if told is None or told[0] is not situation.out or told[1] != situation.direction:
            stuck = self._stuck(answer, packed)
            self.events.message.emit(
                f"No object is unpackable in this direction; {stuck}: it leaves."
            )

    def _stuck(self, answer: OcclusionAnswer | None, packed: frozenset[int]) -> str:
        least = answer.least_occluded(packed) if answer else min(packed)
        ratio = answer.first_hit.get(least, 0.0) if answer else 0.0
        return f"{self._names([least])} is the least occluded ({share_of(ratio)} hidden)"
