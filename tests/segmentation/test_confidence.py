from zipfile import ZipFile

import numpy as np
import pytest
from phantoms import ball, box, packed, scanned, superquadric

from napari_unpack.segmentation.common.convex_hull import solidity
from napari_unpack.segmentation.common.measures import chamfer_depth, quantiles
from napari_unpack.segmentation.common.region import Region
from napari_unpack.segmentation.confidence.features import FEATURES, features
from napari_unpack.segmentation.confidence.mixture import Mixture
from napari_unpack.segmentation.confidence.oracle import Oracle, fit_features
from napari_unpack.segmentation.confidence.reasons import reasons
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
    assert row["compactness"] == pytest.approx(0, abs=0.1)
    assert row["elongation"] == pytest.approx(0, abs=0.01)
    assert row["flatness"] == pytest.approx(0, abs=0.01)
    assert row["thickness"] == pytest.approx(0, abs=0.06)
    # The mean depth of a ball is a quarter of its radius.
    assert row["depth_ratio"] == pytest.approx(0.25, abs=0.03)
    assert row["solidity"] > 0.93
    # Density 1000 inside, 0 outside, no noise: every step is the median, none is inside.
    for name in ("spread", "quartiles", "skew", "l1_mean", "l2_high", "rayleigh", "material_cut"):
        assert row[name] == pytest.approx(0, abs=1e-6), name
    assert row["weak_boundary"] == row["dense_boundary"] == row["lobes_60"] == 0
    assert row["weighted_cut"] == row["high_to_low_cut"] == pytest.approx(np.log(2))
    assert row["low_to_high_cut"] == 0
    assert row["blur_index"] == pytest.approx(1)
    # A fifth of the radius is 1 - 0.8^3 of the volume.
    assert row["shell_share"] == pytest.approx(0.488, abs=0.06)
    assert row["ellipsoid_fill"] == pytest.approx(1, abs=0.03)
    # A ball of radius 18 in a box of 37 voxels, and r |b| S / m V = 3.
    assert row["box_fill"] == pytest.approx(4 / 3 * np.pi * 18**3 / 37**3, abs=0.005)
    assert row["cut_over_volume"] == pytest.approx(np.log(3), abs=0.06)


def test_two_materials_in_one_region_show():
    mask = box((20, 20, 40), (2, 2, 2), (18, 18, 38))
    density = np.where(np.arange(40) < 22, 500.0, 1500.0) * mask
    one, two = (
        dict(zip(FEATURES, features(region_of(mask, d)), strict=True))
        for d in (mask * 500.0, density)
    )
    assert two["two_materials"] > one["two_materials"] + 0.5
    assert two["spread"] > 0.4
    # 16 x 16 faces cut 16 of 36 layers off.
    radius = np.cbrt(3 * 16 * 16 * 36 / 4 / np.pi)
    assert two["material_cut"] == pytest.approx(np.log1p(radius / 16), abs=0.01)


@pytest.mark.parametrize("axes", [(0, 1), (0, 2), (1, 2), "mirror"])
def test_features_do_not_change_under_quarter_turns_and_mirrors(axes):
    rng = np.random.default_rng(1)
    mask = superquadric(rng, 12)
    density = rng.normal(1000, 50, mask.shape) * (0.3 + 0.7 * mask)
    change = (lambda a: a[::-1].copy()) if axes == "mirror" else (lambda a: np.rot90(a, axes=axes))
    turned = region_of(change(mask).copy(), change(density).copy())
    np.testing.assert_allclose(features(turned), features(region_of(mask, density)), atol=1e-5)


def test_features_do_not_depend_on_the_place_or_the_unit_of_density():
    rng = np.random.default_rng(2)
    mask = superquadric(rng, 10)
    density = rng.normal(1000, 50, mask.shape) * mask
    wide = np.pad(density, ((5, 3), (0, 7), (2, 2)))
    moved = Region(mask, density, (5, 0, 2), UNIT, wide)
    alone = Region(mask, density, (2, 2, 2), UNIT, np.pad(density, 2))
    np.testing.assert_allclose(features(moved)[:14], features(alone)[:14])
    other = Region(mask, density * 3.5, (2, 2, 2), UNIT, np.pad(density * 3.5, 2))
    np.testing.assert_allclose(features(other), features(alone), atol=1e-6)


def test_the_density_beyond_the_box_is_seen():
    whole = np.full((10, 10, 20), 1000.0)
    mask = np.ones((10, 10, 10), bool)
    half = Region(mask, whole[:, :, :10], (0, 0, 0), UNIT, whole)
    row = dict(zip(FEATURES, features(half), strict=True))
    # Only the cut face has a beyond, and that is the same matter: one weak plane of six faces.
    assert row["weak_boundary"] == 1
    assert row["weak_plane"] == pytest.approx(1 / 6, abs=0.06)


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


