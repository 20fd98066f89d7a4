"""The user's own layer is moved, turned or scaled while its session is open."""

from typing import Any

import numpy as np
import pytest
from napari.utils.notifications import Notification, notification_manager
from pytestqt.qtbot import QtBot
from qtpy.QtCore import Qt
from qtpy.QtWidgets import QMessageBox

from mouse import LEFT
from opened_panel import controller_with, pile_of_balls, press, rest


@pytest.fixture
def image(viewer: Any, piled: Any) -> Any:
    """Return the image of the pile of balls, whose session is open."""
    return viewer.layers["bag"]


def _world(layer: Any) -> np.ndarray:
    return np.array([layer.data_to_world(point) for point in np.vstack([np.zeros(3), np.eye(3)])])


@pytest.mark.filterwarnings("ignore:Non-orthogonal slicing")
def test_the_picture_goes_with_a_layer_that_is_moved_and_turned(
    panel: Any, image: Any, qtbot: QtBot
) -> None:
    session = panel.workspace.session
    rest(panel, qtbot)
    image.translate = (30, -20, 5)
    image.rotate = (0, 0, 40)
    rest(panel, qtbot)
    for layer in panel.workspace.controller.layers:
        np.testing.assert_allclose(_world(layer), _world(image), atol=1e-9)
    assert panel.workspace.session is session
    assert panel.segment.rescale.isHidden()


def test_another_voxel_size_is_said_and_used_on_demand(
    panel: Any, image: Any, qtbot: QtBot
) -> None:
    session = panel.workspace.session
    panel.commands.rename(2, "Mug")
    before = len(notification_manager.records)
    image.scale = (4, 1, 1)
    rest(panel, qtbot)
    (said,) = [notice.message for notice in notification_manager.records[before:]]
    assert said.startswith("The voxels of 'bag' are 4 x 1 x 1 mm now, and 2 x 1 x 1 mm in the 3D")
    assert not panel.segment.fold.isChecked()
    press(qtbot, panel.segment.rescale)
    # What is unpacked would be lost.
    qtbot.mouseClick(panel.unsaved.question.button(QMessageBox.StandardButton.Discard), LEFT)
    qtbot.waitUntil(lambda: panel.workspace.session not in (session, None), timeout=20000)
    rest(panel, qtbot)
    fresh = panel.workspace.session
    np.testing.assert_allclose(fresh.spacing, (4, 1, 1))
    np.testing.assert_array_equal(fresh.labels, session.labels)
    assert fresh.objects["name"][2] == "Mug"
    assert panel.segment.rescale.isHidden()


def test_another_voxel_size_is_that_of_the_time_point_that_is_shown(
    viewer: Any, panel: Any, qtbot: QtBot
) -> None:
    volume, labels = pile_of_balls()
    series = viewer.add_image(np.stack([volume, volume[::-1]]), scale=(1, 2, 1, 1))
    own = viewer.add_labels(labels, visible=False, scale=(2, 1, 1))
    panel.segment.volume_input.choose(series)
    panel.segment.index.choose(0)
    session = controller_with(panel, qtbot, own)
    # The one to be unpacked next.
    panel.segment.index.choose(1)
    for layer in panel.workspace.controller.sources:
        layer.scale = (1, 3, 1, 1)[-layer.ndim :]
    rest(panel, qtbot)
    press(qtbot, panel.segment.rescale)
    qtbot.waitUntil(lambda: panel.workspace.session not in (session, None), timeout=20000)
    np.testing.assert_allclose(panel.workspace.session.spacing, (3, 1, 1))
    np.testing.assert_array_equal(panel.workspace.session.volume, volume)
    assert panel.segment.index.index == (1,)


def test_a_voxel_size_that_is_set_back_is_offered_no_more(
    panel: Any, image: Any, qtbot: QtBot
) -> None:
    before = len(notification_manager.records)
    for scale, offered in (((4, 1, 1), True), ((2, 1, 1), False), ((4, 1, 1), True)):
        # The same sentence would not be shown twice at once.
        notification_manager.records.append(Notification("another"))
        image.scale = scale
        rest(panel, qtbot)
        assert panel.segment.rescale.isHidden() == (not offered)
    said = [each.message for each in notification_manager.records[before:]]
    assert sum(words.startswith("The voxels of 'bag'") for words in said) == 2


def test_a_voxel_size_that_is_typed_while_a_session_is_open_is_offered(
    panel: Any, image: Any, qtbot: QtBot
) -> None:
    session = panel.workspace.session
    panel.segment.fold.setChecked(False)
    size = panel.segment.voxels.size
    size.setText("4 1 1")
    size.setModified(True)
    qtbot.keyClick(size, Qt.Key.Key_Return)
    rest(panel, qtbot)
    for layer in panel.workspace.controller.sources:
        np.testing.assert_allclose(layer.scale, (4, 1, 1))
    np.testing.assert_allclose(session.spacing, (2, 1, 1))
    assert not panel.segment.rescale.isHidden()


def test_an_image_that_becomes_a_picture_leaves_the_bag_where_it_is(
    panel: Any, image: Any, qtbot: QtBot
) -> None:
    rest(panel, qtbot)
    layers = panel.workspace.controller.layers
    before = [_world(layer) for layer in layers]
    image.data = np.zeros((10, 12), np.float32)
    image.scale = (3, 5)
    rest(panel, qtbot)
    assert panel.segment.rescale.isHidden()
    for layer, where in zip(layers, before, strict=True):
        np.testing.assert_array_equal(_world(layer), where)
