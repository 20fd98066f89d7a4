"""Which way objects leave: D, the best of 26 directions, and the least that frees an object."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from time import perf_counter

import numpy as np

from napari_unpack.geometry.axes import Vector, unit
from napari_unpack.geometry.occlusion_counts import OcclusionCounts
from napari_unpack.geometry.view import GRAVITY_UP
from napari_unpack.session.asking import view_along
from napari_unpack.session.criteria import SessionCriteria
from napari_unpack.session.state import SessionState
from napari_unpack.tasks import Progress
from napari_unpack.unpacking import bag_up, named, oriented_box, towards_viewer
from napari_unpack.unpacking.direction_survey import (
    DIRECTIONS_26,
    BestDirection,
    DirectionalBlocking,
)
from napari_unpack.unpacking.direction_survey import (
    best_direction as best_of,
)

MOST_SURVEY_RAYS = 512
"""Most rays along one side of a survey's picture: it proposes; what leaves is asked anew."""


@dataclass(frozen=True, eq=False)
class DirectionSurvey:
    """Who blocks whom along every direction of the compass.

    Parameters
    ----------
    packed : frozenset of int
        Objects that were in the bag.
    outlooks : tuple of DirectionalBlocking
        Empty where there are too many objects for a table.
    seconds : float
        What it took.
    tolerance : float
        It was asked with.
    edition : int
        Of the labels.
    """

    packed: frozenset[int]
    outlooks: tuple[DirectionalBlocking, ...]
    seconds: float
    tolerance: float = 0.0
    edition: int = 0


@dataclass(frozen=True, eq=False)
class SurveyQuestion:
    """The question who blocks whom along every direction of the compass.

    Parameters
    ----------
    packed : frozenset of int
        Objects in the bag.
    tolerance : float
        See `unpacking.unpackable_ids`.
    cast : callable
        Given D, returns the counts along it.
    edition : int
        Of the labels.
    """

    packed: frozenset[int]
    tolerance: float
    cast: Callable[[Vector], OcclusionCounts]
    edition: int = 0

    def answer(self, progress: Progress | None = None) -> DirectionSurvey:
        """Cast the rays; may run on any thread.

        Notes
        -----
        A ray looked along the other way meets the same objects in the opposite order, so half
        of the compass is cast. With a tolerance, who is free within it is counted along each
        direction, and all of it is cast.
        """
        start = perf_counter()
        halved = self.tolerance == 0.0
        directions = DIRECTIONS_26[: len(DIRECTIONS_26) // 2] if halved else DIRECTIONS_26
        found: list[DirectionalBlocking] = []
        for k, direction in enumerate(directions):
            if progress is not None:
                progress(k / len(directions), "Looking for a way out")
            counts = self.cast(direction)
            outlook = DirectionalBlocking.of(direction, counts, self.packed, self.tolerance)
            if outlook is None:
                break
            found += [outlook, outlook.opposite()] if halved else [outlook]
        return DirectionSurvey(
            self.packed, tuple(found), perf_counter() - start, self.tolerance, self.edition
        )


class SessionDirections(SessionCriteria):
    """D, the direction in which objects leave, and what is known of others.

    Notes
    -----
    A survey serves while nobody comes back who was away when it was made: taking objects out
    takes their rows and columns out of its tables and changes no other. It does not hang on the
    view, so that turning the bag asks nothing anew.
    """

    _survey: DirectionSurvey | None = None
    _away_from_table: Vector = np.array(GRAVITY_UP)

    @property
    def away_from_table(self) -> Vector:
        """What is up: unit vector in world, by default -y; a viewer sets what it shows as up.

        Where the bag is shown stretched or mirrored it is the normal of what lies level there.
        """
        return self._away_from_table

    @away_from_table.setter
    def away_from_table(self, up: Sequence[float] | Vector) -> None:
        self._away_from_table = unit(up, "away_from_table")
        self.__dict__.pop("bag_up", None)

    @property
    def direction(self) -> str | tuple[float, float, float] | None:
        """D as asked for: None (opposite of the view), "up" (the bag's), or world (z, y, x)."""
        return self._situation.direction

    @direction.setter
    def direction(self, direction: str | Sequence[float] | None) -> None:
        wanted: str | tuple[float, float, float] | None
        if direction is None or (isinstance(direction, str) and direction == "view"):
            wanted = None
        elif isinstance(direction, str) and direction == "up":
            wanted = "up"
        else:
            z, y, x = (float(v) for v in named(direction))
            wanted = (z, y, x)
        if wanted != self._situation.direction:
            self._do("direction", replace(self._situation, direction=wanted))

    @property
    def unpack_direction(self) -> Vector:
        """D now: unit vector in world, along which objects leave."""
        wanted = self._situation.direction
        if wanted is None:
            return towards_viewer(self._camera)
        return self.bag_up if isinstance(wanted, str) else np.array(wanted)

    @cached_property
    def bag_up(self) -> Vector:
        """Up of the bag as it lies on its largest face, unit vector in world."""
        z, y, x = (float(v) for v in self._away_from_table)
        return bag_up(oriented_box(self.bag.outer_points(), self.spacing), (z, y, x))

    def _packed(self, situation: SessionState) -> frozenset[int]:
        """Return who stands in the way.

        What is on its way back counts as being there, and so does what is looked at alone: it
        goes back where it was.
        """
        return self._known.difference(situation.out, situation.hidden)

    def survey_question(self) -> SurveyQuestion | None:
        """Return the question `way_out` and `reveal` rest on; None where it is answered.

        Its `answer()` may run on another thread; hand the result to `accept_survey`.
        """
        packed, known = self._packed(self._situation), self._survey
        serves = known is not None and packed <= known.packed and self._asked_so(known)
        if not packed or serves:
            return None
        visible, cast = self._table(packed), self.casters.occlusion
        lower, upper, camera = self.bag.lower, self.bag.upper, self._camera
        pitch = max(
            float(self.spacing.min()), float(np.linalg.norm(upper - lower)) / MOST_SURVEY_RAYS
        )

        def counts(direction: Vector) -> OcclusionCounts:
            looking, size = view_along(direction, lower, upper, pitch, camera)
            return cast(looking, visible, size)

        return SurveyQuestion(packed, self.tolerance, counts, self._edition)

    def accept_survey(self, survey: DirectionSurvey) -> bool:
        """Take over a survey; return False where somebody has come back meanwhile."""
        if not (self._packed(self._situation) <= survey.packed and self._asked_so(survey)):
            return False
        self._survey = survey
        return True

    def best_direction(self, ask: bool = False) -> BestDirection | None:
        """Return the direction of 26 along which the most objects can leave now.

        Parameters
        ----------
        ask : bool
            Cast rays where that is not known yet; else None is returned then.

        Returns
        -------
        BestDirection or None
            None also where nobody is free along any of them. Ties go to the one nearest D.
        """
        survey = self._known_survey(ask)
        if survey is None:
            return None
        packed = self._packed(self._situation)
        return best_of(survey.outlooks, packed, self.max_group_size, self.unpack_direction)

    def _asked_so(self, survey: DirectionSurvey) -> bool:
        return survey.tolerance == self.tolerance and survey.edition == self._edition

    def _known_survey(self, ask: bool) -> DirectionSurvey | None:
        question = self.survey_question()
        if question is not None and ask:
            self._survey = question.answer()
        elif question is not None:
            return None
        return self._survey
