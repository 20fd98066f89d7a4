from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from napari_unpack.geometry.occlusion_counts import OcclusionCounts
from napari_unpack.unpacking import ratios, unpackable_ids


def counts() -> OcclusionCounts:
    """Three objects seen along x, worked out by hand on one row of three rays.

    Ray 1: A A B B A    Ray 2: A A . . .    Ray 3: . C C B B      (first sample on the left)
    A (1): 5 samples on 2 rays, first on both: eq. 2 gives 0, exact 1/5 (behind B on ray 1).
    B (2): 4 samples on 2 rays, never first: everything occluded.
    C (3): 2 samples on 1 ray, first there: free by every rule.
    """
    return OcclusionCounts(
        ids=np.array([1, 2, 3]),
        samples=np.array([0, 5, 4, 2]),
        hits=np.array([0, 2, 2, 1]),
        occluded_hits=np.array([0, 0, 2, 0]),
        occluded_samples=np.array([0, 0, 4, 0]),
        exact_samples=np.array([0, 1, 4, 0]),
        blocks=np.array([[0, 1, 0], [1, 0, 0], [0, 1, 0]], dtype=bool),
        front_area=np.array([0.0, 4.0, 2.5, 1.0]),
    )


@pytest.mark.parametrize(
    ("definition", "expected"),
    [
        ("eq2", {1: 0.0, 2: 1.0, 3: 0.0}),
        ("listing", {1: 0.0, 2: 1.0, 3: 0.0}),
        ("first_hit", {1: 0.0, 2: 1.0, 3: 0.0}),
        ("first_hit_bbox", {1: 0.0, 2: 0.8, 3: 0.0}),
        ("exact", {1: 0.2, 2: 1.0, 3: 0.0}),
    ],
)
def test_every_definition_gives_the_numbers_of_the_hand_made_case(definition, expected):
    assert ratios(counts(), definition) == pytest.approx(expected)


def test_the_approximate_denominator_never_makes_a_ratio_above_one():
    small = replace(counts(), front_area=np.array([0.0, 1.0, 1.0, 1.0]))
    assert ratios(small, "first_hit_bbox")[2] == 1.0


def test_what_re_enters_behind_another_is_free_by_the_paper_and_not_by_exact():
    for rule in ("first_hit", "eq2", "listing"):
        assert unpackable_ids(counts(), rule) == (1, 3)
    assert unpackable_ids(counts()) == (3,)


def test_a_tolerance_frees_what_is_hardly_blocked():
    assert unpackable_ids(counts(), tolerance=0.199) == (3,)
    assert unpackable_ids(counts(), tolerance=0.2) == (1, 3)


def test_objects_that_no_ray_meets_have_no_ratio():
    unseen = replace(counts(), samples=np.array([0, 5, 4, 0]))
    assert set(ratios(unseen)) == {1, 2}


def test_bad_arguments_are_refused():
    with pytest.raises(ValueError, match="definition must be one of"):
        ratios(counts(), "eq3")
    with pytest.raises(ValueError, match="front_area"):
        ratios(replace(counts(), front_area=None), "first_hit_bbox")
    with pytest.raises(ValueError, match="rule must be one of"):
        unpackable_ids(counts(), "first_hit_bbox")
    with pytest.raises(ValueError, match=r"tolerance must be in \[0, 1\)"):
        unpackable_ids(counts(), tolerance=1.0)
