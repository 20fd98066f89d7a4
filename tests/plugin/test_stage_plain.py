"""Where napari's layer registry is missing: a Labels layer in the session's hues."""

from __future__ import annotations

import numpy as np
import pytest
from napari.layers import Labels

from napari_unpack.layers import compat
from napari_unpack.viewer.controller import SessionController
from napari_unpack.viewer.plain_stage import PlainStage, controller_class


@pytest.fixture
def without_registry(monkeypatch) -> None:
    monkeypatch.setattr(compat, "_PROBLEM", "The registry is gone.")


def seen(layer: Labels, object_id: int) -> np.ndarray:
    """Return the straight RGBA that napari gives an object."""
    return np.asarray(layer.colormap.map(np.array([object_id], layer.data.dtype))).ravel()


def test_the_controller_with_pictures_is_taken_where_napari_can_show_it(without_registry) -> None:
    assert controller_class() is PlainStage


def test_it_is_not_taken_otherwise() -> None:
    assert controller_class() is SessionController


def test_objects_show_in_their_hues_and_leave_when_unpacked(
    make_napari_viewer_proxy, session, bag, without_registry
) -> None:
    viewer = make_napari_viewer_proxy()
    image = viewer.add_image(bag[0], scale=(1.5, 1.5, 1.5))
    told = []
    session.events.message.connect(told.append)
    controller = PlainStage(viewer, session, [image])
    controller.events.message.connect(told.append)
    controller.open()
    assert "The registry is gone." in told[0]
    assert "Labels" in told[0]
    assert controller.settle(30)
    (layer,) = controller.layers
    assert type(layer) is Labels
    assert not image.visible
    np.testing.assert_allclose(layer.scale, [1.5] * 3)
    tints = session.packed_tints()
    for object_id in session.ids:
        np.testing.assert_allclose(seen(layer, object_id), tints[object_id], atol=0.01)
    assert len({tuple(seen(layer, i).round(2)) for i in session.ids}) > 2
    assert seen(layer, 0)[3] == 0
    (out,) = controller.unpack(1)
    assert seen(layer, out)[3] == 0
    others = [i for i in session.ids if i != out]
    assert all(seen(layer, i)[3] == 1 for i in others)
    controller.restore(1)
    assert seen(layer, out)[3] == 1
    np.testing.assert_array_equal(layer.data, bag[1])
    controller.close()
    assert image.visible
    assert [item.name for item in viewer.layers] == [image.name]


def test_it_looks_where_the_viewer_looks(
    make_napari_viewer_proxy, session, without_registry
) -> None:
    viewer = make_napari_viewer_proxy()
    controller = PlainStage(viewer, session)
    controller.open()
    viewer.scene.camera.set_view_direction((0.0, 1.0, 0.0), (1.0, 0.0, 0.0))
    np.testing.assert_allclose(session.camera.direction, [0, 1, 0], atol=1e-6)
    np.testing.assert_allclose(session.unpack_direction, [0, -1, 0], atol=1e-6)
    controller.close()


def test_the_session_looks_as_napari_does_at_a_mirrored_layer(
    make_napari_viewer_proxy, session, bag, without_registry
) -> None:
    viewer = make_napari_viewer_proxy()
    image = viewer.add_image(bag[0], scale=(1.5, 1.5, -1.5))
    controller = PlainStage(viewer, session, [image])
    controller.open()
    viewer.scene.camera.orientation = ("towards", "down", "right")
    viewer.scene.camera.set_view_direction((-1.0, 0.0, 0.0), (0.0, -1.0, 0.0))
    camera = session.camera
    # Larger x is drawn further left.
    rows, cols = camera.project([[0.0, 0.0, 0.0], [0.0, 0.0, 30.0], [0.0, 30.0, 0.0]], (90, 90)).T
    assert cols[1] < cols[0] == pytest.approx(cols[2])
    assert rows[2] > rows[0] == pytest.approx(rows[1])
    controller.close()


@pytest.mark.parametrize(("scale", "up"), [((1.5, 1.5, 1.5), -1), ((1.5, -1.5, 1.5), 1)])
def test_up_is_what_napari_shows_as_up(
    scale, up, make_napari_viewer_proxy, session, bag, without_registry
) -> None:
    viewer = make_napari_viewer_proxy()
    image = viewer.add_image(bag[0], scale=scale)
    controller = PlainStage(viewer, session, [image])
    controller.open()
    np.testing.assert_allclose(session.away_from_table, [0, up, 0], atol=1e-12)
    controller.close()
