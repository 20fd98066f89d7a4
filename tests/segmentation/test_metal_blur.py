import numpy as np
import pytest
from phantoms import ball, box, scanned

from napari_unpack.segmentation.postprocessing.metal_blur import without_blur

SHAPE = (40, 48, 48)
CLOTH, CONTENTS, STEEL = 200.0, 300.0, 7000.0


def coin():
    """Return the mask of a coin of three voxels' thickness."""
    y, x = np.indices(SHAPE[1:])
    mask = np.zeros(SHAPE, bool)
    mask[20:23] = (y - 24) ** 2 + (x - 24) ** 2 <= 10**2
    return mask


def cloth():
    return box(SHAPE, (4, 4, 4), (36, 44, 44))


def overlap(one, other):
    return (one & other).sum() / (one | other).sum()


def found_dense(volume, around):
    """Label cloth 1, and 2 whatever is denser than plastic, as the blur around steel is."""
    return np.where(volume > 600, 2, np.where(around, 1, 0)).astype(np.int32)


def test_a_coin_in_cloth_loses_its_blur_to_the_cloth():
    steel = coin()
    volume = scanned(np.where(steel, 2, cloth()), {1: CLOTH, 2: STEEL})
    found = found_dense(volume, cloth())
    assert overlap(found == 2, steel) < 0.6
    result = without_blur(found, volume)
    assert overlap(result == 2, steel) > 0.9
    assert (result[cloth() & (result != 2)] == 1).all(), "a gap is left around the coin"
    assert (result[found != 2] == found[found != 2]).all()


def test_a_coin_in_air_loses_its_blur_to_the_air():
    steel = coin()
    rag = box(SHAPE, (4, 4, 4), (14, 44, 44))
    volume = scanned(np.where(steel, 2, rag), {1: CLOTH, 2: STEEL})
    found = found_dense(volume, rag)
    result = without_blur(found, volume)
    assert overlap(result == 2, steel) > 0.9 > 0.6 > overlap(found == 2, steel)
    assert set(np.unique(result[(found == 2) & (result != 2)])) == {0}


def test_coins_on_each_other_leave_no_gap_and_swap_nothing():
    pair = np.where(np.indices(SHAPE)[0] < 21, 2, 3) * coin()
    volume = scanned(np.where(coin(), 2, cloth()), {1: CLOTH, 2: STEEL})
    found = np.where(pair, pair, cloth()).astype(np.int32)
    result = without_blur(found, volume)
    kept = (result == found)[coin()]
    assert kept.mean() > 0.9
    assert (result[coin()][~kept] == 1).all()


@pytest.mark.parametrize("wall", [1.0, 2.0])
def test_a_tin_keeps_what_lies_beside_its_wall(wall):
    middle = (20, 24, 24)
    full, hollow = ball(SHAPE, middle, 15), ball(SHAPE, middle, 15 - wall)
    rag = box(SHAPE, (0, 0, 0), (40, 48, 7))
    volume = scanned(
        np.where(full & ~hollow, 2, np.where(hollow, 3, rag)), {1: CLOTH, 2: STEEL, 3: CONTENTS}
    )
    found = np.where(volume > 60, np.where(ball(SHAPE, middle, 17), 2, 1), 0).astype(np.int32)
    assert (without_blur(found, volume) == found).all()


def test_an_insulated_cable_keeps_its_plastic():
    y, x = np.indices(SHAPE[1:])
    apart = np.broadcast_to((y - 24) ** 2 + (x - 24) ** 2, SHAPE)
    volume = scanned(
        np.where(apart <= 2, 2, np.where(apart <= 16, 3, cloth())),
        {1: CLOTH, 2: STEEL, 3: CONTENTS},
    )
    found = np.where(apart <= 16, 2, cloth()).astype(np.int32)
    assert (without_blur(found, volume) == found).all()


def test_what_is_no_metal_stays_as_it_is():
    dense = coin()
    volume = scanned(np.where(dense, 2, cloth()), {1: CLOTH, 2: 1500.0})
    found = found_dense(volume, cloth())
    assert (without_blur(found, volume) == found).all()


def test_it_does_not_matter_where_air_lies_nor_in_which_unit_density_is_nor_what_is_missing():
    steel = coin()
    volume = scanned(np.where(steel, 2, cloth()), {1: CLOTH, 2: STEEL}).astype(float)
    found = found_dense(volume, cloth())
    wanted = without_blur(found, volume)
    assert (without_blur(found, 0.01 * volume - 10.0) == wanted).all()
    volume[20, 24, 30] = np.nan
    volume[0, 0, 0] = -np.inf
    volume[24, 24, 24] = np.inf
    result = without_blur(found, volume)
    assert result[20, 24, 30] == 2
    assert (result == wanted).mean() > 0.999


def test_labels_given_are_not_changed_and_nothing_or_everything_labelled_is_left():
    steel = coin()
    volume = scanned(np.where(steel, 2, cloth()), {1: CLOTH, 2: STEEL})
    found = found_dense(volume, cloth())
    kept = found.copy()
    without_blur(found, volume)
    assert (found == kept).all()
    for labels in (np.zeros(SHAPE, np.int32), np.ones(SHAPE, np.int32)):
        assert (without_blur(labels, volume) == labels).all()


def test_metal_of_which_nearly_nothing_would_be_left_stays_as_it_is():
    dense = box(SHAPE, (20, 20, 20), (23, 23, 23))
    volume = np.where(dense, 3500.0, np.where(cloth(), CLOTH, 0.0)).astype(np.float32)
    volume[21, 21, 21] = 9000.0
    found = np.where(dense, 2, cloth()).astype(np.int32)
    assert (without_blur(found, volume) == found).all()
