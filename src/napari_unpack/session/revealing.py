"""The question how a buried object is freed: by whom leaving, and along which direction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from napari_unpack.geometry.axes import Vector
from napari_unpack.session.asking import OcclusionAnswer, OcclusionQuestion
from napari_unpack.session.directions import DirectionSurvey, SurveyQuestion
from napari_unpack.session.errors import NoTableError
from napari_unpack.tasks import Progress
from napari_unpack.unpacking.direction_survey import RevealPlan, smallest_reveal_plan


@dataclass(frozen=True, eq=False)
class RevealAnswer:
    """How a buried object is freed, and what was learnt on the way.

    Parameters
    ----------
    unearthing : RevealPlan
        Who must leave along which direction, as the voxels say.
    survey : DirectionSurvey
        Of all directions.
    along : OcclusionAnswer
        Who blocks whom along that one.
    """

    unearthing: RevealPlan
    survey: DirectionSurvey
    along: OcclusionAnswer


@dataclass(frozen=True, eq=False)
class RevealQuestion:
    """The question how a buried object is freed.

    Parameters
    ----------
    target : int
        The buried object.
    packed : frozenset of int
        Objects in the bag.
    near : (3,) ndarray of float64
        D, which takes part and wins ties.
    known : DirectionSurvey, optional
        A survey that serves.
    survey : SurveyQuestion, optional
        The question where there is none.
    along : callable
        Given a direction, returns the question along it at the voxel pitch.
    """

    target: int
    packed: frozenset[int]
    near: Vector
    known: DirectionSurvey | None
    survey: SurveyQuestion | None
    along: Callable[[Vector], OcclusionQuestion]

    def answer(self, progress: Progress | None = None) -> RevealAnswer:
        """Look along all directions, and closely along D and the best; may run on any thread.

        Raises
        ------
        NoTableError
            If there are too many objects, or the rule has no table of blockers.
        """
        survey = self.known
        if survey is None:
            assert self.survey is not None
            survey = self.survey.answer(progress)
        if not survey.outlooks:
            raise NoTableError.of(len(self.packed))
        best = smallest_reveal_plan(survey.outlooks, self.packed, self.target, self.near)
        found = []
        for direction in (self.near, best.direction):
            answer = self.along(direction).answer()
            if answer.blocking is None:
                raise NoTableError.of(len(self.packed))
            ids = frozenset(answer.blocking.among(self.packed).needed(self.target))
            found.append((replace(best, direction=direction, ids=ids), answer))
        least, along = min(found, key=lambda pair: len(pair[0].ids))
        return RevealAnswer(least, survey, along)
