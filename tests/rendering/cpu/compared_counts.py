"""The comparison of occlusion counts, exactly."""

from __future__ import annotations

import numpy as np

from napari_unpack.geometry.occlusion_counts import OcclusionCounts

COUNTERS = ("samples", "hits", "occluded_hits", "occluded_samples", "exact_samples")


def assert_same(found: OcclusionCounts, wanted: OcclusionCounts) -> None:
    for name in (*COUNTERS, "ids", "blocks"):
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name), name)


def assert_as_expected(found: OcclusionCounts, expected: dict[str, dict]) -> None:
    """Compare with what `brute_force.occlusion` finds."""
    assert found.ids.tolist() == sorted(expected["samples"])
    for name in COUNTERS:
        counter = getattr(found, name)
        assert {int(i): int(counter[i]) for i in found.ids} == {
            i: expected[name][i] for i in expected["samples"]
        }, name
    pairs = np.argwhere(found.blocks)
    assert {(int(found.ids[a]), int(found.ids[b])) for a, b in pairs} == expected["blocks"]
