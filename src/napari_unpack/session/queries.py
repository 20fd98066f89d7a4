"""What is derived from a session by casting rays: tasks for workers, and where results are kept."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Literal

from napari_unpack.session.directions import DirectionSurvey
from napari_unpack.tasks import Task, no_progress
from napari_unpack.unpacking.direction_survey import RevealPlan

if TYPE_CHECKING:
    from napari_unpack.session.session import Session


class Queries:
    """The questions of a session; each has a task for a worker, and `store` takes its result.

    Parameters
    ----------
    session : Session
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._plan: tuple[Any, RevealPlan] | None = None

    def occlusion_task(self) -> Task[Any] | None:
        """Return the task that finds who can leave along D; None where that is known."""
        question = self._session.occlusion_question()
        return None if question is None else Task(question, lambda _: question.answer())

    def hues_task(self, keep: bool = True) -> Task[Any] | None:
        """Return the task that chooses hues for this view; None where they are known."""
        question = self._session.hue_question(keep)
        return Task(question, lambda _: question.answer())

    def next_unpackable_task(
        self, n_or_ids: int | Iterable[int] = 1, seconds: float = float("inf")
    ) -> Task[Any] | None:
        """Return the task that finds enough to unpack so many or these, in limited time.

        None where that is known, or where the rules want all of `occlusion_task`. Its result is
        None where the time did not suffice.
        """
        question = self._session.glimpse_question(n_or_ids)
        return None if question is None else Task(question, lambda _: question.answer(seconds))

    def survey_task(self) -> Task[DirectionSurvey] | None:
        """Return the task that looks along 26 directions; None where that is known."""
        question = self._session.survey_question()
        return None if question is None else Task(question, question.answer)

    def reveal_plan_task(self, object_id: int) -> Task[Any] | None:
        """Return the task that finds the least that frees a buried object; None where known."""
        question = self._session.reveal_question(object_id)
        return Task(question, question.answer)

    def reveal_plan(self, object_id: int) -> RevealPlan:
        """Return the least that must leave for a buried object to leave."""
        task = self.reveal_plan_task(object_id)
        if self._plan is None or self._plan[1].target != object_id:
            assert task is not None
            self.store(task, task.run(no_progress))
        assert self._plan is not None
        return self._plan[1]

    def labels_task(self, way: Literal["undo", "redo"]) -> Task[Any] | None:
        """Return the task that works out the labels after undo or redo; None where known."""
        question = self._session.labels_question(way)
        return None if question is None else Task(question, lambda _: question.answer())

    def store(self, task: Task[Any], result: Any) -> bool:
        """Keep the result of a task; return False where it no longer serves."""
        if result is None:
            return False
        session, kind = self._session, type(task.key).__name__
        if kind == "OcclusionQuestion":
            return session.accept_answer(result)
        if kind == "GlimpseQuestion":
            return session.accept_glimpse(result)
        if kind == "SurveyQuestion":
            return session.accept_survey(result)
        if kind == "RevealQuestion":
            self._plan = task.key, result.unearthing
            return session.accept_reveal(result)
        if kind == "HueQuestion":
            session.__dict__["_hues_found"] = result
            return True
        session.accept_labels(result)
        return True
