"""The stage drawn with shaders on the canvas, here by a software rasteriser."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from both_backends import assert_alike, pictures_of_both
from counted_passes import assert_camera_hue_and_transfer_function_each_cast_anew, settled_passes
from napari_unpack.geometry.boxes import differing_box
from napari_unpack.layers import compat
from napari_unpack.layers.rendered_image import CanvasImage, RenderedImage
from napari_unpack.rendering.gl import compute_program, programs, textures
from napari_unpack.rendering.gl import programs as shader_source
from napari_unpack.rendering.gl.programs import ShaderError
from napari_unpack.session import ObjectState
from napari_unpack.viewer import canvas_backend
from viewer_fixtures import canvas


@pytest.fixture
def by_gl(staged):
    """Return (viewer, stage), cast with shaders; no GL error may be left."""
    viewer, controller = staged
    controller.recolor_at_rest = False
    heard = []
    controller.events.message.connect(heard.append)
    controller.backend = "gl"
    assert controller.settle(60)
    assert controller.casts_with == "gl"
    yield viewer, controller
    assert heard == []
    assert no_error(viewer)


def no_error(viewer) -> bool:
    scene_canvas = compat.native_canvas(viewer)
    if scene_canvas is None:
        return True
    from OpenGL import GL

    scene_canvas.set_current()
    scene_canvas.context.flush_commands()
    return GL.glGetError() == GL.GL_NO_ERROR


@pytest.fixture
def computed(monkeypatch):
    """Cast with compute shaders, as on a card."""
    monkeypatch.setattr(compute_program, "preferred", lambda: True)
    monkeypatch.setattr(textures, "serves_best", lambda _: False)


def test_gl_shows_what_the_cpu_shows_at_rest_and_in_the_air(by_gl, session) -> None:
    gl_and_the_cpu_show_the_same_at_rest_and_in_the_air(*by_gl, session)


def test_compute_shaders_show_what_the_cpu_shows_too(computed, by_gl, session) -> None:
    gl_and_the_cpu_show_the_same_at_rest_and_in_the_air(*by_gl, session)


def gl_and_the_cpu_show_the_same_at_rest_and_in_the_air(viewer, controller, session) -> None:
    the_bag_at_rest_is_the_cpus_picture(viewer, controller)
    controller.backend = "gl"
    assert controller.settle(30)
    session.clock = lambda: 100.0
    controller.unpack(2)
    session.clock = lambda: 100.15
    assert_alike(pictures_of_both(viewer, controller))
    controller.finish()
    assert controller.settle(30)


def the_bag_at_rest_is_the_cpus_picture(viewer, controller) -> None:
    shown = canvas(viewer)
    controller.backend = "cpu"
    assert controller.settle(30)
    wanted = canvas(viewer)
    assert np.abs(wanted - wanted[0, 0]).max() > 100
    difference = np.abs(shown - wanted).max(axis=2)
    # A few samples on the faces of voxels fall to the other side.
    assert np.quantile(difference, 0.999) <= 2.0
    assert difference.max() <= 12.0


def rays_are_cast_again_for_what_changes_the_picture_and_for_nothing_else(
    viewer, controller
) -> None:
    viewer.add_points([[3, 3, 3]])
    passes = settled_passes(controller)
    viewer.layers["Points"].visible = False
    controller.packed.visible = False
    controller.packed.visible = True
    controller.interaction.point_at(3)
    canvas(viewer)
    assert settled_passes(controller) == passes
    assert_camera_hue_and_transfer_function_each_cast_anew(viewer, controller)
    after_look = settled_passes(controller)
    controller.unpack(1)
    controller.finish()
    assert after_look < settled_passes(controller) <= after_look + 2


def test_volumes_are_sent_once_for_bag_flights_and_a_small_object_inspected(
    by_gl, session, qtbot
) -> None:
    _, controller = by_gl
    (out,) = controller.unpack(1)
    qtbot.waitUntil(
        lambda: isinstance(controller.transition.images.get(out), CanvasImage), timeout=20000
    )
    qtbot.waitUntil(lambda: not controller.flying, timeout=20000)
    assert controller.settle(30)
    assert set(controller.sprites.sprites) == {out}
    assert session.states[out] is ObjectState.UNPACKED
    assert controller.renderer.canvas_backend.uploads == 2
    # Inspected it is without stairs, as on the CPU.
    controller.inspect(out)
    pictures = []
    for backend in ("gl", "cpu"):
        controller.backend = backend
        qtbot.waitUntil(lambda: not controller.renderer.flight_animation.running, timeout=20000)
        assert controller.settle(30)
        assert isinstance(controller.transition.images[out], RenderedImage)
        # The bag behind it is dimmed, and cast by either.
        pictures.append(controller.transition.images[out].patch.rgba)
    np.testing.assert_array_equal(*pictures)
    session.leave()
    controller.finish()
    assert controller.settle(30)


def test_rays_are_cast_for_what_changes_the_picture_and_nothing_else(by_gl, session) -> None:
    viewer, controller = by_gl
    # A person's own zoom: else the bag would make room for the sprite, and be cast anew.
    viewer.scene.camera.zoom *= 0.8
    assert controller.settle(30)
    height, width = controller.packed.image.window.size
    cast = controller.renderer.canvas_backend.rays_cast
    controller.unpack(1)
    controller.finish()
    assert controller.settle(30)
    assert 0 < controller.renderer.canvas_backend.rays_cast - cast < 0.7 * height * width
    partly = canvas(viewer)
    # There and back again: what belongs to no object is everywhere, so all is cast anew.
    for shown in (True, False):
        session.show_unlabelled = shown
        assert controller.settle(30)
    assert controller.renderer.canvas_backend.rays_cast - cast > height * width
    np.testing.assert_array_equal(canvas(viewer), partly)
    rays_are_cast_again_for_what_changes_the_picture_and_for_nothing_else(viewer, controller)


def test_resize_reopening_and_a_layer_removed_break_nothing(by_gl, session, qtbot) -> None:
    viewer, controller = by_gl
    size = controller.frame.size
    viewer.window.resize(620, 500)
    qtbot.waitUntil(lambda: controller.frame.size != size, timeout=20000)
    assert controller.settle(30)
    assert controller.packed.image.size == controller.frame.size
    controller.frame_bag()
    assert controller.settle(30)
    before = canvas(viewer)
    controller.close()
    assert no_error(viewer)
    again = type(controller)(viewer, session)
    again.backend, again.recolor_at_rest = "gl", False
    again.open()
    assert again.settle(60)
    assert again.casts_with == "gl"
    assert np.abs(canvas(viewer) - before).mean() < 1.0
    viewer.layers.remove("Transition")
    qtbot.waitUntil(lambda: not again.is_open, timeout=10000)
    assert no_error(viewer)


@pytest.mark.parametrize(
    ("problem", "words"),
    [(ShaderError, "tinted_volume.glsl:3: no"), (MemoryError, "it is out of memory")],
)
def test_where_gl_fails_the_cpu_takes_over_and_says_so_once(
    staged, monkeypatch, problem, words, qtbot
) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = False
    wanted = canvas(viewer)
    heard = []
    controller.events.message.connect(heard.append)

    def refuse(*_args, **_kwargs) -> None:
        raise problem(words)

    monkeypatch.setattr(canvas_backend.TintedCaster, "cast", refuse)
    controller.backend = "gl"
    qtbot.waitUntil(lambda: bool(heard), timeout=10000)
    assert controller.settle(30)
    assert controller.casts_with == "cpu"
    controller.unpack(1)
    controller.finish()
    controller.restore(1)
    controller.finish()
    assert controller.settle(30)
    assert len(heard) == 1
    assert words in heard[0]
    np.testing.assert_allclose(canvas(viewer), wanted, atol=3)


def test_a_shader_the_driver_refuses_is_named_with_its_line_and_the_cpu_draws(
    staged, monkeypatch, qtbot
) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = False
    wanted, heard = canvas(viewer), []
    controller.events.message.connect(heard.append)
    whole = shader_source.read

    def refused(path: str) -> str:
        lines = whole(path).splitlines()
        return "\n".join(
            [*lines[:20], "no glsl;", *lines[20:]] if path == "lib/light.glsl" else lines
        )

    monkeypatch.setattr(programs, "load", partial(shader_source.load, read=refused))
    controller.backend = "gl"
    qtbot.waitUntil(lambda: bool(heard), timeout=20000)
    assert controller.settle(30)
    assert controller.casts_with == "cpu"
    assert len(heard) == 1
    assert "lib/light.glsl:21" in heard[0]
    assert "the processor draws it instead" in heard[0]
    np.testing.assert_allclose(canvas(viewer), wanted, atol=3)
    assert no_error(viewer)


def test_a_driver_that_refuses_even_to_show_pictures_is_named_once_and_raises_nothing(
    staged, monkeypatch
) -> None:
    viewer, controller = staged
    controller.close()
    whole = shader_source.read
    bad = {"passes/quad.frag": "no glsl;\n"}
    monkeypatch.setattr(
        programs, "load", partial(shader_source.load, read=lambda p: bad.get(p, "") + whole(p))
    )
    again, heard = type(controller)(viewer, controller.session), []
    again.events.message.connect(heard.append)
    again.open()
    assert again.settle(30)
    canvas(viewer)
    canvas(viewer)
    assert len(heard) == 1
    assert "passes/quad.frag:1" in heard[0]
    assert canvas(viewer).std() < 5
    assert no_error(viewer)
    again.close()


def test_a_volume_too_large_for_the_driver_is_drawn_coarser_and_the_user_is_told(
    staged, monkeypatch
) -> None:
    viewer, controller = staged
    heard = []
    controller.events.message.connect(heard.append)
    monkeypatch.setattr(textures, "largest_side", lambda: 32)
    controller.backend = "gl"
    assert controller.settle(60)
    assert controller.casts_with == "gl"
    canvas(viewer)
    shape = "x".join(map(str, controller.session.labels.shape))
    assert len(heard) == 1
    assert shape in heard[0]
    assert "too large for this graphics driver" in heard[0]
    assert canvas(viewer).std() > 10


def test_auto_takes_gl_on_hardware_and_the_cpu_on_a_software_rasteriser(
    staged, monkeypatch
) -> None:
    _, controller = staged
    assert controller.backend == "auto"
    assert controller.casts_with == "cpu"
    monkeypatch.setattr(canvas_backend, "is_software_renderer", lambda name: name == "")
    controller.backend = "auto"
    assert controller.settle(30)
    assert controller.casts_with == "gl"


def test_a_large_volume_goes_to_the_graphics_card_in_pieces_while_the_cpu_casts(
    staged, monkeypatch
) -> None:
    viewer, controller = staged
    controller.recolor_at_rest = False
    wanted = canvas(viewer)
    monkeypatch.setattr(canvas_backend, "BYTES_A_FRAME", 20_000)
    monkeypatch.setattr(textures, "SLAB_BYTES", 20_000)
    casting = controller.renderer.canvas_backend
    sent = []
    controller.packed.on_draw, send = (
        lambda: (send(), sent.append(casting.bytes_sent)),
        (controller.packed.on_draw),
    )
    controller.backend = "gl"
    assert controller.casts_with == "cpu"
    assert controller.settle(60)
    assert controller.casts_with == "gl"
    session = controller.session
    whole = session.labels.size * (
        1 + controller.renderer.packed_renderer.known_subvolume().volume.itemsize
    )
    assert casting.bytes_sent == whole
    assert np.diff([0, *sent]).max() <= 20_000
    assert np.abs(canvas(viewer) - wanted).mean() < 1.0


def test_a_repair_sends_the_box_it_touched_and_keeps_the_picture_till_then(by_gl, session) -> None:
    viewer, controller = by_gl
    casting = controller.renderer.canvas_backend
    sent, uploads = casting.bytes_sent, casting.uploads
    before, labels = canvas(viewer), session.display_labels
    gone = session.boxes.ids[0]
    session.delete(int(gone))
    assert controller.settle(30)
    box = differing_box(labels, session.display_labels)
    assert casting.bytes_sent - sent == labels[box].size < labels.size / 4
    assert casting.uploads == uploads + 1
    assert controller.casts_with == "gl"
    by_card = canvas(viewer)
    assert np.abs(by_card - before).max() > 20
    controller.backend = "cpu"
    assert controller.settle(30)
    difference = np.abs(by_card - canvas(viewer)).max(axis=2)
    assert np.quantile(difference, 0.999) <= 2.0


def test_what_comes_back_while_slices_are_looked_at_is_at_rest(by_gl) -> None:
    viewer, controller = by_gl
    viewer.dims.ndisplay = 2
    for command in (controller.unpack, controller.restore):
        command(1)
        controller.finish()
        assert controller.settle(20)
        assert not controller.renderer.flight_animation.running
    viewer.dims.ndisplay = 3
    assert controller.settle(30)
