"""What the three layers take on the graphics card, by our count and by GL's own."""

from __future__ import annotations

import gc
from typing import Any

import numpy as np
import pytest

from napari_unpack.layers import compat
from napari_unpack.rendering.gl.memory import DENSITY, LABELS, TARGETS, memory_counter
from napari_unpack.rendering.gl.textures import VolumeTextures
from napari_unpack.session import Session
from napari_unpack.viewer.controller import SessionController

MOST_NAMES = 1024

SMALL = 120_000
"""What is not told apart, bytes: a third of the volumes here."""


def on_the_card(viewer: Any) -> dict[tuple[str, int], int]:
    """Return the bytes of every texture and buffer of the viewer's context, as GL knows them."""
    from OpenGL import GL

    scene_canvas = compat.native_canvas(viewer)
    scene_canvas.set_current()
    scene_canvas.context.flush_commands()
    found = {}
    sides = GL.GL_TEXTURE_WIDTH, GL.GL_TEXTURE_HEIGHT, GL.GL_TEXTURE_DEPTH
    colors = (
        GL.GL_TEXTURE_RED_SIZE,
        GL.GL_TEXTURE_GREEN_SIZE,
        GL.GL_TEXTURE_BLUE_SIZE,
        GL.GL_TEXTURE_ALPHA_SIZE,
    )

    def asked(name: int, words: tuple[int, ...]) -> list[int]:
        told = np.zeros(len(words), np.int32)
        for i, word in enumerate(words):
            GL.glGetTextureLevelParameteriv(name, 0, word, told[i : i + 1])
        return [int(n) for n in told]

    for name in range(1, MOST_NAMES):
        if GL.glIsTexture(name):
            bits = sum(asked(name, colors))
            found["texture", name] = int(np.prod(asked(name, sides))) * bits // 8
        if GL.glIsBuffer(name):
            size = np.zeros(1, np.int32)
            GL.glGetNamedBufferParameteriv(name, GL.GL_BUFFER_SIZE, size)
            found["buffer", name] = int(size[0])
    return found


@pytest.fixture
def shown(make_napari_viewer_proxy, bag, qtbot):
    """Return (viewer, stage, bytes before, ledger before) of a stage drawn with shaders."""
    viewer = make_napari_viewer_proxy(show=True)
    viewer.window.resize(500, 400)
    viewer.dims.ndisplay = 3
    gc.collect()
    held = memory_counter().bytes_held()
    before = on_the_card(viewer)
    controller = SessionController(viewer, Session(*bag, spacing=(1.5, 1.5, 1.5)))
    controller.backend, controller.recolor_at_rest = "gl", False
    # In the air until a test lands them.
    controller.seconds = 600.0
    controller.open()
    assert controller.settle(90)
    assert controller.casts_with == "gl"
    yield viewer, controller, before, held
    controller.close()


def fresh(viewer: Any, before: dict[tuple[str, int], int]) -> dict[tuple[str, int], int]:
    """Return what has come to the card since, apart from napari's own small things."""
    gc.collect()
    viewer.screenshot(canvas_only=True, flash=False)
    return {name: size for name, size in on_the_card(viewer).items() if name not in before}


def test_all_three_layers_share_one_density_and_one_label_volume(shown, bag, qtbot) -> None:
    viewer, controller, before, held = shown
    controller.unpack(2)
    qtbot.waitUntil(lambda: len(controller.transition.images) == 2, timeout=60000)
    controller.finish()
    assert controller.settle(60)
    controller.unpack(1)
    qtbot.waitUntil(lambda: len(controller.transition.images) == 1, timeout=60000)
    volume, labels = bag
    ours = memory_counter().bytes_held() - held
    assert len(controller.sprites.sprites) == 2
    assert ours[DENSITY] == volume.nbytes
    assert ours[LABELS] == labels.size
    # A second volume of either kind, by whatever way, would be seen here.
    large = sorted(size for size in fresh(viewer, before).values() if size >= labels.size)
    pictures = controller.frame.size[0] * controller.frame.size[1]
    assert large.count(volume.nbytes) == 1
    assert large.count(labels.size) == 1
    assert sum(large) <= volume.nbytes + labels.size + 3 * 20 * pictures


def of_qt(viewer: Any) -> int:
    """Return what Qt draws into: the canvas, and the window it is composed in."""
    native = compat.native_canvas(viewer).native
    sizes = [widget.size() for widget in (native, native.window())]
    return round(sum(4 * s.width() * s.height() for s in sizes) * native.devicePixelRatioF() ** 2)


def test_the_ledger_says_what_gl_itself_says(shown) -> None:
    viewer, controller, before, held = shown
    for moves in (
        lambda: None,
        lambda: controller.unpack(3),
        controller.finish,
        lambda: controller.restore(1),
    ):
        moves()
        assert controller.settle(60)
        counted = sum(fresh(viewer, before).values()) - of_qt(viewer)
        ours = sum((memory_counter().bytes_held() - held).values())
        assert ours > 700_000
        # napari's own: text of overlays, some vertices.
        assert abs(counted - ours) < SMALL


def test_a_copy_of_the_labels_is_seen_by_gl_and_by_the_ledger(shown, bag) -> None:
    viewer, _, before, _ = shown
    calm, held = sum(fresh(viewer, before).values()), sum(memory_counter().bytes_held().values())
    scene_canvas = compat.native_canvas(viewer)
    scene_canvas.set_current()
    with_copy = VolumeTextures(bag[1])
    with_copy.send()
    grown = {name: size for name, size in on_the_card(viewer).items() if name not in before}
    assert sum(grown.values()) - calm == bag[1].size
    assert sum(memory_counter().bytes_held().values()) - held == bag[1].size
    with_copy.delete()
    assert sum(memory_counter().bytes_held().values()) == held


def test_closing_leaves_no_volume_and_no_frame_buffer_on_the_card(shown) -> None:
    viewer, controller, before, held = shown
    controller.close()
    ours = memory_counter().bytes_held() - held
    assert (ours[DENSITY], ours[LABELS], ours[TARGETS]) == (0, 0, 0)
    assert sum(fresh(viewer, before).values()) - of_qt(viewer) < SMALL
