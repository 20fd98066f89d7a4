"""The cached image in a live canvas: when rays are cast, and what is left behind."""

from dataclasses import replace

import numpy as np
import pytest

from napari_unpack.geometry.rays import cast_rays, voxel_from_world
from napari_unpack.geometry.shading import Shading
from napari_unpack.geometry.view import View
from napari_unpack.rendering.cpu import Bricks
from napari_unpack.rendering.gl.cached_pass import TintedCaster
from napari_unpack.rendering.gl.tinted_pass import Appearance
from napari_unpack.rendering.gl.volume_store import VolumeStore

SHAPE = (6, 8, 10)


def rays_of(size=(20, 24), **view):
    camera = View(**view).camera(SHAPE, (1, 1, 1))
    return cast_rays(camera, size, voxel_from_world((1, 1, 1)), 0.7)


@pytest.fixture
def look():
    table = np.ones((16, 4), np.float32)
    table[:, 3] = np.linspace(0, 0.8, 16)
    tints = np.array([[1, 1, 1, 0], [1, 0, 0, 1], [0, 0, 1, 1]], dtype=np.float32)
    return Appearance((1, 1, 1), table, (0.0, 1000.0), tints, Shading())


@pytest.fixture
def caster(gl):
    labels = np.zeros(SHAPE, np.uint16)
    labels[1:5, 1:7, 1:5], labels[1:5, 1:7, 5:9] = 1, 2
    caster = TintedCaster(VolumeStore(labels, (labels > 0).astype(np.uint16) * 900))
    yield caster
    caster.close()


def test_the_same_inputs_cast_no_rays_again(caster, look):
    first = caster.cast(rays_of(), look)
    assert caster.cast(rays_of(), look) is first
    assert caster.cast(rays_of(), replace(look, tints=look.tints.copy())) is first
    assert caster.passes == 1


def test_camera_tint_transfer_function_light_and_labels_each_cast_once(caster, look):
    caster.cast(rays_of(), look)
    changes = [
        (rays_of(direction=(1, 1, 0)), look),
        (rays_of(), look),
        (rays_of(), replace(look, tints=look.tints * np.float32(0.5))),
        (rays_of(), replace(look, table=look.table * np.float32(0.5))),
        (rays_of(), replace(look, domain=(0.0, 2000.0))),
        (rays_of(), replace(look, shading=None)),
    ]
    for number, (rays, changed) in enumerate(changes, start=2):
        caster.cast(rays, changed)
        caster.cast(rays, changed)
        assert caster.passes == number
    caster.store.set_labels(np.ones(SHAPE, np.uint16))
    caster.cast(*changes[-1])
    assert caster.passes == len(changes) + 2


def test_volumes_are_uploaded_once_however_many_casters_share_them(caster, look):
    other = TintedCaster(caster.store)
    for direction in ((1, 0, 0), (0, 1, 0)):
        caster.cast(rays_of(direction=direction), look)
        other.cast(rays_of(direction=direction), look)
    assert caster.store.uploads == 2
    other.close()


def test_hiding_an_object_is_one_pass_that_sends_one_row_of_tints(gl, look):
    labels = np.zeros((64, 64, 64), np.uint16)
    for number, corner in enumerate(np.ndindex(4, 4, 4), start=1):
        labels[tuple(slice(16 * c, 16 * c + 14) for c in corner)] = number
    volume = (labels > 0).astype(np.uint16) * 900
    bricks = Bricks.of(labels, volume)
    tints = np.ones((65536, 4), np.float32)
    tints[0] = 0
    caster = TintedCaster(VolumeStore(labels, volume))
    camera = View().camera(labels.shape, (1, 1, 1))
    rays = cast_rays(camera, (16, 16), voxel_from_world((1, 1, 1)), 1.0)

    def cast():
        shown = replace(look, tints=tints.copy())
        caster.cast(rays, shown, bricks.occupied(look.table, look.domain, tints))
        tinted = caster.tinted_pass
        return np.array(
            [caster.passes, tinted.tints.rows_uploaded, tinted.leaps.uploads, caster.store.uploads]
        )

    before = cast()
    tints[33] = 0
    np.testing.assert_array_equal(cast() - before, [1, 1, 0, 0])
    caster.close()


def test_a_resolution_used_before_makes_no_new_frame_buffer(caster, look):
    for size in ((20, 24), (10, 12), (20, 24), (10, 12)):
        assert caster.cast(rays_of(size), look).size == size
    assert (caster.passes, caster.targets.made) == (4, 2)


def test_frame_buffer_and_viewport_are_as_before(caster, look, gl):
    from OpenGL import GL

    from napari_unpack.rendering.gl.framebuffer import Target

    outer = Target((9, 11))
    with outer.drawing():
        gl.flush_commands()
        before = GL.glGetIntegerv(GL.GL_FRAMEBUFFER_BINDING), list(GL.glGetIntegerv(GL.GL_VIEWPORT))
        caster.cast(rays_of(), look)
        gl.flush_commands()
        after = GL.glGetIntegerv(GL.GL_FRAMEBUFFER_BINDING), list(GL.glGetIntegerv(GL.GL_VIEWPORT))
    assert after == before
    assert before[1] == [0, 0, 11, 9]


