"""What step 1 offers by itself, whichever was there first: layer or panel."""

import gc
import weakref
from collections.abc import Callable
from typing import Any

import dask.array
import numpy as np
import pytest
from napari.utils.notifications import notification_manager
from pytestqt.qtbot import QtBot

from napari_unpack.layers.placement import data_to_world
from napari_unpack.widgets import layer_inputs, segment_section
from napari_unpack.widgets.file_names import bag_name
from napari_unpack.widgets.unpacking_widget import UnpackingWidget
from opened_panel import add_bag, controller_with, open_panel, pile_of_balls


@pytest.fixture
def viewer(make_napari_viewer_proxy: Callable[..., Any]) -> Any:
    """Return a viewer that is not shown: nothing here is looked at."""
    return make_napari_viewer_proxy()


def _chosen(panel: UnpackingWidget) -> tuple[str, str, str]:
    step = panel.segment
    boxes = step.volume_input, step.labels_input
    return boxes[0].currentText(), boxes[1].currentText(), step.start.text()


@pytest.mark.parametrize("first", ["layer", "panel"])
@pytest.mark.parametrize("shown", [True, False])
def test_labels_alone_are_the_objects_at_once(
    viewer: Any, qtbot: QtBot, first: str, shown: bool
) -> None:
    panel = open_panel(viewer, qtbot) if first == "panel" else None
    viewer.add_labels(pile_of_balls()[1], name="organs", visible=shown)
    panel = panel or open_panel(viewer, qtbot)
    assert _chosen(panel) == ("organs", "organs", "Unpack these labels")
    # There are no densities, so nothing could be found in them.
    assert not panel.segment.labels_input.isEnabled()
    assert panel.segment.options.isHidden()
    panel.end()


@pytest.mark.parametrize("first", ["layer", "panel"])
def test_selected_labels_are_the_objects_of_the_image_that_they_fit(
    viewer: Any, qtbot: QtBot, first: str
) -> None:
    panel = open_panel(viewer, qtbot) if first == "panel" else None
    viewer.add_image(np.zeros((8, 8, 8)), name="something else")
    _, labels = add_bag(viewer)
    labels.visible = True
    viewer.layers.selection.active = labels
    panel = panel or open_panel(viewer, qtbot)
    assert _chosen(panel) == ("bag", "expert", "Unpack these labels")
    panel.end()


@pytest.mark.parametrize("first", ["layer", "panel"])
def test_selected_labels_of_no_image_are_unpacked_alone(
    viewer: Any, qtbot: QtBot, first: str
) -> None:
    panel = open_panel(viewer, qtbot) if first == "panel" else None
    viewer.add_image(np.zeros((8, 8, 8)), name="something else")
    viewer.add_labels(pile_of_balls()[1], name="organs")
    panel = panel or open_panel(viewer, qtbot)
    assert _chosen(panel) == ("organs", "organs", "Unpack these labels")
    panel.end()


def test_an_image_is_chosen_before_labels_that_are_not_selected(viewer: Any, qtbot: QtBot) -> None:
    viewer.add_labels(pile_of_balls()[1][:20], name="organs")
    viewer.add_image(pile_of_balls()[0], name="bag")
    panel = open_panel(viewer, qtbot)
    assert _chosen(panel) == ("bag", "Find the objects", "Segment")
    panel.end()


def test_pictures_are_listed_with_the_reason_and_never_chosen(
    viewer: Any, panel: UnpackingWidget
) -> None:
    viewer.add_image(np.zeros((5, 6)), name="slice")
    box = panel.segment.volume_input
    assert box.itemText(0) == "slice (2D)"
    assert box.layer is None
    assert not panel.segment.start.isEnabled()
    assert not panel.segment.sample.isHidden()


def test_a_time_point_of_a_lazy_series_is_unpacked_and_named(viewer: Any, qtbot: QtBot) -> None:
    volume, labels = pile_of_balls()
    series = np.stack([np.zeros_like(volume), volume])
    lazy = dask.array.from_array(series, chunks=(1, 48, 48, 48))
    names = ("t", "z", "y", "x")
    image = viewer.add_image(lazy, name="growth", axis_labels=names, scale=(9, 2, 1, 1))
    objects = np.stack([np.zeros_like(labels), labels])
    theirs = viewer.add_labels(objects, name="grown", axis_labels=names, scale=(9, 2, 1, 1))
    viewer.dims.set_current_step(0, 1)
    panel = open_panel(viewer, qtbot)
    # At first the one that the viewer shows.
    assert panel.segment.index.index == (1,)
    panel.segment.index.choose(0)
    panel.segment.index.choose(1)
    session = controller_with(panel, qtbot, theirs)
    np.testing.assert_array_equal(session.volume, volume)
    np.testing.assert_array_equal(session.labels > 0, labels > 0)
    np.testing.assert_allclose(session.spacing, (2, 1, 1))
    assert "growth (time point 1) objects" in viewer.layers
    controller = panel.workspace.controller
    for layer in (*controller.layers, controller.sources[1]):
        np.testing.assert_allclose(data_to_world(layer), data_to_world(image))
    assert bag_name(controller.sources) == "growth (time point 1)"
    panel.end()


def test_the_panel_keeps_no_volume_of_a_session_that_has_ended(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken = []

    def volume_of(*chosen: Any) -> layer_inputs.Volume:
        made = layer_inputs.volume_of(*chosen)
        taken.append(weakref.ref(made))
        return made

    monkeypatch.setattr(segment_section, "volume_of", volume_of)
    controller_with(panel, qtbot, add_bag(viewer)[1])
    panel.workspace.close()
    gc.collect()
    (left,) = taken
    assert left() is None


def test_a_colour_of_a_colour_volume_is_unpacked_with_labels_of_its_shape(
    viewer: Any, qtbot: QtBot
) -> None:
    volume, labels = pile_of_balls()
    green = (volume // 20).astype(np.uint8)
    viewer.add_image(np.stack([0 * green, green, 0 * green], -1), rgb=True, name="photos")
    theirs = viewer.add_labels(labels, name="balls")
    panel = open_panel(viewer, qtbot)
    panel.segment.index.choose(1)
    session = controller_with(panel, qtbot, theirs)
    np.testing.assert_array_equal(session.volume, green)
    assert bag_name(panel.workspace.controller.sources) == "photos (Green)"
    panel.end()


def test_labels_that_lie_otherwise_by_their_file_are_told(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot
) -> None:
    image, labels = add_bag(viewer)
    mirrored = np.diag([-1.0, 1.0, 1.0, 1.0])
    mirrored[0, 3] = (image.data.shape[0] - 1) * image.scale[0]
    image.metadata["scanner_from_scan"] = np.eye(4)
    labels.metadata["scanner_from_scan"] = mirrored
    controller_with(panel, qtbot, labels)
    told = [record.message for record in notification_manager.records]
    assert sum("By their files 'expert' lie mirrored or turned on 'bag'" in t for t in told) == 1


def test_labels_that_do_not_say_how_they_lie_are_doubted_on_a_turned_image(
    viewer: Any, panel: UnpackingWidget, qtbot: QtBot
) -> None:
    image, labels = add_bag(viewer)
    image.metadata["turned"] = True
    # Made in napari, on what is seen.
    controller_with(panel, qtbot, labels)
    told = [record.message for record in notification_manager.records]
    assert not any("do not say how they lie" in text for text in told)
    panel.workspace.close()
    # Of a file.
    labels.metadata["turned"] = False
    controller_with(panel, qtbot, labels)
    told = [record.message for record in notification_manager.records]
    assert sum("Labels 'expert' do not say how they lie" in text for text in told) == 1
