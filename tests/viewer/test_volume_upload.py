"""What the three layers take on the graphics card, by GL's own count."""

from __future__ import annotations

import gc
from typing import Any

import pytest
from benchmarks.napari_window import of_qt, on_the_card

from napari_unpack.layers import compat
from napari_unpack.rendering.gl.textures import VolumeTextures
from napari_unpack.session import Session
from napari_unpack.viewer.controller import SessionController

SMALL = 120_000
"""What is not told apart, bytes: a third of the volumes here."""


@pytest.fixture
def shown(make_napari_viewer_proxy, bag, qtbot):
    """Return viewer, controller and the bytes before of a session drawn with shaders."""
    viewer = make_napari_viewer_proxy(show=True)
    viewer.window.resize(500, 400)
    viewer.dims.ndisplay = 3
    gc.collect()
    before = on_the_card(viewer)
    controller = SessionController(viewer, Session(*bag, spacing=(1.5, 1.5, 1.5)))
    controller.backend, controller.recolor_at_rest = "gl", False
    # In the air until a test lands them.
    controller.seconds = 600.0
    controller.open()
    assert controller.settle(90)
    assert controller.casts_with == "gl"
    yield viewer, controller, before
    controller.close()


def fresh(viewer: Any, before: dict[tuple[str, int], int]) -> dict[tuple[str, int], int]:
    """Return what has come to the card since, apart from napari's own small things."""
    gc.collect()
    viewer.screenshot(canvas_only=True, flash=False)
    return {name: size for name, size in on_the_card(viewer).items() if name not in before}


def test_all_three_layers_share_one_density_and_one_label_volume(shown, bag, qtbot) -> None:
    viewer, controller, before = shown
    controller.unpack(2)
    qtbot.waitUntil(lambda: len(controller.transition.images) == 2, timeout=60000)
    controller.finish()
    assert controller.settle(60)
    controller.unpack(1)
    qtbot.waitUntil(lambda: len(controller.transition.images) == 1, timeout=60000)
    volume, labels = bag
    assert len(controller.sprites.sprites) == 2
    # A second volume of either kind, by whatever way, would be seen here.
    large = sorted(size for size in fresh(viewer, before).values() if size >= labels.size)
    pictures = controller.frame.size[0] * controller.frame.size[1]
    assert large.count(volume.nbytes) == 1
    assert large.count(labels.size) == 1
    assert sum(large) <= volume.nbytes + labels.size + 3 * 20 * pictures


def test_a_copy_of_the_labels_is_seen(shown, bag) -> None:
    viewer, _, before = shown
    calm = sum(fresh(viewer, before).values())
    scene_canvas = compat.native_canvas(viewer)
    scene_canvas.set_current()
    with_copy = VolumeTextures(bag[1])
    with_copy.send()
    grown = {name: size for name, size in on_the_card(viewer).items() if name not in before}
    assert sum(grown.values()) - calm == bag[1].size
    with_copy.delete()
    assert sum(fresh(viewer, before).values()) == calm


def test_closing_leaves_no_volume_and_no_frame_buffer_on_the_card(shown) -> None:
    viewer, controller, before = shown
    controller.close()
    assert sum(fresh(viewer, before).values()) - of_qt(viewer) < SMALL