def test_a_cast_picture_shows_on_a_card_in_a_scene(canvas, look):
    from vispy.scene.visuals import create_visual_node

    from napari_unpack.rendering.gl import backend as gl_backend
    from napari_unpack.rendering.gl.depth_quads import Quad, QuadsVisual

    labels = np.zeros(SHAPE, np.uint16)
    labels[1:5, 1:7, 1:5], labels[1:5, 1:7, 5:9] = 1, 2
    volume = (labels > 0).astype(np.uint16) * 900
    caster = TintedCaster(VolumeStore(labels, volume))
    rays = rays_of((40, 60))
    view = canvas.central_widget.add_view(border_width=0)
    canvas.render()
    node = create_visual_node(QuadsVisual)(parent=view.scene)

    def draw(visual):
        with visual.events.update.blocker():
            visual.quads = [Quad(caster.cast(rays, look))]

    node.before_draw = draw
    shown = canvas.render()
    canvas.render()
    assert caster.passes == 1
    wanted, _ = gl_backend.tinted(
        volume, labels, rays, look.spacing, look.table, look.domain, look.tints, look.shading
    )
    difference = np.abs(shown[..., :3] / 255 - wanted[..., :3]).max(-1)
    assert wanted[..., 3].max() > 0.9
    assert difference.max() < 1.5 / 255
    caster.close()


def test_a_coarse_grid_tells_the_user(gl, look):
    store = VolumeStore(np.ones(SHAPE, np.uint16), np.ones(SHAPE, np.uint16), largest=8)
    caster = TintedCaster(store)
    assert store.notice is None
    caster.cast(rays_of(), look)
    assert "6x8x10" in store.notice
    caster.close()


def test_a_layer_that_moves_to_another_canvas_casts_there(gl, canvas, look, offscreen_context):
    labels = np.ones(SHAPE, np.uint16)
    caster = TintedCaster(VolumeStore(labels, labels * 500))
    with offscreen_context.use():
        first = caster.cast(rays_of(), look)
    second = caster.cast(rays_of(), look)
    canvas.context.flush_commands()
    assert second is not first
    assert (caster.passes, caster.store.uploads) == (2, 4)
    caster.close()
    assert caster.passes == 2


def test_a_window_of_one_pixel_is_drawn(caster, look):
    assert caster.cast(rays_of((1, 1)), look).size == (1, 1)


@pytest.mark.parametrize("fov", [0, 30])
def test_an_object_that_leaves_recasts_its_own_pixels_and_the_picture_is_as_if_all_were(
    caster, look, fov
):
    rays = rays_of(direction=(0.3, 0.2, 1.0), fov=fov)
    read = lambda c: [c.targets.get(rays.size).read(n).copy() for n in (0, 1)]  # noqa: E731
    caster.cast(rays, look)
    assert caster.rays_cast == 20 * 24
    whole, asked = read(caster), []
    fewer = replace(look, tints=look.tints * np.array([[1], [0], [1]], np.float32))
    seen = [np.flatnonzero((whole[0][..., 3] > 0).any(axis=axis)) for axis in (1, 0)]
    rows, cols = ((int(n.min()), int(n.max() - n.min() + 1)) for n in seen)

    def where(ids):
        asked.append(ids)
        return cols[0], rows[0], cols[1], rows[1]

    caster.cast(rays, fewer, where=where)
    assert asked == [frozenset({1})]
    assert caster.passes == 2
    assert caster.rays_cast == 20 * 24 + rows[1] * cols[1] < 2 * 20 * 24
    partly = read(caster)
    afresh = TintedCaster(caster.store)
    afresh.cast(rays, fewer)
    for found, wanted, before in zip(partly, read(afresh), whole, strict=True):
        np.testing.assert_array_equal(found, wanted)
        assert (found != before).any()


def test_pixels_outside_the_window_are_kept_and_none_are_cast_for_what_is_out_of_view(caster, look):
    rays = rays_of()
    caster.cast(rays, look)
    before = caster.targets.get(rays.size).read(0).copy()
    red = replace(look, tints=np.ones((3, 4), np.float32))
    caster.cast(rays, red, where=lambda ids: (10, 5, 4, 3))
    after = caster.targets.get(rays.size).read(0)
    changed = (after != before).any(axis=2)
    assert changed.any()
    changed[5:8, 10:14] = False
    assert not changed.any()
    cast = caster.rays_cast
    caster.cast(rays, look, where=lambda ids: None)
    assert caster.rays_cast == cast
    np.testing.assert_array_equal(caster.targets.get(rays.size).read(0), after)


def test_anything_but_a_tint_recasts_all(caster, look):
    caster.cast(rays_of(), look)
    where = lambda ids: (0, 0, 1, 1)  # noqa: E731
    for number, changed in enumerate((replace(look, shading=None), look), start=2):
        caster.cast(rays_of(), changed, where=where)
        assert caster.rays_cast == number * 20 * 24
    caster.cast(rays_of(direction=(1, 1, 0)), replace(look, tints=look.tints * 0), where=where)
    assert caster.rays_cast == 4 * 20 * 24
