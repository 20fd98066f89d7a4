"""What goes wrong in a viewer while objects fly: nothing crashes, nothing is left behind."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from operator import attrgetter
from typing import Any

import numpy as np
import pytest
from psygnal import EmitLoopError
from vispy.gloo import gl

from napari_unpack.layers import compat
from napari_unpack.session import ObjectState, Session
from napari_unpack.viewer.controller import SessionController
from viewer_fixtures import canvas

SCALE = (1.5, 1.5, 1.5)


@pytest.fixture
def calm(caplog: Any) -> Iterator[None]:
    """Fail where vispy or napari log an error, or GL holds one, in the test."""
    yield
    assert [r.getMessage() for r in caplog.records if r.levelno >= logging.ERROR] == []


@pytest.fixture
def flying(make_napari_viewer_proxy, bag, qtbot, calm) -> Iterator[Any]:
    """Return (viewer, stage, image, labels) with two objects in the air."""
    viewer = make_napari_viewer_proxy(show=True)
    viewer.window.resize(640, 480)
    image = viewer.add_image(bag[0].copy(), scale=SCALE, name="scan")
    labels = viewer.add_labels(bag[1].astype(np.int32), scale=SCALE, name="mine")
    controller = SessionController(viewer, Session(*bag, spacing=SCALE), [image, labels])
    controller.events.message.connect(pytest.fail)
    # So long that they are in the air until a test lands them.
    controller.seconds = 600.0
    controller.open()
    assert controller.settle(90)
    controller.unpack(2)
    in_sight(controller, 2, qtbot)
    yield viewer, controller, image, labels
    controller.close()
    assert not controller.session.flights


def in_sight(controller: Any, count: int, qtbot: Any) -> None:
    """Wait until so many objects in the air are drawn."""
    qtbot.waitUntil(lambda: len(controller.transition.images) == count, timeout=60000)
    assert controller.flying


def land(controller: Any) -> None:
    controller.finish()
    assert controller.settle(60)


def out(session: Any) -> int:
    return sum(state is ObjectState.UNPACKED for state in session.states.values())


def test_labels_edited_renamed_and_the_image_swapped_while_objects_fly(flying, qtbot) -> None:
    viewer, controller, image, labels = flying
    before = controller.session.labels.copy()
    volume = controller.session.volume.copy()
    labels.data[:, :, :20] = 0
    labels.refresh()
    labels.data_setitem((np.array([30]), np.array([30]), np.array([30])), 7)
    labels.name, image.name, controller.packed.name = "other", "another", "mine now"
    image.data = image.data[::-1] // 2
    qtbot.wait(80)
    land(controller)
    # The session works on what it was opened with.
    np.testing.assert_array_equal(controller.session.labels, before)
    np.testing.assert_array_equal(controller.session.volume, volume)
    assert out(controller.session) == 2
    assert canvas(viewer).std(axis=(0, 1)).max() > 5.0
    assert not gl.glGetError()


def test_sources_removed_slices_looked_at_and_a_layer_of_ours_removed(flying, qtbot) -> None:
    viewer, controller, _, _ = flying
    viewer.layers.remove("mine")
    viewer.dims.ndisplay = 2
    qtbot.wait(60)
    viewer.dims.ndisplay = 3
    viewer.layers.remove("scan")
    qtbot.wait(60)
    land(controller)
    assert out(controller.session) == 2
    assert not gl.glGetError()
    controller.restore(1)
    in_sight(controller, 1, qtbot)
    viewer.layers.remove("Transition")
    qtbot.wait(60)
    assert not controller.is_open
    assert not controller.session.flights
    assert len(viewer.layers) == 0


def test_the_window_is_closed_in_mid_flight_of_everything(flying, qtbot) -> None:
    viewer, controller, _, _ = flying
    controller.unpack(5)
    in_sight(controller, 7, qtbot)
    viewer.close()
    qtbot.wait(150)
    controller.close()
    assert out(controller.session) == 7
    assert not controller.session.flights


def all_given_back(viewer: Any) -> bool:
    """Whether the viewer holds the user's two layers alone, shown as before the session."""
    shown = [(layer.name, layer.visible) for layer in viewer.layers]
    return shown == [("scan", True), ("mine", True)] and viewer.dims.ndisplay == 2


def test_a_script_that_fails_when_objects_move_leaves_no_session_half_closed(flying) -> None:
    viewer, controller, _, _ = flying

    def fail(_ids: frozenset[int]) -> None:
        raise RuntimeError("of a script")

    controller.session.events.states.connect(fail)
    closed: list[bool] = []
    controller.events.closed.connect(lambda: closed.append(True))
    with pytest.raises(EmitLoopError, match="of a script"):
        controller.close()
    assert all_given_back(viewer)
    assert not controller.session.flights
    assert closed == [True]


@pytest.mark.parametrize("event", ["layers.events.removed", "dims.events.ndisplay"])
def test_another_plugin_that_fails_at_an_event_leaves_no_session_half_closed(flying, event) -> None:
    viewer, controller, _, _ = flying
    signal = attrgetter(event)(compat.unwrap(viewer))

    def fail(_event: Any) -> None:
        raise RuntimeError("of another plugin")

    signal.connect(fail)
    with pytest.raises(RuntimeError, match="of another plugin"):
        controller.close()
    signal.disconnect(fail)
    assert all_given_back(viewer)


def test_labels_made_uint8_meanwhile_get_back_their_colours_and_keep_their_brush(
    make_napari_viewer_proxy, bag, session
) -> None:
    viewer = make_napari_viewer_proxy()
    labels = viewer.add_labels(bag[1].astype(np.int32), scale=SCALE)
    labels.selected_label, before = 300, labels.colormap
    controller = SessionController(viewer, session, [labels])
    controller.open()
    labels.selected_label = 3
    labels.data = labels.data.astype(np.uint8)
    controller.close()
    assert labels.colormap == before
    assert (labels.selected_label, labels.colormap.selection) == (3, 3)
    assert list(viewer.layers) == [labels]
