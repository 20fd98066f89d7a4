"""Who can leave is outlined in the picture: white alone, yellow together, and never too late."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from napari_unpack.session import ObjectState, Session
from napari_unpack.session.measurements import SurfacePoint
from napari_unpack.viewer.controller import SessionController
from napari_unpack.viewer.overlays import (
    INTERLOCKED,
    LEAST_OCCLUDED,
    LEAVING_FIRST,
    UNPACKABLE,
    Outlined,
)
from viewer_fixtures import canvas


def knot() -> tuple[np.ndarray, np.ndarray]:
    """Return volume and labels of two hooks that hold each other along x, and a block beside."""
    labels = np.zeros((8, 14, 8), np.uint8)
    labels[1:4, 1:7, 1:3], labels[4:7, 1:7, 5:7] = 1, 1
    labels[4:7, 1:7, 1:3], labels[1:4, 1:7, 5:7] = 2, 2
    labels[1:7, 9:13, 1:7] = 3
    labels = np.kron(labels, np.ones((4, 4, 4), np.uint8))
    return 1000.0 * (labels > 0), labels


@pytest.fixture
def shown(make_napari_viewer_proxy: Any) -> Any:
    """Return (viewer, session) of the knot, seen along x, not yet on a stage."""
    viewer = make_napari_viewer_proxy(show=True)
    viewer.window.resize(760, 560)
    session = Session(*knot())
    session.direction = "-x"
    return viewer, session


def staged(viewer: Any, session: Session) -> SessionController:
    controller = SessionController(viewer, session)
    controller.seconds, controller.recolor_at_rest = 0.1, False
    controller.open()
    assert controller.settle(60)
    return controller


def drawn(viewer: Any, controller: SessionController, ink: tuple[float, ...]) -> int:
    """Count the pixels that the marks draw in the direction of an ink's colour."""
    with_marks = canvas(viewer)
    controller.overlays.outlines_unpackable = False
    assert controller.settle(30)
    added = with_marks - canvas(viewer)
    controller.overlays.outlines_unpackable = True
    assert controller.settle(30)
    drawn = np.abs(added).max(axis=-1) > 12
    seen = with_marks[drawn]
    if not len(seen):
        return 0
    yellow = seen[:, 2] < 0.75 * seen[:, 0]
    return int(yellow.sum() if ink[2] < 0.9 else (~yellow).sum())


def test_a_knot_is_outlined_as_one_group_also_when_it_was_known_before(shown: Any) -> None:
    viewer, session = shown
    controller = staged(viewer, session)
    assert set(session.queries.unpackable_groups()) == {(1, 2), (3,)}
    assert drawn(viewer, controller, INTERLOCKED.line) > 100
    controller.close()

    # The answer is known now, and nobody asks again.
    assert session.queries.occlusion_task() is None
    controller = staged(viewer, session)
    assert drawn(viewer, controller, INTERLOCKED.line) > 100

    # With the block gone the queue is what it was, and the knot is marked still.
    controller.unpack([3])
    controller.finish()
    assert controller.settle(30)
    assert session.queries.unpackable_groups() == ((1, 2),)
    assert drawn(viewer, controller, INTERLOCKED.line) > 100
    controller.unpack(1)
    controller.finish()
    assert controller.settle(30)
    assert set(session.states.values()) == {ObjectState.UNPACKED}
    assert session.queries.unpackable_groups() == ()
    controller.close()


