"""The stage comes and goes: everything of the user's is as it was, and nothing breaks."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from napari.layers import Layer

from napari_unpack.layers.view_camera import same_camera
from napari_unpack.session import ObjectState, Session
from napari_unpack.session.framing import alike, fitted
from napari_unpack.viewer.controller import SessionController
from opened_panel import at_rest
from viewer_fixtures import canvas, complaints


def test_the_users_layers_and_view_come_back_exactly(
    make_napari_viewer_proxy, bag, session, qtbot
) -> None:
    viewer = make_napari_viewer_proxy()
    image = viewer.add_image(bag[0], scale=(1.5, 1.5, 1.5), visible=False)
    labels = viewer.add_labels(bag[1], scale=(1.5, 1.5, 1.5))
    viewer.add_points([[1, 2, 3]], name="mine")
    viewer.layers.selection = {viewer.layers["mine"], viewer.layers[0]}
    viewer.dims.ndisplay = 3
    viewer.scene.camera.center, viewer.scene.camera.zoom = (9, 8, 7), 2.5
    viewer.scene.camera.angles, viewer.scene.camera.perspective = (10, 20, 30), 12
    viewer.dims.ndisplay = 2
    viewer.scene.camera.center, viewer.scene.camera.zoom = (0, 30, 40), 5.5
    viewer.dims.current_step = (7, 11, 30)
    before = _state(viewer)
    controller = SessionController(viewer, session, [image, labels])
    controller.open()
    assert controller.is_open
    assert [layer.name for layer in viewer.layers][-3:] == ["Packed", "Transition", "Sprites"]
    assert not viewer.layers[1].visible
    assert viewer.layers["mine"].visible
    assert viewer.dims.ndisplay == 3
    controller.close()
    controller.close()
    assert _state(viewer) == before
    assert not session.animated


def test_2d_slices_show_the_same_hues_and_the_users_colors_come_back(
    make_napari_viewer_proxy, bag, session
) -> None:
    viewer = make_napari_viewer_proxy()
    mine = viewer.add_labels(bag[1].astype(np.int32), scale=(1.5, 1.5, 1.5))
    other = viewer.add_labels(bag[1][::-1].copy())
    before = mine.colormap, other.colormap
    controller = SessionController(viewer, session, [mine])
    controller.open()
    session.apply_hues({2: 0.3, 5: 0.8}, undoable=False)
    shown = np.asarray(mine.colormap.map(np.arange(8, dtype=np.int32)))
    tints = session.packed_tints()
    np.testing.assert_allclose(shown[[2, 5]], tints[[2, 5]], atol=0.01)
    assert shown[0, 3] == 0
    assert other.colormap == before[1]
    controller.close()
    assert mine.colormap == before[0]


def test_no_volume_of_the_users_is_drawn_through_the_bag_and_slices_show_them_all(
    make_napari_viewer_proxy, bag, session
) -> None:
    viewer = make_napari_viewer_proxy()
    mine = viewer.add_image(bag[0], scale=(1.5, 1.5, 1.5), name="mine")
    viewer.add_labels(bag[1], scale=(1.5, 1.5, 1.5), name="earlier result")
    viewer.add_image(bag[0], name="other channel", visible=False)
    before = {layer.name: layer.visible for layer in viewer.layers}
    controller = SessionController(viewer, session, [mine])
    controller.open()

    def shown():
        return {name: viewer.layers[name].visible for name in before}

    assert not any(shown().values())
    viewer.dims.ndisplay = 2
    assert shown() == before
    viewer.layers["other channel"].visible = True
    viewer.dims.ndisplay = 3
    assert not any(shown().values())
    viewer.dims.ndisplay = 2
    assert shown() == before | {"other channel": True}
    controller.close()
    assert shown() == before
    viewer.dims.ndisplay = 3
    assert shown() == before


def _state(viewer):
    camera = viewer.scene.camera
    return (
        [(layer.name, layer.visible) for layer in viewer.layers],
        sorted(layer.name for layer in viewer.layers.selection),
        viewer.dims.ndisplay,
        viewer.dims.current_step,
        tuple(np.round(camera.center, 6)),
        round(camera.zoom, 6),
        tuple(np.round(camera.angles, 6)),
        camera.perspective,
        str(camera.orientation),
        str(viewer.canvas.background_color),
        len(viewer.mouse_move_callbacks),
        len(viewer.mouse_drag_callbacks),
        len(viewer.mouse_double_click_callbacks),
    )


def test_removing_one_of_our_layers_takes_the_controller_down(staged, qtbot) -> None:
    viewer, controller = staged
    heard = []
    controller.events.closed.connect(lambda: heard.append(True))
    viewer.layers.remove("Sprites")
    qtbot.waitUntil(lambda: not controller.is_open, timeout=10000)
    assert len(viewer.layers) == 0
    assert heard == [True]


def test_all_our_layers_removed_as_selected_take_the_controller_down(staged, qtbot) -> None:
    viewer, controller = staged
    viewer.layers.selection = set(viewer.layers)
    viewer.layers.remove_selected()
    qtbot.waitUntil(lambda: not controller.is_open, timeout=10000)
    assert len(viewer.layers) == 0


def test_the_controller_stands_on_the_users_layer(make_napari_viewer_proxy, bag, session) -> None:
    viewer = make_napari_viewer_proxy()
    image = viewer.add_image(
        bag[0], scale=(3, 3, 3), translate=(10, 20, 30), rotate=(0.0, 0.0, 30.0)
    )
    controller = SessionController(viewer, session, [image])
    np.testing.assert_allclose(controller.packed.translate, [10, 20, 30])
    np.testing.assert_allclose(
        controller.packed.data_to_world((3, 4, 5)), image.data_to_world((3, 4, 5))
    )


def test_a_layer_in_finer_units_beside_it_changes_nothing(
    make_napari_viewer_proxy, bag, session
) -> None:
    viewer = make_napari_viewer_proxy(show=True)
    image = viewer.add_image(bag[0], scale=(1.5,) * 3, units=("mm",) * 3)
    # napari draws everything in micrometres from here on.
    viewer.add_points([[0.0, 0.0, 0.0]], units=("um",) * 3)
    controller = SessionController(viewer, session, [image])
    controller.open()
    assert controller.settle(60)
    np.testing.assert_allclose(controller.frame.camera.center, session.bag.center)
    assert controller.frame.camera.height == pytest.approx(fitted(session).height, rel=0.01)
    session.select([6])
    viewer.dims.ndisplay = 2
    middle = (session.boxes.lower[5] + session.boxes.upper[5] - 1) // 2
    np.testing.assert_allclose(viewer.dims.point, middle * 1500, atol=1)
    assert controller.interaction.in_slice(viewer.dims.point) == 6
    controller.close()


def test_a_flight_survives_closing_the_window(make_napari_viewer_proxy, session, qtbot) -> None:
    viewer = make_napari_viewer_proxy(show=True)
    controller = SessionController(viewer, session)
    controller.open()
    controller.settle(30)
    controller.seconds = 600.0
    controller.unpack(2)
    qtbot.waitUntil(lambda: len(controller.transition.images) == 2, timeout=60000)
    viewer.close()
    qtbot.wait(100)
    controller.close()
    assert not session.flights
    assert sum(s is ObjectState.UNPACKED for s in session.states.values()) == 2


def test_a_controller_that_was_closed_is_not_opened_again(staged) -> None:
    viewer, controller = staged
    controller.close()
    with pytest.raises(RuntimeError, match="make another"):
        controller.open()
    assert len(viewer.layers) == 0


def test_a_controller_that_was_never_opened_leaves_its_session_as_it_is(
    make_napari_viewer_proxy, session
) -> None:
    SessionController(make_napari_viewer_proxy(), session).close()
    assert not session.queries.asks_at_rest


def test_flights_end_in_a_viewer_that_is_not_shown(make_napari_viewer_proxy, session) -> None:
    controller = SessionController(make_napari_viewer_proxy(show=False), session)
    controller.seconds = 0.1
    controller.open()
    (out,) = controller.unpack(1)
    controller.finish()
    assert controller.settle(30)
    assert session.states[out] is ObjectState.UNPACKED
    controller.close()


def test_a_users_column_of_ids_gives_way_to_our_own_in_what_is_duplicated_and_saved(
    make_napari_viewer_proxy, bag
) -> None:
    theirs = pd.DataFrame({"id": [f"P-{i}" for i in range(1, 8)]}, index=range(1, 8))
    session = Session(*bag, objects=theirs)
    controller = SessionController(make_napari_viewer_proxy(), session)
    _, state, kind = controller.packed.as_layer_data_tuple()
    assert (kind, list(state["features"]["id"])) == ("points", [1, 2, 3, 4, 5, 6, 7])
    assert session.objects.loc[3, "id"] == "P-3"


def test_a_layer_of_no_objects_is_duplicated_as_points_without_any(
    make_napari_viewer_proxy, bag
) -> None:
    controller = SessionController(make_napari_viewer_proxy(), Session(*bag))
    data, state, kind = controller.sprites.as_layer_data_tuple()
    points = Layer.create(data, state, kind)
    assert (len(points.data), len(points.features)) == (0, 0)


def test_two_dimensions_and_a_tiny_window_break_nothing(staged, qtbot) -> None:
    viewer, controller = staged
    controller.events.message.connect(pytest.fail)
    for backend in ("cpu", "gl"):
        controller.backend = backend
        two_dimensions_and_a_tiny_window(viewer, controller, qtbot)
        assert controller.casts_with == backend


def two_dimensions_and_a_tiny_window(viewer, controller, qtbot) -> None:
    assert controller.settle(60)
    controller.unpack(1)
    viewer.dims.ndisplay = 2
    qtbot.wait(50)
    assert canvas(viewer).std(axis=(0, 1)).max() < 1.0
    assert complaints(viewer) == []
    viewer.dims.ndisplay = 3
    viewer.canvas.size = (1, 1)
    qtbot.wait(50)
    canvas(viewer)
    assert complaints(viewer) == []
    viewer.canvas.size = (400, 500)
    controller.finish()
    assert controller.settle(30)
    assert canvas(viewer).std(axis=(0, 1)).max() > 5.0
    assert complaints(viewer) == []


def test_two_viewers_keep_their_gl_apart(make_napari_viewer_proxy, session, bag, qtbot) -> None:
    first, second = make_napari_viewer_proxy(show=True), make_napari_viewer_proxy(show=True)
    one, two = SessionController(first, session), SessionController(second, Session(*bag))
    one.events.message.connect(pytest.fail)
    two.events.message.connect(pytest.fail)
    one.open()
    two.open()
    one.unpack(1)
    two.unpack(1)
    one.finish()
    two.finish()
    assert one.settle(30)
    assert two.settle(30)
    before = canvas(second)
    assert before.std(axis=(0, 1)).max() > 5.0
    # napari deletes the first one's GL objects now, while the second's context is current.
    one.close()
    assert complaints(second) == []
    np.testing.assert_array_equal(canvas(second), before)
    first.close()
    np.testing.assert_array_equal(canvas(second), before)
    two.close()


def test_layers_in_another_order_or_a_grid_and_an_unknown_backend_break_nothing(
    staged, qtbot
) -> None:
    viewer, controller = staged
    controller.events.message.connect(pytest.fail)
    controller.unpack(1)
    viewer.layers.move(len(viewer.layers) - 1, 0)
    viewer.canvas.grid.enabled = True
    qtbot.wait(50)
    viewer.canvas.grid.enabled = False
    controller.finish()
    assert controller.settle(30)

    with pytest.raises(ValueError, match="backend must be"):
        controller.backend = "metal"
    assert controller.backend == "auto"


def test_a_layer_of_ours_added_to_a_second_viewer_stays_with_the_first(
    staged, make_napari_viewer_proxy, session
) -> None:
    viewer, controller = staged
    before = canvas(viewer)
    second = make_napari_viewer_proxy(show=True)
    second.dims.ndisplay = 3
    second.add_layer(controller.packed)
    seen = session.camera
    second.scene.camera.angles = (10, 20, 30)
    canvas(second)
    assert controller.settle(30)
    assert same_camera(session.camera, seen)
    second.layers.remove(controller.packed)
    np.testing.assert_array_equal(canvas(viewer), before)
    viewer.scene.camera.angles = (10, 20, 30)
    assert controller.settle(30)
    assert not same_camera(session.camera, seen)
    controller.close()
    assert len(viewer.layers) == 0


def test_a_session_opens_in_a_window_without_room_and_is_framed_once_there_is_some(
    make_napari_viewer_proxy, bag, session, qtbot
) -> None:
    viewer = make_napari_viewer_proxy()
    viewer.add_image(bag[0])
    viewer.canvas.size = (400, 0)
    controller = SessionController(viewer, session)
    controller.overlays.outlines_unpackable = controller.recolor_at_rest = False
    controller.open()
    assert controller.frame is None
    viewer.canvas.size = (400, 500)
    viewer.show()
    qtbot.waitUntil(lambda: controller.frame is not None, timeout=20000)
    at_rest(controller, qtbot)
    frame = controller.frame
    assert session.canvas_size == frame.size
    assert alike(frame.camera, fitted(session, frame.camera))
    assert controller.framing.is_fit
    controller.close()
