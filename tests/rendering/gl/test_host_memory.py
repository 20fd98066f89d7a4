"""Memory for pixels read back: used again, but never while anybody looks at it."""

import numpy as np
import pytest

from napari_unpack.rendering.gl.host_memory import HostMemory

SHAPE = (3, 4, 2)


def test_memory_of_an_array_that_is_gone_is_used_again():
    memory = HostMemory()
    place = memory.array(SHAPE).ctypes.data
    assert memory.array(SHAPE).ctypes.data == place


@pytest.mark.parametrize(
    "kept",
    [
        lambda a: a,
        lambda a: a[1:, ::2],
        lambda a: a[:, :, 0][1:].T,
        lambda a: a.reshape(-1)[3:],
        lambda a: np.moveaxis(a, 2, 0),
        lambda a: a.view(np.uint8)[..., :4],
        lambda a: np.lib.stride_tricks.sliding_window_view(a, (2, 2, 1)),
        lambda a: memoryview(a),
        lambda a: iter(a),
        lambda a: a.flat,
        lambda a: np.asarray(memoryview(a))[0],
    ],
)
def test_no_array_lies_where_anything_of_an_earlier_one_is_still_held(kept):
    memory = HostMemory()
    held = []
    for i in range(6):
        array = memory.array(SHAPE)
        array[...] = i
        held.append(kept(array))
        del array
    for i, view in enumerate(held):
        assert np.all(
            np.asarray(list(view) if hasattr(view, "__next__") else view)
            == np.asarray(
                list(kept(np.full(SHAPE, i, np.float32)))
                if hasattr(view, "__next__")
                else kept(np.full(SHAPE, i, np.float32))
            )
        )


def test_arrays_of_two_sizes_and_kinds_take_turns():
    memory = HostMemory()
    places = set()
    image = depth = None
    for _ in range(10):
        # What a loop does: the earlier pair is held until the next is there.
        image, depth = memory.array((8, 8, 4)), memory.array((8, 8, 1))
        places |= {image.ctypes.data, depth.ctypes.data}
    assert len(places) == 4


def test_pictures_that_are_kept_stay_as_they_were(gl):
    from test_parity import Case

    from napari_unpack.rendering.gl import backend as gl_backend

    case = Case(4)
    pictures, copies = [], []
    for share in (1.0, 0.8, 0.6, 0.4, 0.2):
        tints = case.tints * np.float32([share, 1, 1, 1])
        look = (case.table, case.domain, tints, case.shading)
        image, depth = gl_backend.tinted(case.volume, case.labels, case.rays, case.spacing, *look)
        pictures.append((image, depth))
        copies.append((image.copy(), depth.copy()))
    for (image, depth), (image_then, depth_then) in zip(pictures, copies, strict=True):
        np.testing.assert_array_equal(image, image_then)
        np.testing.assert_array_equal(depth, depth_then)
    assert np.isinf(pictures[0][1]).any()
