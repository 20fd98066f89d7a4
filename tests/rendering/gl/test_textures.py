import warnings
from ctypes import c_void_p

import numpy as np
import pytest

from napari_unpack.rendering import object_id_layers
from napari_unpack.rendering.gl import offscreen, textures
from napari_unpack.rendering.gl.lookup_tables import IdTable
from napari_unpack.rendering.gl.textures import VolumeTextures, fitting_factor
from napari_unpack.rendering.gl.volume_store import VolumeStore
from napari_unpack.rendering.gl.voxel_buffer import VoxelBuffer


def read_back(texture):
    from OpenGL import GL
    from vispy.gloo.context import get_current_canvas

    if isinstance(texture, VoxelBuffer):
        return read_buffer(texture)
    parser = get_current_canvas().context.shared.parser
    GL.glBindTexture(GL.GL_TEXTURE_3D, parser.get_object(texture.id).handle)
    out = np.empty(texture.shape[:3], np.float32)
    GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 1)
    GL.glGetTexImage(GL.GL_TEXTURE_3D, 0, GL.GL_RED, GL.GL_FLOAT, out)
    GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 4)
    GL.glBindTexture(GL.GL_TEXTURE_3D, 0)
    return out


def read_buffer(held):
    """Return what a shader would read, 0 to 1."""
    from OpenGL import GL
    from OpenGL.raw.GL.VERSION.GL_1_5 import glGetBufferSubData
    from vispy.gloo.context import get_current_canvas

    parser = get_current_canvas().context.shared.parser
    out = np.empty(held.shape, held.kind)
    GL.glBindBuffer(GL.GL_TEXTURE_BUFFER, parser.get_object(held.buffer.id).handle)
    glGetBufferSubData(GL.GL_TEXTURE_BUFFER, 0, out.nbytes, out.ctypes.data_as(c_void_p))
    GL.glBindBuffer(GL.GL_TEXTURE_BUFFER, 0)
    return out.astype(np.float64) / (np.iinfo(held.kind).max if out.dtype.kind == "u" else 1.0)


@pytest.mark.parametrize("as_buffer", [True, False])
def test_a_small_volume_stays_as_it_is(gl, as_buffer):
    labels = np.arange(60, dtype=np.uint16).reshape(3, 4, 5)
    textures = VolumeTextures(labels, labels * 1000, as_buffer=as_buffer)
    textures.send()
    assert (textures.factor, textures.grid, textures.notice) == ((1, 1, 1), (3, 4, 5), None)
    assert textures.labels.internalformat == "r8"
    np.testing.assert_array_equal(np.rint(read_back(textures.labels) * 255), labels)
    np.testing.assert_allclose(read_back(textures.density) * 65535, labels * 1000, atol=0.01)


def test_ids_above_255_take_two_bytes(gl):
    labels = np.zeros((3, 3, 3), np.uint16)
    labels[1, 1, 1] = 65535
    textures = VolumeTextures(labels)
    textures.send()
    assert (textures.labels.internalformat, textures.label_scale) == ("r16", 65535.0)


def test_a_volume_too_long_for_the_driver_is_drawn_coarser_and_says_so(gl):
    # 10 long where 4 fit: 3 voxels a texel, the last block padded with its edge.
    volume = np.broadcast_to(np.arange(10, dtype=np.float32)[:, None, None], (10, 4, 4)).copy()
    labels = (volume + 1).astype(np.uint16)
    textures = VolumeTextures(labels, volume, largest=4)
    textures.send()
    assert (textures.factor, textures.grid) == ((3, 1, 1), (4, 4, 4))
    assert read_back(textures.density)[:, 0, 0].tolist() == [1.0, 4.0, 7.0, 9.0]
    assert np.rint(read_back(textures.labels)[:, 0, 0] * 255).tolist() == [2, 5, 8, 10]
    assert "10x4x4" in textures.notice
    assert "4x4x4" in textures.notice


def test_a_coarser_volume_shows_the_same_objects_in_the_same_places(gl):
    from napari_unpack.geometry.rays import cast_rays, voxel_from_world
    from napari_unpack.geometry.view import View
    from napari_unpack.rendering.gl.framebuffer import Target
    from napari_unpack.rendering.gl.object_id_pass import ObjectIdPass

    labels = np.zeros((8, 16, 16), np.uint16)
    labels[:, :8, :8], labels[:, 8:, 8:] = 1, 2
    camera = View(direction=(-1, 0, 0), height=16.0).camera(labels.shape, (1, 1, 1))
    rays = cast_rays(camera, (8, 8), voxel_from_world((1, 1, 1)), 0.5)
    target = Target((8, 8))
    textures = VolumeTextures(labels, largest=8)
    textures.send()
    assert textures.factor == (1, 2, 2)
    ObjectIdPass().draw([target], textures, rays, np.array([False, True, True]), 1)
    wanted = np.zeros((8, 8))
    wanted[:4, :4], wanted[4:, 4:] = 1, 2
    np.testing.assert_array_equal(target.read()[..., 0], wanted)


