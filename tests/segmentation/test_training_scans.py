"""What the classifiers learn from is what it says it is."""

from functools import partial

import numpy as np
import pytest
from benchmarks.boundaries import volumes
from benchmarks.boundaries.metal_among_cloth import metal_among_cloth
from benchmarks.boundaries.solids import alike_solids
from benchmarks.boundaries.volumes import magnified
from benchmarks.segmentation import training_scans
from benchmarks.segmentation.training_scans import FAMILIES
from scipy.ndimage import binary_dilation, label

# Rays take the longest; among less cloth a place for a thing is looked for longer.
BY_RAYS, AS_DRAWN = (64, 64, 64), (96, 96, 96)


def test_alike_solids_touch_alone_in_air_and_most_have_one_density():
    one_density = 0
    for seed in range(12):
        density, labels = alike_solids(seed)
        several = np.unique(labels)[1:]
        assert 1 <= len(several) <= 5
        # All hang together, and nothing else is there.
        assert label(labels > 0, np.ones((3, 3, 3)))[1] == 1
        assert not density[labels == 0].any()
        one_density += len(np.unique(density[(labels > 0) & (density > 0)])) == 1
        for name in several[1:]:
            around = labels[binary_dilation(labels == name) & (labels != name)]
            assert (around > 0).any()
    assert one_density >= 7


def test_metal_among_cloth_has_both_and_every_thing_a_label():
    density, labels = metal_among_cloth(5500, AS_DRAWN)
    means = np.bincount(labels.ravel(), density.ravel()) / np.maximum(
        np.bincount(labels.ravel()), 1
    )
    assert (means[1:] > 1500).sum() >= 2
    assert ((means[1:] > 0) & (means[1:] < 450)).sum() >= 3
    assert (labels[density > 1000] > 0).all()


def test_magnified_objects_have_the_cube_of_the_factor_as_many_voxels():
    labels = np.zeros((20, 20, 20), np.uint16)
    labels[5:15, 5:15, 5:15] = 1
    finer, names = magnified(labels * np.uint16(1000), labels)
    assert finer.shape == names.shape == (32, 32, 32)
    assert np.count_nonzero(names) == 16**3


@pytest.mark.parametrize(
    "name", ["alike solids", "small bags", "metal among cloth", "metal by rays"]
)
def test_a_scan_of_a_family_has_noise_and_is_the_same_for_one_seed(name, monkeypatch):
    for module, shape in ((training_scans, AS_DRAWN), (volumes, BY_RAYS)):
        monkeypatch.setattr(module, "metal_among_cloth", partial(metal_among_cloth, shape=shape))
    family = FAMILIES[name]
    one, two = (family.make(family.first) for _ in range(2))
    np.testing.assert_array_equal(one.volume, two.volume)
    assert one.volume.shape == one.truth.shape
    assert len(np.unique(one.volume[one.truth == 0])) > 20
