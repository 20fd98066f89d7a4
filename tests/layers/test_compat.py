"""Our layers in napari's layer list: whatever a user does to them there works."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from app_model.expressions import get_context
from napari._app_model.actions._layerlist_context_actions import (  # noqa: TID251
    LAYERLIST_CONTEXT_ACTIONS,
)
from napari.layers import Labels, Points
from napari.utils.colormaps import DirectLabelColormap
from numba import typed

from napari_unpack.layers import compat
from napari_unpack.layers.packed_layer import PackedLayer
from napari_unpack.layers.sprite_layer import SpriteLayer
from napari_unpack.layers.transition_layer import TransitionLayer

BOX = np.array([[0, 0, 0], [9, 19, 29]], dtype=float)


class TwoPoints:
    def points(self) -> np.ndarray:
        return np.array([[4.0, 5, 6], [1, 2, 3]])

    def state(self) -> dict[str, float]:
        return {"size": 2.0}


def three_layers():
    layers = [
        PackedLayer("Packed", (2, 1, 1), BOX),
        TransitionLayer("Transition", (2, 1, 1)),
        SpriteLayer("Sprites", (2, 1, 1)),
    ]
    for layer in layers:
        layer.table = TwoPoints()
    return layers


def test_this_napari_is_supported_and_nothing_is_wrong() -> None:
    assert compat.problem() == ""


def test_every_enabled_action_of_the_layer_list_runs_on_every_layer(make_napari_viewer) -> None:
    viewer = make_napari_viewer()
    layers = three_layers()
    viewer.layers.extend(layers)
    ran = set()
    for layer in layers:
        for action in LAYERLIST_CONTEXT_ACTIONS:
            viewer.layers.selection = {layer}
            context = get_context(viewer.layers)
            if action.enablement is None or action.enablement.eval(context):
                action.callback(viewer.layers)
                ran.add(action.id)
    assert {"napari.layer.duplicate", "napari.layer.bounding_box"} <= ran
    assert not any("convert" in name or "project" in name for name in ran)
    assert all(layer in viewer.layers for layer in layers)


def test_all_three_selected_can_be_linked_duplicated_hidden_and_deleted(make_napari_viewer) -> None:
    viewer = make_napari_viewer()
    viewer.layers.extend(three_layers())
    viewer.layers.select_all()
    viewer.layers.link_layers(viewer.layers.selection)
    viewer.layers[0].visible = False
    assert not viewer.layers[2].visible
    viewer.layers.unlink_layers(viewer.layers.selection)
    viewer.layers.remove_selected()
    assert len(viewer.layers) == 0


def test_a_duplicate_is_a_hidden_points_layer_of_the_objects(make_napari_viewer) -> None:
    viewer = make_napari_viewer()
    viewer.layers.extend(three_layers())
    viewer.layers.selection = {viewer.layers["Packed"]}
    duplicate = next(a for a in LAYERLIST_CONTEXT_ACTIONS if a.id == "napari.layer.duplicate")
    duplicate.callback(viewer.layers)
    copy = viewer.layers["Packed copy"]
    assert isinstance(copy, Points)
    assert not copy.visible
    np.testing.assert_array_equal(copy.data, [[4, 5, 6], [1, 2, 3]])
    np.testing.assert_allclose(copy.scale, [2, 1, 1])


def test_saving_writes_the_objects_as_a_table(make_napari_viewer, tmp_path) -> None:
    viewer = make_napari_viewer()
    viewer.layers.extend(three_layers())
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        (path,) = viewer.layers["Packed"].save(str(tmp_path / "packed.csv"))
        viewer.layers.selection = {viewer.layers["Sprites"]}
        viewer.layers.save(str(tmp_path / "sprites.csv"), selected=True)
    lines = (tmp_path / "packed.csv").read_text().splitlines()
    assert path.endswith("packed.csv")
    assert lines[0].split(",")[:4] == ["index", "axis-0", "axis-1", "axis-2"]
    assert [float(x) for x in lines[1].split(",")[1:4]] == [4, 5, 6]
    assert (tmp_path / "sprites.csv").exists()


def test_only_the_packed_layer_has_an_extent(make_napari_viewer) -> None:
    viewer = make_napari_viewer()
    packed, transition, sprites = three_layers()
    viewer.layers.extend([packed, transition, sprites])
    np.testing.assert_allclose(viewer.layers.extent.world, [[0, 0, 0], [18, 19, 29]])
    assert np.isnan(transition.extent.world).all()
    assert np.isnan(sprites.extent.world).all()


def test_the_controls_say_what_the_layer_is(make_napari_viewer) -> None:
    from qtpy.QtWidgets import QLabel

    viewer = make_napari_viewer()
    viewer.layers.extend(three_layers())
    controls = viewer.window._qt_viewer.dockLayerControls.widget().widgets[viewer.layers[0]]
    words = " ".join(label.text() for label in controls.findChildren(QLabel))
    assert "still packed" in words


def test_giving_a_layer_data_is_refused_in_words() -> None:
    with pytest.raises(AttributeError, match="follows its session"):
        three_layers()[0].data = np.zeros((3, 3))


def test_renaming_and_opacity_are_the_users(make_napari_viewer) -> None:
    viewer = make_napari_viewer()
    viewer.layers.extend(three_layers())
    layer = viewer.layers["Sprites"]
    layer.name = "My things"
    layer.opacity = 0.25
    layer.blending = "additive"
    visual = viewer.window._qt_viewer.canvas.layer_to_visual[layer]
    assert visual.node.opacity == 0.25
    assert viewer.layers["My things"] is layer


@pytest.mark.parametrize("chosen", [None, 5, 77])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.int8, np.int16])
def test_colours_of_up_to_16_bits_are_napari_s_own_and_need_nothing_compiled(
    monkeypatch, kind, chosen
):
    rng = np.random.default_rng(0)
    colors = {int(i): np.append(rng.random(3), 1) for i in rng.permutation(99)[:60] + 1}
    colors |= {None: np.array([0.1, 0.2, 0.3, 0.5]), 0: np.zeros(4)}
    values = rng.integers(0, 120, (9, 70), endpoint=True).astype(kind)
    theirs = Labels(values, colormap=DirectLabelColormap(color_dict=colors))
    ours = Labels(values, colormap=compat.TabledColormap(color_dict=colors))
    for layer in (theirs, ours):
        layer.show_selected_label = chosen is not None
        layer.selected_label = chosen or 1
    expected = theirs.colormap.map(values)
    monkeypatch.setattr(typed.Dict, "empty", None)
    np.testing.assert_array_equal(ours.colormap.map(values), expected)
