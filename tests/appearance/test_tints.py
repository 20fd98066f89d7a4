from __future__ import annotations

import numpy as np
import pytest

from napari_unpack.appearance import hsv_to_rgb, perceptual_to_rgb, tints_of


def test_hsv_hues_have_full_saturation_and_value():
    np.testing.assert_allclose(
        hsv_to_rgb([0, 1 / 6, 1 / 3, 1 / 2, 2 / 3, 5 / 6, 1 / 12]),
        [[1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1], [1, 0, 1], [1, 0.5, 0]],
        atol=1e-12,
    )


def test_the_table_is_zero_for_the_background_and_what_has_no_hue():
    table = tints_of({3: 1 / 3}, 4, mode="hsv")
    assert table.dtype == np.float32
    np.testing.assert_allclose(
        table, [[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 1, 0, 1], [0, 0, 0, 0]], atol=1e-6
    )


def test_no_hues_make_an_empty_table():
    assert not tints_of({}, 3).any()


@pytest.mark.parametrize("arguments", [({5: 0.1}, 4), ({0: 0.1}, 4)])
def test_ids_outside_the_table_are_refused(arguments):
    with pytest.raises(ValueError, match="hues must be of IDs 1 to 4"):
        tints_of(*arguments)


def test_an_unknown_mode_is_refused():
    with pytest.raises(ValueError, match="mode must be"):
        tints_of({1: 0.1}, 1, mode="cmyk")


def lab(rgb: np.ndarray) -> np.ndarray:
    from skimage.color import rgb2lab

    return rgb2lab(rgb)


def test_the_perceptual_ring_is_in_gamut_colourful_and_of_similar_lightness():
    rgb = perceptual_to_rgb(np.linspace(0, 1, 200, endpoint=False))
    assert rgb.min() >= 0
    assert rgb.max() <= 1
    colors = lab(rgb)
    assert np.ptp(colors[:, 0]) < 30  # HSV's own spans 65
    assert np.hypot(colors[:, 1], colors[:, 2]).min() > 30


def test_equal_steps_of_hue_are_more_even_to_the_eye_than_hsv():
    hues = np.linspace(0, 1, 48, endpoint=False)

    def unevenness(to_rgb):
        from skimage.color import deltaE_ciede2000

        colors = lab(to_rgb(hues))
        steps = deltaE_ciede2000(colors, np.roll(colors, -1, axis=0))
        return steps.max() / steps.min()

    assert unevenness(perceptual_to_rgb) < 0.6 * unevenness(hsv_to_rgb)


def test_the_ring_closes_without_a_seam():
    ends = perceptual_to_rgb([0.0, 0.999999])
    np.testing.assert_allclose(ends[0], ends[1], atol=0.01)