def test_outlines_follow_a_finer_answer_that_comes_after_they_were_drawn(
    shown: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    viewer, session = shown
    controller = staged(viewer, session)
    outlines, before = controller.overlays.outlines, canvas(viewer)
    # The answer that they were drawn by is told once more: they stay.
    controller.events.unpackable.emit(frozenset({1, 2, 3}))
    assert not outlines.pending
    monkeypatch.setattr(type(session.queries), "unpackable_groups", lambda _: ((3,),))
    controller.events.unpackable.emit(frozenset({3}))
    assert outlines.pending
    assert controller.settle(30)
    assert np.abs(canvas(viewer) - before).max() > 50
    assert drawn(viewer, controller, INTERLOCKED.line) == 0
    controller.close()


def test_where_nobody_can_leave_the_least_blocked_is_outlined() -> None:
    packed, marks = frozenset({1, 2, 3}), Outlined(unpackable=True)
    assert marks.inks(packed, [], 2) == {2: LEAST_OCCLUDED}
    assert marks.inks(packed, [(1,)], 2) == {1: UNPACKABLE}
    assert marks.inks(packed, [(1, 3)]) == {1: INTERLOCKED, 3: INTERLOCKED}
    assert marks.inks(packed, []) == {}
    assert Outlined().inks(packed, [], 2) == {}


def test_a_dozen_who_must_leave_are_outlined_and_more_would_drown_what_is_looked_for() -> None:
    packed = frozenset(range(1, 20))
    few, many = frozenset(range(2, 14)), frozenset(range(2, 15))
    assert Outlined(leaving=few, buried=1).inks(packed) == dict.fromkeys(few, LEAVING_FIRST)
    assert Outlined(True, leaving=many, buried=1).inks(packed, [(15,)]) == {}


def test_outlines_go_with_the_picture_they_are_of(shown: Any, qtbot: Any) -> None:
    viewer, session = shown
    controller = staged(viewer, session)
    frame = controller.frame
    outlines = controller.overlays.outlines
    assert len(outlines.quads_at(frame)) == 1
    # Seen from elsewhere, before anything is drawn anew, and without the bag's picture.
    turned = replace(frame.camera, rotation=frame.camera.rotation[:, [1, 2, 0]])
    for other in (turned, replace(frame.camera, height=1.1 * frame.camera.height)):
        assert outlines.quads_at(replace(frame, camera=other)) == ()
    with_lines = canvas(viewer)
    controller.packed.visible = False
    assert canvas(viewer).std(axis=(0, 1)).max() < 1.0
    controller.packed.visible = True
    assert controller.settle(30)
    assert np.abs(canvas(viewer) - with_lines).max() < 12
    controller.close()


def test_in_napari_s_grid_measurements_are_drawn_in_the_view_of_the_bag(
    staged: Any, session: Session
) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = False
    viewer.scene.camera.zoom *= 0.4
    ends = np.array([[4.0, 6.0, 24.0], [4.0, 21.0, 37.0]]) * session.spacing
    session.measurements.add([SurfacePoint(2, tuple(end)) for end in ends.tolist()])

    def drawn() -> np.ndarray:
        pictures = []
        for shown in (True, False):
            session.measurements.shown = shown
            assert controller.settle(60)
            pictures.append(canvas(viewer))
        rows, cols = np.nonzero((pictures[0] != pictures[1]).any(axis=2))
        return np.array([[rows.min(), rows.max()], [cols.min(), cols.max()]])

    whole = drawn()
    viewer.canvas.grid.enabled = True
    part = drawn()
    # Line and number are as large as without a grid, at the left of the first of two rows.
    assert np.abs(np.diff(part) - np.diff(whole)).max() <= 2
    height, width = canvas(viewer).shape[:2]
    assert part[0, 1] < height / 2
    assert part[1, 1] < width / 2


def test_in_napari_s_grid_outlines_are_around_the_objects_that_they_are_of(shown: Any) -> None:
    viewer, session = shown
    controller = staged(viewer, session)
    viewer.canvas.grid.enabled = True
    assert controller.settle(30)
    with_lines = canvas(viewer)
    controller.overlays.outlines_unpackable = False
    assert controller.settle(30)
    lines = np.argwhere(np.abs(with_lines - canvas(viewer)).max(axis=2) > 12)
    assert len(lines)
    assert all(controller.interaction.packed_at(at.astype(float)) for at in lines)
    controller.close()
