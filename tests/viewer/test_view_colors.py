"""Distinct colours for this view, on Labels layers of any kind, in a real viewer."""

from __future__ import annotations

import colorsys
import gc
import time

import numpy as np
import pytest
from napari.layers import Labels

from napari_unpack.tasks import no_progress
from napari_unpack.viewer.view_colors import color_task, layer_view
from napari_unpack.widgets.contributions import distinct_colors, restore_colors
from viewer_fixtures import phantom


@pytest.fixture
def viewer(make_napari_viewer_proxy):
    from napari_unpack.layers.compat import unwrap

    shown = make_napari_viewer_proxy(show=True)
    shown.window.resize(600, 460)
    return unwrap(shown)


def colored(viewer, qtbot) -> None:
    """Have a layer coloured; hears of it from the layer, since the work may end at once."""
    done = []
    for layer in viewer.layers:
        if isinstance(layer, Labels):
            layer.events.colormap.connect(lambda _event: done.append(True))
    assert distinct_colors(viewer) is not None
    qtbot.waitUntil(lambda: bool(done), timeout=60000)


def hue(layer, object_id) -> float:
    return colorsys.rgb_to_hsv(*layer.get_color(object_id)[:3])[0]


def apart(layer, a, b) -> float:
    return float(np.linalg.norm(layer.get_color(a)[:3] - layer.get_color(b)[:3]))


def cells(dtype) -> np.ndarray:
    """Return a 2D picture of 8 x 8 square cells that touch, IDs from 1."""
    labels = np.zeros((64, 64), dtype)
    for k in range(64):
        row, col = divmod(k, 8)
        labels[8 * row : 8 * row + 8, 8 * col : 8 * col + 8] = k + 1
    return labels


def neighbours_differ(layer, side=8) -> bool:
    ids = np.arange(1, side * side + 1).reshape(side, side)
    across = zip(ids[:, 1:].flat, ids[:, :-1].flat, strict=True)
    pairs = [*across, *zip(ids[1:].flat, ids[:-1].flat, strict=True)]
    return min(apart(layer, a, b) for a, b in pairs) > 0.25


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.int64])
def test_touching_cells_of_a_2d_layer_differ_and_old_colours_come_back(viewer, qtbot, dtype):
    layer = viewer.add_labels(cells(dtype), scale=(3, 0.5), rotate=20)
    before = layer.colormap
    colored(viewer, qtbot)
    assert neighbours_differ(layer)
    assert layer.get_color(0) is None or layer.get_color(0)[3] == 0
    restore_colors(viewer)
    assert layer.colormap is before


def test_old_colours_come_back_through_the_proxies_that_menus_hand_over(
    make_napari_viewer_proxy, qtbot
):
    viewer = make_napari_viewer_proxy(show=True)
    viewer.add_labels(cells(np.uint8))
    before = viewer.layers[0].get_color(5)
    colored(viewer, qtbot)
    # Whatever stood for the layer in between is gone.
    gc.collect()
    assert not np.array_equal(viewer.layers[0].get_color(5), before)
    restore_colors(viewer)
    np.testing.assert_array_equal(viewer.layers[0].get_color(5), before)


def test_a_slice_of_a_volume_colours_what_is_in_it(viewer, qtbot):
    volume = np.stack([np.zeros((64, 64), np.uint16), cells(np.uint16)])
    layer = viewer.add_labels(volume)
    viewer.dims.set_point(0, 1)
    colored(viewer, qtbot)
    assert neighbours_differ(layer)


