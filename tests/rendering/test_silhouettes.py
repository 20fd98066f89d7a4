import numpy as np
import pytest

from napari_unpack.rendering.outlines import Silhouette, decorated

EDGE = Silhouette((0, 0, 1, 1), 2.0, (0, 1, 0, 1), shadow_offset=(2.0, 3.0), shadow_size=7.0)


@pytest.fixture
def disc():
    picture = np.zeros((24, 24, 4), np.float32)
    row, col = np.indices((24, 24)) - 11.5
    picture[np.hypot(row, col) < 7] = (1, 0, 0, 1)
    return picture


def test_outline_and_shadow_surround_what_is_opaque_and_leave_it_alone(disc):
    m = EDGE.margin
    assert m == 10
    found = decorated(disc, EDGE)
    assert found.shape == (44, 44, 4)
    assert found.dtype == np.float32
    inside = disc[..., 3] == 1
    np.testing.assert_array_equal(found[m:-m, m:-m][inside], disc[inside])
    # The disc ends at 7 from the middle: the outline reaches to 9, the shadow beyond.
    row, col = np.indices((44, 44)) - 21.5
    ring = (np.hypot(row, col) > 7.3) & (np.hypot(row, col) < 8.2)
    assert found[ring, 2].min() > 0.7
    np.testing.assert_allclose(found[np.hypot(row, col) > 9.7, 2], 0, atol=1e-6)


def test_the_shadow_falls_to_the_right_and_down(disc):
    found = decorated(disc, EDGE)[..., 1]
    row, col = np.indices(found.shape) - 21.5
    middle = (found * row).sum() / found.sum(), (found * col).sum() / found.sum()
    assert middle[0] > 2.0
    assert middle[1] > 1.0


def test_it_is_premultiplied_and_nothing_stays_nothing(disc):
    found = decorated(disc, EDGE)
    assert (found[..., :3].max(axis=2) <= found[..., 3] + 1e-6).all()
    assert found[..., 3].max() <= 1 + 1e-6
    assert not decorated(np.zeros_like(disc), EDGE).any()