def test_a_driver_without_room_is_given_the_longest_axis_coarser(gl, monkeypatch):
    from napari_unpack.rendering.gl import textures

    room = 8 * 8 * 8
    monkeypatch.setattr(textures, "driver_holds", lambda grid, _: np.prod(grid) <= room)
    assert fitting_factor((8, 8, 8), 2048, 2) == (1, 1, 1)
    assert fitting_factor((32, 8, 8), 2048, 2) == (4, 1, 1)
    assert fitting_factor((16, 16, 16), 2048, 2) == (2, 2, 2)


def test_mismatched_arrays_are_refused_by_name(gl):
    labels = np.zeros((3, 3, 3), np.uint16)
    with pytest.raises(ValueError, match="volume must be"):
        VolumeTextures(labels, np.zeros((3, 3, 4), np.uint16))
    with pytest.raises(ValueError, match="labels must be a filled 3D array"):
        VolumeTextures(labels[0])
    with pytest.raises(TypeError, match="float64"):
        VolumeTextures(labels, np.zeros((3, 3, 3)))


def test_the_store_uploads_once_a_context_and_only_labels_when_they_change(gl):
    labels = np.ones((3, 3, 3), np.uint16)
    store = VolumeStore(labels, labels * 100)
    textures = store.here()
    assert store.here() is textures
    assert store.uploads == 2
    store.set_labels(labels * 2)
    assert (store.uploads, store.version) == (3, 1)
    assert np.rint(read_back(store.here().labels) * 255).max() == 2
    with pytest.raises(ValueError, match="as before"):
        store.set_labels(np.ones((2, 2, 2), np.uint16))


def test_hiding_one_of_65535_objects_sends_one_row(gl):
    table = IdTable()
    tints = np.ones((65536, 4), np.float32)
    table.update(tints)
    assert table.rows_uploaded == 256
    tints[40_000] = 0
    table.update(tints)
    assert table.rows_uploaded == 257
    table.update(tints)
    assert table.rows_uploaded == 257


@pytest.mark.parametrize("as_buffer", [True, False])
def test_a_large_volume_is_sent_in_pieces(gl, monkeypatch, as_buffer):
    from napari_unpack.rendering.gl import textures

    monkeypatch.setattr(textures, "serves_best", lambda _: as_buffer)
    monkeypatch.setattr(textures, "SLAB_BYTES", 200)
    rng = np.random.default_rng(0)
    labels = rng.integers(0, 200, (9, 8, 7)).astype(np.uint16)
    volume = rng.integers(0, 60000, labels.shape).astype(np.uint16)
    store = VolumeStore(labels, volume, most=199)
    frames, sent = 0, [0]
    while not store.send(300):
        frames += 1
        sent.append(store.bytes_sent)
    # One byte a label, two a density; a slab is one plane, 56 or 112 bytes.
    assert store.bytes_sent == 3 * labels.size
    assert max(np.diff(sent)) <= 300
    assert frames >= 5
    assert store.send(300)
    here = store.here()
    assert store.bytes_sent == 3 * labels.size
    np.testing.assert_array_equal(np.rint(read_back(here.labels) * 255), labels)
    np.testing.assert_allclose(read_back(here.density) * 65535, volume, atol=0.01)


@pytest.mark.parametrize("largest", [None, 6])
def test_a_repair_sends_the_box_it_touched_and_nothing_else(gl, largest):
    rng = np.random.default_rng(1)
    labels = rng.integers(0, 9, (12, 11, 10)).astype(np.uint16)
    volume = labels * np.uint16(1000)
    store = VolumeStore(labels, volume, largest)
    before = store.here().bytes_sent
    after = labels.copy()
    after[3:8, 2:9, 5:6] = 77
    store.set_labels(after, (slice(3, 8), slice(2, 9), slice(5, 6)), 77)
    here = store.here()
    assert here.bytes_sent - before == (5 * 7 * 1 if largest is None else 3 * 4 * 1)
    whole = VolumeTextures(after, volume, largest)
    whole.send()
    np.testing.assert_array_equal(read_back(here.labels), read_back(whole.labels))


def test_a_box_with_an_id_above_255_sends_all_labels_with_two_bytes(gl):
    labels = np.ones((4, 5, 6), np.uint16)
    store = VolumeStore(labels)
    store.here()
    after = labels.copy()
    after[1, 1, 1] = 300
    store.set_labels(after, (slice(1, 2), slice(1, 2), slice(1, 2)), 300)
    assert store.here().labels.internalformat == "r16"
    np.testing.assert_array_equal(np.rint(read_back(store.here().labels) * 65535), after)


def test_a_volume_larger_than_a_texture_is_refused_and_auto_takes_the_processor(gl, monkeypatch):
    labels = np.zeros((4, 4, 40), np.uint16)
    labels[:, :, ::3] = np.arange(1, 15)
    everything = object_id_layers(labels, layers=16, size=(16, 64), backend="cpu")
    monkeypatch.setattr(textures, "largest_side", lambda: 16)
    with pytest.raises(ValueError, match="4x4x40"):
        object_id_layers(labels, layers=16, size=(16, 64), backend="gl")
    monkeypatch.setattr(offscreen, "is_software", lambda: False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = object_id_layers(labels, layers=16, size=(16, 64))
    np.testing.assert_array_equal(found, everything)
    assert offscreen.context().serves