def test_objects_in_front_of_each_other_differ_in_3d_under_any_affine(viewer, qtbot):
    _, labels = phantom()
    turn = np.eye(4)
    turn[:3, :3] = np.array([[2.0, 0.2, 0], [0, 1.0, 0.3], [0, 0, 1.5]])
    viewer.dims.ndisplay = 3
    layer = viewer.add_labels(labels.astype(np.int32) * 1000, affine=turn)
    viewer.reset_view()
    viewer.scene.camera.angles = (10, 35, 20)
    viewer.screenshot(flash=False)
    seen = layer_view(viewer, layer)
    colored(viewer, qtbot)
    from napari_unpack.rendering import cast_ids

    ids = cast_ids(
        labels,
        np.linalg.norm(turn[:3, :3], axis=0),
        seen.camera,
        np.arange(8) > 0,
        (120, 160),
        2,
        voxel_from_world=np.linalg.inv(turn),
        backend="cpu",
    )
    both = {tuple(pair) for pair in ids.reshape(2, -1).T if pair.all()}
    assert len(both) >= 3
    assert min(apart(layer, 1000 * a, 1000 * b) for a, b in both) > 0.25


@pytest.mark.parametrize("orientation", ["towards", "away"])
def test_the_camera_is_the_one_the_viewer_draws_with(viewer, orientation):
    labels = np.zeros((20, 30, 40), np.uint8)
    labels[2:6, 3:9, 30:38] = 1
    layer = viewer.add_labels(labels, scale=(2, 1, 1))
    viewer.dims.ndisplay = 3
    viewer.scene.camera.orientation = (orientation, "down", "right")
    viewer.reset_view()
    viewer.scene.camera.angles = (0, 60, 0)
    picture = viewer.screenshot(flash=False)[..., :3].max(axis=2) > 30
    seen = layer_view(viewer, layer)
    from napari_unpack.rendering import cast_ids

    ids = cast_ids(
        labels, (2, 1, 1), seen.camera, np.array([False, True]), seen.size,
        voxel_from_world=np.linalg.inv(seen.world_from_voxel), backend="cpu",
    )[0] > 0  # fmt: skip
    height, width = seen.size
    shown = picture[:height, :width]
    assert ids.sum() > 50
    if orientation == "away":
        # Left and right change places: the same objects are near each other all the same.
        shown = shown | shown[:, ::-1]
    assert (ids & shown).sum() > 0.85 * ids.sum()


def test_65535_labels_take_no_second_of_the_window(viewer):
    labels = np.append(np.arange(1, 65536, dtype=np.uint16), 0).reshape(64, 32, 32)
    layer = viewer.add_labels(labels)
    viewer.dims.set_point(0, 3)
    colors = color_task(viewer, layer).run(no_progress)
    # napari compiles its own mapping of IDs when a colormap is set for the first time.
    layer.colormap = colors
    # Of the processor: other tests run at the same time.
    start = time.thread_time()
    layer.colormap = colors
    assert time.thread_time() - start < 1.0
    in_slice = labels[3]
    for a, b in zip(in_slice[:, 1:].flat, in_slice[:, :-1].flat, strict=True):
        assert apart(layer, a, b) > 0.1
    assert layer.get_color(65535)[3] == 1


def test_other_layers_and_views_are_answered_with_a_sentence(viewer, qtbot):
    assert distinct_colors(viewer) is None
    layer = viewer.add_labels(np.zeros((8, 8), np.uint8))
    colored(viewer, qtbot)
    restore_colors(viewer)
    restore_colors(viewer)
    viewer.add_labels(np.zeros((8, 8), np.uint8))
    viewer.layers.selection.clear()
    assert distinct_colors(viewer) is None
    viewer.layers.selection.active = layer
    colored(viewer, qtbot)


def test_the_slice_that_is_shown_is_coloured_where_another_layer_has_finer_units(viewer):
    labels = np.broadcast_to(np.arange(1, 21, dtype=np.uint16)[:, None, None], (20, 30, 30))
    layer = viewer.add_labels(labels.copy(), units=("mm",) * 3)
    viewer.add_image(np.zeros((20, 30, 30)), scale=(1000,) * 3, units=("um",) * 3)
    viewer.dims.set_point(0, 7000.0)
    assert np.unique(layer_view(viewer, layer).labels).tolist() == [8]
