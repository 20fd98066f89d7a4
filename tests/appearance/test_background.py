from __future__ import annotations

import imageio.v3 as iio
import numpy as np
import pytest
from PIL import Image

from napari_unpack.appearance import Background, Decorations


def test_one_colour_fills_all():
    image = Background.of("#ff8000").paint((2, 3))
    assert image.shape == (2, 3, 4)
    np.testing.assert_allclose(image, np.broadcast_to([1, 128 / 255, 0, 1], (2, 3, 4)), atol=1e-6)


def test_a_gradient_goes_from_top_to_bottom():
    image = Background.of(((1, 0, 0), (0, 0, 1))).paint((3, 2))
    np.testing.assert_allclose(image[:, 0], [[1, 0, 0, 1], [0.5, 0, 0.5, 1], [0, 0, 1, 1]])
    same = Background.of("#ff0000,#0000ff").paint((3, 2))
    np.testing.assert_allclose(image, same)


def test_transparent_colours_are_premultiplied():
    np.testing.assert_allclose(
        Background.of((1, 0.5, 0, 0.5)).paint((1, 1))[0, 0], [0.5, 0.25, 0, 0.5]
    )


def test_a_picture_covers_and_is_cut_at_the_edges(tmp_path):
    picture = np.zeros((4, 8, 3), np.uint8)
    picture[:, :2], picture[:, 2:6], picture[:, 6:] = (255, 0, 0), (0, 255, 0), (0, 0, 255)
    image = Background.of(picture).paint((4, 4))
    np.testing.assert_allclose(image, np.broadcast_to([0, 1, 0, 1], (4, 4, 4)), atol=1e-6)
    iio.imwrite(tmp_path / "a.png", picture)
    np.testing.assert_array_equal(Background.of(str(tmp_path / "a.png")).image, picture)


def test_light_and_dark_are_told_apart_for_the_ink():
    assert Decorations.of("light").ink[0] < 0.5
    assert Decorations.of("daylight").ink[0] < 0.5
    assert Decorations.of("dusk").ink[0] > 0.5


@pytest.mark.parametrize("name", ["still.gif", "moving.gif", "film.tif"])
def test_of_an_animation_the_first_frame_is_taken(tmp_path, name):
    red, blue = (Image.new("RGB", (9, 8), colour) for colour in ("red", "blue"))
    more = [] if name == "still.gif" else [blue, red]
    red.save(tmp_path / name, save_all=True, append_images=more)
    found = Background.of(tmp_path / name).image
    np.testing.assert_array_equal(found, np.broadcast_to([255, 0, 0], (8, 9, 3)))


def test_pictures_of_every_usual_kind_are_read_as_their_colours(tmp_path):
    grey = np.array([[0, 100], [200, 255]], np.uint8)
    wanted = np.stack([grey] * 3, axis=2)
    picture = Image.fromarray(grey)
    for kind in ("L", "LA", "P", "RGB", "RGBA"):
        picture.convert(kind).save(tmp_path / f"{kind}.png")
        found = Background.of(tmp_path / f"{kind}.png").image
        np.testing.assert_array_equal(found, wanted, err_msg=kind)
    # Each value times 257, which is the same grey in 16 bits.
    iio.imwrite(tmp_path / "deep.png", grey.astype(np.uint16) * 257)
    np.testing.assert_array_equal(Background.of(tmp_path / "deep.png").image, wanted)
    # Ink, not light: 255 of black is black.
    ink = np.zeros((16, 16, 4), np.uint8)
    ink[..., 3] = 255
    Image.fromarray(ink, "CMYK").save(tmp_path / "ink.jpg")
    assert Background.of(tmp_path / "ink.jpg").image.max() < 4


@pytest.mark.parametrize(
    ("dtype", "white"),
    [(np.int32, 255), (np.int32, 65535), (np.float32, 1), (np.float32, 255), (np.float32, 65535)],
)
def test_pictures_of_wide_numbers_are_as_light_as_their_range_tells(tmp_path, dtype, white):
    grey = np.array([[0, 51], [102, 255]])
    Image.fromarray((grey / 255 * white).astype(dtype)).save(tmp_path / "grey.tif")
    found = Background.of(tmp_path / "grey.tif").image
    np.testing.assert_array_equal(found, np.stack([grey] * 3, axis=2))


def test_a_highlight_makes_no_picture_dark():
    picture = np.full((20, 20, 3), 0.6)
    picture[3, 4] = 40.0
    found = Background.of(picture).image
    assert found[0, 0].tolist() == [153, 153, 153]
    assert found[3, 4].tolist() == [255, 255, 255]


def test_the_whole_range_of_unsigned_numbers_is_from_black_to_white():
    picture = np.zeros((2, 2, 3), np.uint32)
    picture[0] = 2**32 - 1
    found = Background.of(picture).image
    assert (found[0].min(), found[1].max()) == (255, 0)


@pytest.mark.parametrize("value", [1e6, np.nan, np.inf])
def test_a_picture_without_a_known_white_is_refused_in_a_sentence(value):
    picture = np.zeros((4, 4, 3), np.float32)
    picture[0, 0, 0] = value
    with pytest.raises(ValueError, match="background must be a picture of values up to 1, 255 or"):
        Background.of(picture)


@pytest.mark.parametrize(
    "wanted",
    [
        "puce",
        "#12345",
        (1, 1),
        (2, 0, 0),
        "a.png",
        np.zeros((4, 4, 2)),
        "white,black,white",
        np.zeros((2, 4, 4, 3), np.uint8),
        None,
        5,
        (),
        (None, 1, 1),
    ],
)
def test_what_is_no_background_is_refused(wanted):
    with pytest.raises(ValueError, match="background"):
        Background.of(wanted)


def test_an_unknown_decoration_is_refused():
    with pytest.raises(ValueError, match="out of box, scale"):
        Decorations.of("dark", ["tinsel"])