def test_the_chamfer_distance_is_the_length_of_the_shortest_way_out():
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    rng = np.random.default_rng(0)
    mask, spacing = rng.random((5, 6, 7)) < 0.9, (2.0, 1.0, 1.5)
    padded = np.pad(mask, 1)
    index = np.arange(padded.size).reshape(padded.shape)
    one, two, length = [], [], []
    for step in np.ndindex(3, 3, 3):
        move = np.array(step) - 1
        if move.any():
            shifted = np.roll(index, -move, (0, 1, 2))
            one.append(index[1:-1, 1:-1, 1:-1].ravel())
            two.append(shifted[1:-1, 1:-1, 1:-1].ravel())
            length.append(np.full(mask.size, np.linalg.norm(move * spacing)))
    graph = coo_array(
        (np.concatenate(length), (np.concatenate(two), np.concatenate(one))), (padded.size,) * 2
    )
    outside = index[~padded]
    expected = dijkstra(graph.tocsr(), indices=outside, min_only=True).reshape(padded.shape)
    found = chamfer_depth(mask, spacing)
    np.testing.assert_allclose(found[mask], expected[1:-1, 1:-1, 1:-1][mask], rtol=1e-5)
    assert not found[~mask].any()


def test_quantiles_are_those_of_the_sorted_values():
    values = np.random.default_rng(0).normal(size=5000).astype(np.float32)
    found = quantiles(values, [0.05, 0.5, 0.95])
    np.testing.assert_allclose(found, np.quantile(values, [0.05, 0.5, 0.95]), atol=5e-3)
    assert quantiles(np.full(3, 7, np.float32), [0.1, 0.9]).tolist() == [7, 7]


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
    oracle.save(path)
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    np.savez(path, **arrays | {"center": arrays["center"][:5]})
    with pytest.raises(ValueError, match="do not fit"):
        Oracle.load(path)
    # Of fitting shapes, and yet the first repair would fail by it.
    for name, change in (("scale", 0), ("good_weights", -1), ("good_covariances", -1)):
        np.savez(path, **arrays | {name: change * arrays[name]})
        with pytest.raises(ValueError, match="are those of no model"):
            Oracle.load(path)
    with pytest.raises(FileNotFoundError):
        Oracle.load(tmp_path / "none.npz")
    with ZipFile(path, "w") as archive:
        archive.writestr("session.json", "{}")
        archive.writestr("picture.png", b"")
    found = "is not an oracle: it holds session.json, picture.png, and an oracle holds arrays"
    with pytest.raises(ValueError, match=found):
        Oracle.load(path)


def test_too_few_objects_to_learn_from_are_refused():
    with pytest.raises(ValueError, match="at least 8"):
        Oracle.fit([region_of(ball((9, 9, 9), (4, 4, 4), 3))])


def test_single_voxels_and_lines_can_be_classifierd():
    for mask in (np.ones((1, 1, 1), bool), np.ones((1, 1, 9), bool), np.ones((1, 5, 9), bool)):
        assert np.isfinite(features(region_of(mask))).all()


def test_a_mixture_has_the_tails_of_students_distribution():
    from scipy.stats import multivariate_t

    rng = np.random.default_rng(5)
    means = rng.normal(size=(2, 3))
    shapes = np.array([np.diag([1.0, 2.0, 0.5]), [[1, 0.4, 0], [0.4, 1, 0], [0, 0, 2]]])
    points = rng.normal(size=(20, 3)) * 4
    found = Mixture(np.array([0.3, 0.7]), means, shapes).log_density(points)
    parts = [
        w * multivariate_t(m, s, df=10).pdf(points)
        for w, m, s in zip((0.3, 0.7), means, shapes, strict=True)
    ]
    np.testing.assert_allclose(found, np.log(np.sum(parts, axis=0)))


def test_two_scanners_objects_are_both_known_though_they_look_unlike():
    rng = np.random.default_rng(6)
    width = len(FEATURES)
    far = rng.normal(size=width) * 6
    good = [rng.normal(size=(120, width)), rng.normal(size=(120, width)) + far]
    shift = np.where(np.arange(width) % 2, 2.0, -2.0)
    bad = [rows + shift for rows in good]
    oracle = fit_features(good, bad)
    for rows, wrong in zip(good, bad, strict=True):
        assert oracle.scores(rows).mean() > 0.8
        assert oracle.scores(wrong).mean() < 0.2
    with pytest.raises(ValueError, match="8 wrong"):
        fit_features(good, [bad[0], bad[1][:3]])


def test_the_measures_that_lowered_a_confidence_are_named():
    rng = np.random.default_rng(0)
    good = rng.normal(0, 1, (400, len(FEATURES)))
    at = FEATURES.index("two_materials")
    bad = good + 6 * (np.arange(len(FEATURES)) == at)
    oracle = fit_features(good, bad)
    usual, odd = oracle.center.copy(), oracle.center.copy()
    odd[at] += 6
    assert reasons(oracle, usual) == ()
    assert reasons(oracle, odd)[0] == "it is of two materials"
    assert len(reasons(oracle, rng.normal(4, 2, len(FEATURES)))) <= 3
    # What is little more than usual is said to be that, and what is as usual is not named.
    near = fit_features(good, good + 2 * (np.arange(len(FEATURES)) == at))
    for more, words in ((0.9, ()), (1.5, ("it is more like two materials than usual",))):
        odd = near.center + more * near.scale * (np.arange(len(FEATURES)) == at)
        assert near.scores(odd[None]) < 0.8
        assert reasons(near, odd) == words


def test_what_is_no_fault_is_no_reason():
    rng = np.random.default_rng(0)
    at = FEATURES.index("lobes_60")
    good = rng.normal(0, 1, (400, len(FEATURES)))
    oracle = fit_features(good, good - 6 * (np.arange(len(FEATURES)) == at))
    assert reasons(oracle, oracle.center - 6 * (np.arange(len(FEATURES)) == at)) == ()
