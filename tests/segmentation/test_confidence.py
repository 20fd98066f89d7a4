import numpy as np
import pytest
from phantoms import ball, box, packed, scanned, superquadric

from napari_unpack.segmentation.confidence import Oracle, fit_features
from napari_unpack.segmentation.convexity import solidity
from napari_unpack.segmentation.features import FEATURES, features
from napari_unpack.segmentation.region import Region
from napari_unpack.segmentation.training import halves, merged_pairs, true_objects

UNIT = (1.0, 1.0, 1.0)


def region_of(mask, density=None, spacing=UNIT):
    if density is None:
        density = np.where(mask, 1000.0, 0.0)
    return Region(mask, density, (0, 0, 0), spacing)


@pytest.fixture(scope="module")
def bags():
    """Feature rows of true objects, merged pairs and halves: for training, and for testing."""

    def rows(seeds):
        good, pairs, parts = [], [], []
        for seed in seeds:
            labels, densities = packed(seed, (80, 96, 110), 18, 18, press=3)
            volume = scanned(labels, densities, seed=seed)
            objects = list(true_objects(volume, labels, UNIT, 200))
            good += [features(r) for r in objects]
            pairs += [features(r) for r in merged_pairs(volume, labels, UNIT)]
            parts += [features(r) for r in halves(objects, np.random.default_rng(seed))]
        return np.array(good), np.array(pairs), np.array(parts)

    return rows(range(100, 104)), rows(range(2))


@pytest.fixture(scope="module")
def oracle(bags):
    return fit_features(bags[0][0])


def auroc(good, bad):
    """Return the probability that a good one scores above a bad one, ties by half."""
    above = (good[:, None] > bad[None, :]).mean()
    return above + (good[:, None] == bad[None, :]).mean() / 2


def test_a_ball_has_the_features_worked_out_by_hand():
    row = dict(zip(FEATURES, features(region_of(ball((41,) * 3, (20,) * 3, 18))), strict=True))
    assert row["log_volume"] == pytest.approx(np.log(4 / 3 * np.pi * 18**3), abs=0.02)
    assert row["log_compactness"] == pytest.approx(0, abs=0.1)
    assert row["elongation"] == pytest.approx(0, abs=0.01)
    assert row["flatness"] == pytest.approx(0, abs=0.01)
    assert row["thickness"] == pytest.approx(0, abs=0.06)
    # The mean depth of a ball is a quarter of its radius.
    assert row["depth_ratio"] == pytest.approx(0.25, abs=0.03)
    assert row["solidity"] > 0.93
    for name in ("spread", "tail", "skew", "roughness", "two_materials", "weak_boundary"):
        assert row[name] == pytest.approx(0, abs=1e-6), name


def test_two_materials_in_one_region_show():
    mask = box((20, 20, 40), (2, 2, 2), (18, 18, 38))
    density = np.where(np.arange(40) < 20, 500.0, 1500.0) * mask
    one, two = (
        dict(zip(FEATURES, features(region_of(mask, d)), strict=True))
        for d in (mask * 500.0, density)
    )
    assert two["two_materials"] > one["two_materials"] + 0.5
    assert two["spread"] > 0.4


@pytest.mark.parametrize("axes", [(0, 1), (0, 2), (1, 2)])
def test_features_do_not_change_under_quarter_turns(axes):
    rng = np.random.default_rng(1)
    mask = superquadric(rng, 12)
    density = rng.normal(1000, 50, mask.shape) * mask
    turned = region_of(np.rot90(mask, axes=axes).copy(), np.rot90(density, axes=axes).copy())
    np.testing.assert_allclose(features(turned), features(region_of(mask, density)), atol=1e-5)


def test_features_change_little_under_any_turn():
    from scipy.ndimage import affine_transform
    from scipy.spatial.transform import Rotation

    mask = box((70, 70, 70), (23, 19, 15), (47, 51, 55))
    straight = features(region_of(mask))
    for seed in range(3):
        turn = Rotation.random(random_state=seed).as_matrix()
        center = np.full(3, 34.5)
        tilted = affine_transform(
            mask.astype(np.float32), turn, offset=center - turn @ center, order=1
        )
        assert np.abs(features(region_of(tilted > 0.5)) - straight).max() < 0.2


def test_features_do_not_depend_on_the_voxel_size():
    fine = ball((60, 60, 60), (29.5, 29.5, 29.5), 24)
    coarse = fine.reshape(30, 2, 60, 60).mean(axis=1) > 0.5
    difference = features(region_of(fine)) - features(region_of(coarse, spacing=(2.0, 1.0, 1.0)))
    assert np.abs(difference).max() < 0.15


def test_solidity_of_a_box_and_of_an_angle():
    assert solidity(box((20, 20, 20), (3, 3, 3), (17, 17, 17)), UNIT) > 0.95
    angle = box((4, 22, 22), (0, 0, 0), (4, 20, 4)) | box((4, 22, 22), (0, 0, 0), (4, 4, 20))
    # Two arms of 20 x 4 in a hull of 20 * 20 / 2 + 20 * 4 + 4 * 4 / 2 ... about 272.
    assert solidity(angle, UNIT) == pytest.approx(144 / 272, abs=0.06)
    assert 0 < solidity(np.ones((1, 1, 1), bool), UNIT) <= 1
    assert solidity(np.ones((1, 1, 30), bool), UNIT) > 0.3


def test_true_objects_score_above_merged_pairs_and_halves(bags, oracle):
    _, (good, pairs, parts) = bags
    scores = [oracle.scores(rows) for rows in (good, pairs, parts)]
    assert len(pairs) > 15
    assert auroc(scores[0], scores[1]) >= 0.95
    assert auroc(scores[0], scores[2]) >= 0.9
    assert all(((s >= 0) & (s <= 1)).all() for s in scores)


def test_the_percentile_is_calibrated_on_what_was_learned(bags, oracle):
    scores = oracle.scores(bags[0][0])
    assert np.median(scores) == pytest.approx(0.5, abs=0.02)
    assert (scores < 0.25).mean() == pytest.approx(0.25, abs=0.03)


def test_training_is_reproducible_and_survives_a_file(bags, oracle, tmp_path):
    (train, _, _), (good, _, _) = bags
    again = fit_features(train)
    np.testing.assert_array_equal(again.scores(good), oracle.scores(good))
    oracle.save(tmp_path / "oracle.npz")
    loaded = Oracle.load(tmp_path / "oracle.npz")
    np.testing.assert_array_equal(loaded.scores(good), oracle.scores(good))


def test_a_damaged_foreign_or_old_file_is_refused(oracle, tmp_path):
    path = tmp_path / "oracle.npz"
    oracle.save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match="damaged"):
        Oracle.load(path)
    path.write_text("not an oracle")
    with pytest.raises(ValueError, match="not an oracle"):
        Oracle.load(path)
    np.savez(path, format="napari-unpack oracle 0")
    with pytest.raises(ValueError, match="this version"):
        Oracle.load(path)
    with pytest.raises(FileNotFoundError):
        Oracle.load(tmp_path / "none.npz")


def test_too_few_objects_to_learn_from_are_refused():
    with pytest.raises(ValueError, match="at least 8"):
        Oracle.fit([region_of(ball((9, 9, 9), (4, 4, 4), 3))])


def test_single_voxels_and_lines_can_be_judged():
    for mask in (np.ones((1, 1, 1), bool), np.ones((1, 1, 9), bool), np.ones((1, 5, 9), bool)):
        assert np.isfinite(features(region_of(mask))).all()
