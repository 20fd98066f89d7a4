"""Occlusion ratios from counts, and which objects are unpackable (Li et al. 2012, section 5.1)."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from napari_unpack.geometry.occlusion_counts import OcclusionCounts

Definition = Literal["first_hit", "exact", "eq2", "first_hit_bbox", "listing"]
Rule = Literal["exact", "first_hit", "eq2", "listing"]


def ratios(counts: OcclusionCounts, definition: Definition = "first_hit") -> dict[int, float]:
    """Turn counts into an occlusion ratio for every visible object.

    Parameters
    ----------
    counts : OcclusionCounts
        From an orthographic pass along -D.
    definition : {"first_hit", "exact", "eq2", "first_hit_bbox", "listing"}
        Which ratio; notes below.

    Returns
    -------
    dict of int to float
        Ratio in [0, 1] by ID, 0 being unpackable. Objects that no ray meets are left out, since
        nothing is known about them at this resolution.

    Raises
    ------
    ValueError
        If the definition is unknown, or `first_hit_bbox` is asked of counts without `front_area`.

    Notes
    -----
    Li et al. 2012, section 5.1. `eq2` is equation 2: all samples that project onto a pixel whose
    first object is another, over all samples. `first_hit` is the occlusion-query method with the
    exact denominator (rays that meet the object); `first_hit_bbox` has the paper's approximate
    one. `listing` is the single-pass listing. `exact` also counts what re-appears behind another
    object on a ray where it was first, which the paper's three do not (docs/paper.md, R1).
    """
    if definition not in get_args(Definition):
        raise ValueError(f"definition must be one of {get_args(Definition)}, got {definition!r}")
    if definition == "first_hit_bbox" and counts.front_area is None:
        raise ValueError("definition 'first_hit_bbox' needs counts with front_area")
    ids = np.asarray(counts.ids, dtype=np.int64)
    numerators, denominators = {
        "first_hit": (counts.occluded_hits, counts.hits),
        "first_hit_bbox": (counts.occluded_hits, counts.front_area),
        "exact": (counts.exact_samples, counts.samples),
        "eq2": (counts.occluded_samples, counts.samples),
        "listing": (counts.listing_samples, counts.samples),
    }[definition]
    assert denominators is not None
    met = ids[counts.samples[ids] > 0]
    found = np.minimum(numerators[met] / np.maximum(denominators[met], 1), 1.0)
    return {int(i): float(r) for i, r in zip(met, found, strict=True)}


def unpackable_ids(
    counts: OcclusionCounts, rule: Rule = "exact", tolerance: float = 0.0
) -> tuple[int, ...]:
    """Return the objects that nothing blocks along D, ascending by ID.

    Parameters
    ----------
    counts : OcclusionCounts
        From an orthographic pass along -D at the voxel pitch or finer.
    rule : {"exact", "first_hit", "eq2", "listing"}
        `exact` is what a straight pull needs; the others are the paper's and agree with each
        other.
    tolerance : float
        Ratio in [0, 1) that still counts as unpackable, for noisy scans.

    Raises
    ------
    ValueError
        If the rule is unknown or the tolerance is outside [0, 1).
    """
    if rule not in get_args(Rule):
        raise ValueError(f"rule must be one of {get_args(Rule)}, got {rule!r}")
    if not 0.0 <= tolerance < 1.0:
        raise ValueError(f"tolerance must be in [0, 1), got {tolerance!r}")
    return tuple(sorted(i for i, r in ratios(counts, rule).items() if r <= tolerance))
