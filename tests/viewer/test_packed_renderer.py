"""The packed image is right whatever order the images that were asked for come in."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest

import napari_unpack as nu
from manual_scheduler import ManualScheduler
from napari_unpack.layers.view_camera import Frame
from napari_unpack.viewer import packed_renderer
from napari_unpack.viewer.packed_renderer import PackedRenderer, cast_packed
from napari_unpack.viewer.scheduler import IdlePhase, Scheduler, Worker

SIZE = (220, 260)


class Screen:
    """Shows a picture and knows nothing else of a layer."""

    visible, drawn, image = True, True, None

    def frame_now(self) -> None:
        return None

    def show(self, image: Any, before: Any = None, with_thumbnail: bool = True) -> None:
        self.image = image

    def update_thumbnail(self) -> None:
        pass

    def mix(self, part: float) -> None:
        raise AssertionError("nothing is recoloured here")


class NoCanvasBackend:
    """A canvas without shaders worth it."""

    active = False


@pytest.fixture
def still(session, qtbot) -> Any:
    """Return (renderer, scheduler, screen, frame) with a full image shown, nothing under way."""
    scheduler, screen = ManualScheduler(), Screen()
    renderer = PackedRenderer(session, scheduler, screen, NoCanvasBackend())
    session.canvas_size = SIZE
    # Along z objects 1, 2 and 3 stand side by side.
    session.view = nu.View((1.0, 0.0, 0.0))
    frame = Frame(session.overview(), SIZE, np.eye(4))
    renderer.set_view(frame)
    scheduler.finish_tasks()
    settle(scheduler)
    assert renderer.settled
    yield renderer, scheduler, screen, frame
    renderer.close()


def settle(scheduler: ManualScheduler) -> None:
    """Let everything that was asked for, and the full image after it, come."""
    scheduler.finish_tasks()
    scheduler.advance(1000)
    scheduler.finish_tasks()


def hide(session: Any, renderer: PackedRenderer, object_id: int) -> None:
    session.hide([object_id])
    renderer.recast_objects([object_id])


def test_three_changes_while_the_picture_of_the_first_is_cast(still, session) -> None:
    renderer, scheduler, screen, frame = still
    before = screen.image.patch.rgba
    hide(session, renderer, 1)
    scheduler.workers.start(Worker.PREVIEW, "packed region")
    hide(session, renderer, 2)
    scheduler.workers.finish(Worker.PREVIEW)
    hide(session, renderer, 3)
    scheduler.finish_tasks()
    assert renderer.settled
    wanted = cast_packed(session.scene(), frame.camera, SIZE, 1.0).patch.rgba
    assert np.abs(wanted - before).max() > 0.5
    np.testing.assert_allclose(screen.image.patch.rgba, wanted, atol=1 / 255)


@pytest.mark.parametrize("seed", range(12))
def test_changes_and_pictures_in_any_order(still, session, seed) -> None:
    renderer, scheduler, screen, frame = still
    rng, workers = np.random.default_rng(seed), scheduler.workers
    hidden: set[int] = set()
    for _ in range(30):
        what = rng.integers(4)
        if what == 0:
            one = int(rng.choice(session.ids))
            (session.show if one in hidden else session.hide)([one])
            hidden ^= {one}
            renderer.recast_objects([one])
        elif what == 1 and (startable := workers.startable()):
            workers.start(*startable[rng.integers(len(startable))])
        elif what == 2 and (running := workers.running()):
            workers.finish(running[rng.integers(len(running))])
        elif what == 3 and rng.random() < 0.2:
            renderer.recast()
    scheduler.finish_tasks()
    if not renderer.is_full:
        scheduler.touch(IdlePhase.IMAGE)
        settle(scheduler)
    assert renderer.settled
    wanted = cast_packed(session.scene(), frame.camera, SIZE, 1.0)
    if wanted is None:
        assert screen.image is None
    else:
        np.testing.assert_allclose(screen.image.patch.rgba, wanted.patch.rgba, atol=1 / 255)


def test_colours_that_come_while_others_are_cast_are_cast_once(session, qtbot, monkeypatch) -> None:
    scheduler, began, go_on = Scheduler(), threading.Event(), threading.Event()
    renderer = PackedRenderer(session, scheduler, Screen(), NoCanvasBackend())
    renderer.fade.allowed = False
    renderer.set_view(Frame(session.overview(), SIZE, np.eye(4)))
    qtbot.waitUntil(lambda: renderer.settled and not scheduler.busy, timeout=20000)
    passes = renderer.passes

    def held_up(*given: Any) -> Any:
        began.set()
        assert go_on.wait(20)
        return cast_packed(*given)

    monkeypatch.setattr("napari_unpack.viewer.packed_renderer.cast_packed", held_up)
    renderer.refine()
    assert began.wait(20)
    renderer.refine()
    go_on.set()
    qtbot.waitUntil(lambda: renderer.settled and not scheduler.busy, timeout=20000)
    assert renderer.passes == passes + 2
    scheduler.close()


def test_while_slow_previews_of_a_turn_are_cast_nothing_is_refined(
    still, session, monkeypatch
) -> None:
    renderer, scheduler, _, _ = still
    monkeypatch.setattr("napari_unpack.viewer.packed_renderer.FEWEST_RAYS", 100)
    renderer.backend_changed()
    session.view = nu.View((1.0, 0.2, 0.0))
    renderer.set_view(Frame(session.overview(), SIZE, np.eye(4)))
    for _ in ("waiting", "running"):
        scheduler.advance(1000)
        assert not scheduler.has("packed", Worker.REFINE)
        if scheduler.workers.startable():
            scheduler.workers.start(Worker.PREVIEW, "packed")
    scheduler.workers.finish(Worker.PREVIEW)
    scheduler.advance(1000)
    assert scheduler.has("packed", Worker.REFINE)
    scheduler.finish_tasks()
    assert renderer.settled


def test_for_a_picture_of_another_size_the_full_image_is_there_at_once(still, session) -> None:
    renderer, scheduler, screen, frame = still
    larger = Frame(frame.camera, (2 * SIZE[0], 3 * SIZE[1]), np.eye(4))
    before, passes = screen.image, renderer.passes
    renderer.set_view(larger)
    # A window that is resized waits for no image.
    assert renderer.passes == passes
    assert screen.image is before
    renderer.complete()
    assert renderer.passes == passes + 1
    assert screen.image.size == larger.size
    assert screen.image.patch.size[0] > 1.9 * before.patch.size[0]
    assert renderer.settled
    # Nothing else is cast for it; the window's own image is cast as ever.
    assert not scheduler.has("packed")
    renderer.complete()
    renderer.set_view(frame)
    settle(scheduler)
    np.testing.assert_array_equal(screen.image.patch.rgba, before.patch.rgba)


@pytest.mark.parametrize("cast", ["cast_packed", "recast_objects"])
def test_a_picture_that_fails_once_is_there_all_the_same(still, session, monkeypatch, cast) -> None:
    renderer, scheduler, screen, frame = still
    real, failures = getattr(packed_renderer, cast), [MemoryError("Unable to allocate 3 MiB")]

    def failing_once(*given: Any) -> Any:
        if failures:
            raise failures.pop()
        return real(*given)

    renderer.fade.allowed = False
    monkeypatch.setattr(packed_renderer, cast, failing_once)
    if cast == "recast_objects":
        hide(session, renderer, 1)
    else:
        renderer.refine()
    settle(scheduler)
    assert failures == []
    assert renderer.settled
    wanted = cast_packed(session.scene(), frame.camera, SIZE, 1.0).patch.rgba
    np.testing.assert_allclose(screen.image.patch.rgba, wanted, atol=1 / 255)


def test_a_picture_that_fails_again_is_told_once(session, qtbot, monkeypatch) -> None:
    told: list[str] = []
    scheduler = ManualScheduler(told.append)
    renderer = PackedRenderer(session, scheduler, Screen(), NoCanvasBackend())
    renderer.set_view(Frame(session.overview(), SIZE, np.eye(4)))
    settle(scheduler)

    def failing(*_: Any) -> Any:
        raise MemoryError("Unable to allocate 3 MiB")

    monkeypatch.setattr(packed_renderer, "cast_packed", failing)
    renderer.refine()
    settle(scheduler)
    assert told == ["Unable to allocate 3 MiB"]
    assert scheduler.workers.idle


def test_the_bricks_of_the_volume_are_made_once_for_images_picks_and_the_card(
    still, session
) -> None:
    renderer, *_ = still
    ready = session.scene().subvolumes.whole()
    assert renderer.subvolume(session.scene()) is ready
    assert renderer.known_subvolume() is ready
