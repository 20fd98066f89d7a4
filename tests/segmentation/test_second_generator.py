"""The second generator keeps its promises, and its bags are segmented not too badly."""

import ast
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.second_generator import second_bag, touching

from napari_unpack import score, segment

ROOT = Path(__file__).parents[2]
SMALL = (72, 80, 88)


def test_it_shares_no_code_with_the_first() -> None:
    for name in ("second_generator.py", "second_solids.py"):
        tree = ast.parse((ROOT / "benchmarks" / name).read_text())
        names = [n.module or "" for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
        names += [a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names]
        assert not [n for n in names if n.startswith("napari_unpack")]


def test_touching_counts_faces_by_hand() -> None:
    labels = np.zeros((3, 3, 5), np.uint16)
    labels[1, 1, 1:3] = 1
    labels[1, 1, 3] = 2
    table = touching(labels)
    assert table.faces.tolist() == [10, 6]
    assert table.shared.tolist() == [1, 1]


@pytest.mark.parametrize("seed", range(4))
def test_most_objects_touch_and_many_over_a_tenth_of_their_surface(seed: int) -> None:
    bag = second_bag(seed, SMALL, 14)
    contact = touching(bag.labels)
    assert len(bag.objects) >= 12
    assert (contact.shared > 0).mean() >= 0.6
    assert (contact.share > 0.1).mean() >= 0.25


def test_objects_are_whole_dense_and_told_by_kind() -> None:
    bag = second_bag(3, SMALL, 14)
    assert bag.volume.dtype == bag.labels.dtype == np.uint16
    assert np.bincount(bag.labels.ravel())[1:].tolist() == bag.objects.voxels.tolist()
    assert set(bag.objects.group) <= {"bulk", "sheet", "liquid", "metal"}
    for name in bag.objects.index:
        assert ndimage.label(bag.labels == name)[1] == 1
        if bag.objects.kind[name] != "shell":
            inside = ndimage.binary_erosion(bag.labels == name, iterations=2)
            if inside.sum() > 50:
                middle = np.median(bag.volume[inside])
                assert middle == pytest.approx(bag.objects.density[name], rel=0.15)


def test_a_seed_gives_one_bag_and_another_another() -> None:
    one, same, other = second_bag(5, SMALL, 6), second_bag(5, SMALL, 6), second_bag(6, SMALL, 6)
    assert np.array_equal(one.volume, same.volume)
    assert np.array_equal(one.labels, same.labels)
    assert not np.array_equal(one.labels, other.labels)


def test_a_bag_is_segmented_above_a_floor() -> None:
    # Well under what was measured (0.83): it catches collapses.
    bag = second_bag(101, SMALL, 14)
    assert score(bag.labels, segment(bag.volume).labels)["f1"] >= 0.65
