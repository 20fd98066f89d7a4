"""The packed picture is right whatever order the pictures that were asked for come in."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import napari_unpack as nu
from napari_unpack.layers.view_camera import Frame
from napari_unpack.viewer.packed_renderer import PackedRenderer, cast_packed

SIZE = (220, 260)


class ByHand:
    """Jobs that start and end when the test says so; as `jobs.Jobs`, one a lane at a time."""

    def __init__(self) -> None:
        self.waiting: dict[tuple[str, str], tuple[Callable[[], Any], Callable[[Any], None]]] = {}
        self.running: dict[str, tuple[str, Callable[[], None]]] = {}

    def ask(self, lane: str, key: str, work: Any, then: Any) -> None:
        self.waiting[lane, key] = work, then

    def has(self, key: str) -> bool:
        waits = any(name == key for _, name in self.waiting)
        return waits or any(name == key for name, _ in self.running.values())

    @property
    def turning(self) -> bool:
        runs = self.running.get("quick", ("",))[0] == "packed"
        return runs or ("quick", "packed") in self.waiting

    def start(self, lane: str, key: str) -> None:
        assert lane not in self.running
        work, then = self.waiting.pop((lane, key))
        result = work()
        self.running[lane] = key, lambda: then(result)

    def end(self, lane: str) -> None:
        _, deliver = self.running.pop(lane)
        deliver()

    def end_all(self) -> None:
        """Let everything run to its end."""
        while self.waiting or self.running:
            for lane, key in list(self.waiting):
                if lane not in self.running and (lane, key) in self.waiting:
                    self.start(lane, key)
            for lane in list(self.running):
                self.end(lane)


class Screen:
    """Shows a picture and knows nothing else of a layer."""

    visible, drawn, shot = True, True, None

    def show(self, shot: Any, before: Any = None, resting: bool = True) -> None:
        self.shot = shot

    def come_to_rest(self) -> None:
        pass

    def mix(self, part: float) -> None:
        raise AssertionError("nothing is recoloured here")


class NoStudio:
    """A canvas without shaders worth it."""

    active = False


@pytest.fixture
def still(session, qtbot) -> Any:
    """Return (painter, jobs, screen, frame) with a full picture shown and nothing under way."""
    jobs, screen = ByHand(), Screen()
    painter = PackedRenderer(session, jobs, screen, NoStudio())
    session.canvas_size = SIZE
    # Along z objects 1, 2 and 3 stand side by side.
    session.view = nu.View((1.0, 0.0, 0.0))
    frame = Frame(session.overview(), SIZE, np.eye(4))
    painter.look(frame)
    jobs.end_all()
    qtbot.waitUntil(lambda: painter._is_fine() or bool(jobs.waiting), timeout=10000)
    jobs.end_all()
    assert painter.settled
    yield painter, jobs, screen, frame
    painter.close()


def hide(session: Any, painter: PackedRenderer, object_id: int) -> None:
    session.hide([object_id])
    painter.recast_objects([object_id])


def test_three_changes_while_the_picture_of_the_first_is_cast(still, session) -> None:
    painter, jobs, screen, frame = still
    before = screen.shot.patch.rgba
    hide(session, painter, 1)
    jobs.start("quick", "packed window")
    hide(session, painter, 2)
    jobs.end("quick")
    hide(session, painter, 3)
    jobs.end_all()
    assert painter.settled
    wanted = cast_packed(session.scene(), frame.camera, SIZE, 1.0).patch.rgba
    assert np.abs(wanted - before).max() > 0.5
    np.testing.assert_allclose(screen.shot.patch.rgba, wanted, atol=1 / 255)


@pytest.mark.parametrize("seed", range(12))
def test_changes_and_pictures_in_any_order(still, session, seed) -> None:
    painter, jobs, screen, frame = still
    rng = np.random.default_rng(seed)
    hidden: set[int] = set()
    for _ in range(30):
        what = rng.integers(4)
        if what == 0:
            one = int(rng.choice(session.ids))
            (session.show if one in hidden else session.hide)([one])
            hidden ^= {one}
            painter.recast_objects([one])
        elif what == 1 and jobs.waiting:
            lane, key = list(jobs.waiting)[rng.integers(len(jobs.waiting))]
            if lane not in jobs.running:
                jobs.start(lane, key)
        elif what == 2 and jobs.running:
            jobs.end(list(jobs.running)[rng.integers(len(jobs.running))])
        elif what == 3 and rng.random() < 0.2:
            painter.recast()
    jobs.end_all()
    if not painter._is_fine():
        painter._come_to_rest()
        jobs.end_all()
    assert painter.settled
    wanted = cast_packed(session.scene(), frame.camera, SIZE, 1.0)
    if wanted is None:
        assert screen.shot is None
    else:
        np.testing.assert_allclose(screen.shot.patch.rgba, wanted.patch.rgba, atol=1 / 255)


def test_while_slow_pictures_of_a_turn_are_cast_nothing_is_refined(still, session) -> None:
    painter, jobs, _, _ = still
    painter._rays = 100.0
    session.view = nu.View((1.0, 0.2, 0.0))
    painter.look(Frame(session.overview(), SIZE, np.eye(4)))
    for _ in ("waiting", "running"):
        painter._come_to_rest()
        assert ("fine", "packed") not in jobs.waiting
        if jobs.waiting:
            jobs.start("quick", "packed")
    jobs.end("quick")
    painter._come_to_rest()
    assert ("fine", "packed") in jobs.waiting
    jobs.end_all()
    assert painter.settled
