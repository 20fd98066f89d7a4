import numpy as np
import pytest

from napari_unpack.appearance import Decorations
from napari_unpack.geometry.view import View
from napari_unpack.rendering.compose import packed_image, scene_image
from napari_unpack.session import Session


@pytest.fixture
def session():
    labels = np.zeros((12, 12, 24), np.uint16)
    labels[2:10, 2:10, 2:10], labels[2:10, 2:10, 14:22] = 1, 2
    made = Session(labels * 1000, labels)
    made.view = View(direction=(1.0, 0.0, 0.0))
    return made


def halves(image):
    """Alpha of the left and right half of the shown bag."""
    alpha = image[..., 3]
    return alpha[:, : alpha.shape[1] // 2].max(), alpha[:, alpha.shape[1] // 2 :].max()


def test_a_plane_takes_away_one_of_two_and_the_scene_is_cast_again(session):
    camera, size = session.camera, (48, 64)
    clear = Decorations.of((0.0, 0.0, 0.0, 0.0))
    assert min(halves(scene_image(session.scene(), camera, size, decorations=clear))) > 0.5
    session.clipping = [[[0, 0, 12], [0, 0, 2.0]]]
    left, right = sorted(halves(scene_image(session.scene(), camera, size, decorations=clear)))
    assert left == 0
    assert right > 0.5
    session.clipping = None
    assert min(halves(scene_image(session.scene(), camera, size, decorations=clear))) > 0.5


def test_hues_are_chosen_for_what_is_left_and_blocking_stays(session):
    session.clipping = [[[0, 0, 12], [0, 0, 1]]]
    assert set(session.queries.hues()) == {2}
    session.direction = "+x"
    assert session.unpackable() == (2,)


def test_a_change_is_told_and_the_same_planes_are_not(session):
    heard = []
    session.events.transfer_function.connect(heard.append)
    session.clipping = [[[0, 0, 12], [0, 0, 1]]]
    session.clipping = [[[0, 0, 12], [0, 0, 1]]]
    assert len(heard) == 1
    with pytest.raises(ValueError, match="read-only"):
        session.clipping[0, 0, 0] = 5


@pytest.mark.parametrize(
    "planes",
    [[[0, 0, 1]], np.ones((9, 2, 3)), [[[0, 0, 0], [0, 0, 0]]], [[[np.nan, 0, 0], [0, 0, 1]]]],
)
def test_planes_that_are_none_are_refused(session, planes):
    with pytest.raises(ValueError, match="clipping must"):
        session.clipping = planes


def test_flying_objects_are_whole(session):
    camera, size = session.camera, (48, 64)
    whole = packed_image(session.scene(), camera, size, backend="cpu").rgba.sum()
    session.clipping = [[[0, 0, 12], [0, 0, 1]]]
    assert packed_image(session.scene(), camera, size, backend="cpu").rgba.sum() < 0.6 * whole
    session.unpack([1])
    sprites = scene_image(
        session.scene(), camera, (96, 128), decorations=Decorations.of((0, 0, 0, 0))
    )
    session.clipping = None
    np.testing.assert_allclose(
        scene_image(session.scene(), camera, (96, 128), decorations=Decorations.of((0, 0, 0, 0))),
        sprites,
    )
