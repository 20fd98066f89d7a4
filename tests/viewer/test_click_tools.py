"""Split and Ruler where a repair or an undo comes between their clicks."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bells import BELL, CUBE, SLAB, bells
from napari_unpack.session import Session
from napari_unpack.viewer.ruler_tool import RulerTool
from napari_unpack.viewer.split_tool import SplitTool


class Hand:
    """Clicks on voxels of a session, with a tool that is made for a stand-in of a controller."""

    def __init__(self) -> None:
        self.session = Session(*bells())
        self.told: list[str] = []
        self.done: list[Any] = []
        self.controller: Any = SimpleNamespace(
            session=self.session,
            interaction=SimpleNamespace(tool=None),
            rulers=SimpleNamespace(pending=()),
        )

    def take(self, tool: type, *given: Any) -> None:
        tool(self.controller, *given, self.told.append, self.done.append)

    def click(self, object_id: int, last: bool = False) -> tuple[int, ...]:
        """Click the first voxel of an object, or its last; return it."""
        voxel = np.argwhere(self.session.labels == object_id)[-1 if last else 0]
        self.controller.interaction.tool.click_voxel(voxel.astype(float))
        return tuple(voxel.tolist())


@pytest.fixture
def hand() -> Hand:
    return Hand()


def test_a_split_goes_on_in_what_the_first_click_is_on_now(hand: Hand) -> None:
    hand.take(SplitTool)
    first = hand.click(CUBE)
    kept = hand.session.merge([BELL, CUBE])
    second = hand.click(kept, last=True)
    assert hand.done == [(kept, first, second)]
    assert hand.session.label_editor.split_task(*hand.done[0])


def test_a_split_begins_anew_where_the_object_of_its_first_click_is_gone(hand: Hand) -> None:
    hand.take(SplitTool)
    hand.click(SLAB)
    hand.session.delete([SLAB])
    first = hand.click(CUBE)
    assert hand.done == []
    assert hand.told[-1].startswith("Now click the other part of ")
    second = hand.click(CUBE, last=True)
    assert hand.done == [(CUBE, first, second)]


def test_a_length_is_measured_from_what_the_first_click_is_on_now(hand: Hand) -> None:
    session = hand.session
    hand.take(RulerTool, 3)
    hand.click(CUBE)
    kept = session.merge([BELL, CUBE])
    hand.click(SLAB)
    session.delete([SLAB])
    hand.click(kept, last=True)
    (points,) = hand.done
    assert [point.object_id for point in points] == [kept, 0, kept]
    assert session.measurements.add(points).angle is not None
    # What undo brings back has its point again.
    hand.take(RulerTool, 2)
    hand.click(kept)
    session.undo()
    session.undo()
    assert SLAB in session.ids
    hand.click(SLAB)
    assert [point.object_id for point in hand.done[-1]] == [kept, SLAB]
