import numpy as np
import pytest

from napari_unpack.rendering.store import VolumeStore
from napari_unpack.rendering.tables import IdTable
from napari_unpack.rendering.textures import VolumeTextures, fitting_factor


def read_back(texture):
    from OpenGL import GL
    from vispy.gloo.context import get_current_canvas

    parser = get_current_canvas().context.shared.parser
    GL.glBindTexture(GL.GL_TEXTURE_3D, parser.get_object(texture.id).handle)
    out = np.empty(texture.shape[:3], np.float32)
    GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 1)
    GL.glGetTexImage(GL.GL_TEXTURE_3D, 0, GL.GL_RED, GL.GL_FLOAT, out)
    GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 4)
    GL.glBindTexture(GL.GL_TEXTURE_3D, 0)
    return out


def test_a_small_volume_stays_as_it_is(gl):
    labels = np.arange(60, dtype=np.uint16).reshape(3, 4, 5)
    textures = VolumeTextures(labels, labels * 1000)
    assert (textures.factor, textures.grid, textures.notice) == ((1, 1, 1), (3, 4, 5), None)
    assert textures.labels.internalformat == "r8"
    np.testing.assert_array_equal(np.rint(read_back(textures.labels) * 255), labels)
    np.testing.assert_allclose(read_back(textures.density) * 65535, labels * 1000, atol=0.01)


def test_ids_above_255_take_two_bytes(gl):
    labels = np.zeros((3, 3, 3), np.uint16)
    labels[1, 1, 1] = 65535
    textures = VolumeTextures(labels)
    assert (textures.labels.internalformat, textures.label_scale) == ("r16", 65535.0)


def test_a_volume_too_long_for_the_driver_is_drawn_coarser_and_says_so(gl):
    # 10 long where 4 fit: 3 voxels a texel, the last block padded with its edge.
    volume = np.broadcast_to(np.arange(10, dtype=np.float32)[:, None, None], (10, 4, 4)).copy()
    labels = (volume + 1).astype(np.uint16)
    textures = VolumeTextures(labels, volume, largest=4)
    assert (textures.factor, textures.grid) == ((3, 1, 1), (4, 4, 4))
    assert read_back(textures.density)[:, 0, 0].tolist() == [1.0, 4.0, 7.0, 9.0]
    assert np.rint(read_back(textures.labels)[:, 0, 0] * 255).tolist() == [2, 5, 8, 10]
    assert "10x4x4" in textures.notice
    assert "4x4x4" in textures.notice


def test_a_coarser_volume_shows_the_same_objects_in_the_same_places(gl):
    from napari_unpack.geometry.rays import cast_rays, voxel_from_world
    from napari_unpack.geometry.view import View
    from napari_unpack.rendering.framebuffer import Target
    from napari_unpack.rendering.object_id_pass import ObjectIdPass

    labels = np.zeros((8, 16, 16), np.uint16)
    labels[:, :8, :8], labels[:, 8:, 8:] = 1, 2
    camera = View(direction=(-1, 0, 0), height=16.0).camera(labels.shape, (1, 1, 1))
    rays = cast_rays(camera, (8, 8), voxel_from_world((1, 1, 1)), 0.5)
    target = Target((8, 8))
    textures = VolumeTextures(labels, largest=8)
    assert textures.factor == (1, 2, 2)
    ObjectIdPass().draw([target], textures, rays, np.array([False, True, True]), 1)
    wanted = np.zeros((8, 8))
    wanted[:4, :4], wanted[4:, 4:] = 1, 2
    np.testing.assert_array_equal(target.read()[..., 0], wanted)


def test_a_driver_without_room_is_given_the_longest_axis_coarser(gl, monkeypatch):
    from napari_unpack.rendering import textures

    room = 8 * 8 * 8
    monkeypatch.setattr(textures, "_driver_holds", lambda grid, _: np.prod(grid) <= room)
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
