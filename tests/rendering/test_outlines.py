import numpy as np

from napari_unpack.rendering.outlines import Ink, outlined

RED, BLUE = Ink((1.0, 0.0, 0.0, 0.8)), Ink((0.0, 0.0, 1.0, 1.0), width=2, fill=0.2)


def picture() -> np.ndarray:
    ids = np.zeros((40, 50), np.int32)
    ids[5:25, 5:25], ids[5:25, 25:45], ids[30:40, 0:20] = 3, 7, 9
    return ids


def test_outlines_run_inside_those_who_are_marked_and_nowhere_else():
    found = outlined(picture(), {3: RED, 7: BLUE})
    assert found.shape == (40, 50, 4)
    assert found[15, 15].max() < 1e-3
    assert found[15, 5, 0] > 0.25 > found[15, 5, 2]
    assert found[15, 25, 2] > 0.5
    np.testing.assert_allclose(found[15, 35], [0, 0, 0.2, 0.2], atol=1e-3)
    assert found[30:, :25].max() < 1e-3
    assert (found[..., :3].max(axis=-1) <= found[..., 3] + 1e-6).all()


def test_an_outline_closes_at_the_edge_of_the_picture():
    found = outlined(picture(), {9: RED})
    assert found[35, 0, 0] > 0.25
    assert found[39, 10, 0] > 0.25


def test_nobody_marked_is_an_empty_picture():
    assert not outlined(picture(), {}).any()
    assert not outlined(picture(), {55: RED}).any()
