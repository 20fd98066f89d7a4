"""Questions wait until nothing moves, however slow the pictures are."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from napari_unpack.tasks import Task
from napari_unpack.viewer.background_queries import AtRest


class Lanes:
    """Jobs that only remember what they were asked."""

    def __init__(self) -> None:
        self.turning = True
        self.asked: list[str] = []

    def ask(self, lane: str, key: str, work: Any, then: Any) -> None:
        self.asked.append(key)


def test_nothing_is_asked_while_the_picture_of_a_turn_is_on_its_way(qtbot: Any) -> None:
    task = Task("nothing", lambda progress: None)
    queries = SimpleNamespace(occlusion_task=lambda: task, hues_task=lambda: task)
    session = SimpleNamespace(flights={}, queries=queries)
    jobs = Lanes()
    resting = AtRest(session, jobs, lambda: True, lambda: None)
    resting.moved()
    resting._timer.setInterval(1)
    resting._ask()
    assert jobs.asked == []
    assert resting.waiting
    jobs.turning = False
    qtbot.waitUntil(lambda: jobs.asked == ["queue", "hues"], timeout=10_000)
    assert not resting.waiting
    resting.close()
