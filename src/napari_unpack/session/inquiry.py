"""What a session asks the ray casters, and the answers it keeps."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from napari_unpack.geometry.axes import Vector
from napari_unpack.session.asking import OcclusionAnswer, OcclusionQuestion, view_along
from napari_unpack.session.directions import SessionDirections
from napari_unpack.session.errors import listed
from napari_unpack.session.revealing import RevealAnswer, RevealQuestion
from napari_unpack.session.validation import checked_ids
from napari_unpack.unpacking.direction_survey import RevealPlan


class SessionInquiry(SessionDirections):
    """Who blocks whom along D and along the direction asked for last."""

    _other_answer: OcclusionAnswer | None = None

    def least_occluded_object(self) -> tuple[int, float] | None:
        """Return who is blocked least along D and how much of it, None while that is unknown."""
        packed, known = self._packed(self._situation), self._answer
        if known is None or not packed or not known.serves(self.unpack_direction, packed):
            return None
        least = known.least_occluded(packed)
        return least, float(known.first_hit.get(least, 0.0))

    def reveal_plan(self, object_id: int) -> RevealPlan:
        """Return the least that must leave for a buried object to leave, and along which way.

        Of D and 26 directions; ties go to D. Casts rays where that is not known yet.

        Raises
        ------
        ValueError
            If the object is not packed, or there is no table of blockers.
        """
        answer = self.reveal_question(object_id).answer()
        self.accept_reveal(answer)
        return answer.unearthing

    def reveal_question(self, object_id: int) -> RevealQuestion:
        """Return the question `unearthing` asks, to be answered on another thread."""
        object_id, packed = self._buried(object_id)
        question = self.survey_question()
        known = self._survey if question is None else None
        return RevealQuestion(
            object_id,
            packed,
            self.unpack_direction,
            known,
            question,
            lambda direction: self._question(packed, direction),
        )

    def accept_reveal(self, answer: RevealAnswer) -> bool:
        """Keep what was learnt; return False where somebody has come back meanwhile."""
        self._other_answer = answer.along
        return self.accept_survey(answer.survey)

    def _names(self, ids: Iterable[int]) -> str:
        names = self.objects["name"]
        return listed(str(names[i]) for i in sorted(ids))

    def _buried(self, object_id: int) -> tuple[int, frozenset[int]]:
        (object_id,) = checked_ids(object_id, self._known, "object_id")
        packed = self._packed(self._situation)
        if object_id not in packed:
            raise ValueError(f"{self._names([object_id])} is not in the bag: put it back first")
        return object_id, packed

    def answer_along(self, direction: Vector) -> OcclusionAnswer:
        """Return who is free, and who blocks whom, along any direction; kept for the last asked.

        With the direction the session has, this is the answer its queue goes by.
        """
        packed = self._packed(self._situation)
        if np.allclose(direction, self.unpack_direction, rtol=0, atol=1e-6):
            return self._known_answer(packed)
        known = self._other_answer
        fits = known is not None and known.criterion == self.criterion
        if known is None or not (fits and known.serves(direction, packed)):
            known = self._other_answer = self._question(packed, direction).answer()
        return known

    def _question(self, packed: frozenset[int], direction: Vector) -> OcclusionQuestion:
        pitch = float(self.spacing.min())
        lower, upper = self.bag.lower, self.bag.upper
        camera, size = view_along(direction, lower, upper, pitch, self._camera)
        visible, casters = self._table(packed), self.casters
        pull = casters.pull
        return OcclusionQuestion(
            direction,
            packed,
            self.rule,
            self.tolerance,
            lambda: casters.occlusion(camera, visible, size),
            None if pull is None else lambda pulled: pull(direction, visible, pulled),
            self._edition,
        )

    def _known_answer(self, packed: frozenset[int], afresh: bool = False) -> OcclusionAnswer:
        direction, known = self.unpack_direction, self._answer
        if (
            known is None
            or not known.serves(direction, packed)
            or (afresh and known.packed != packed)
        ):
            known = self._answer = self._question(packed, direction).answer()
        return known
