"""Segmentation of 512 x 512 x 1024, and how its cost grows to there."""

from __future__ import annotations

from benchmarks.row import Row
from benchmarks.scale import FACTORS, cost, flatness
from benchmarks.scenes import Scenes


def measure(scenes: Scenes) -> list[Row]:
    costs = [cost(factor) for factor in FACTORS[: 2 if scenes.quick else None]]
    full = costs[-1]
    each = ", ".join(f"{c.seconds / c.voxels * 1e6:.2f}" for c in costs)
    bytes_each = ", ".join(f"{c.peak / c.voxels:.0f}" for c in costs)
    shape = "x".join(map(str, full.shape))
    growth = flatness(costs)
    return [
        Row(
            "segmentation cost",
            f"{shape}, 27 objects, {full.filled:.0%} filled",
            f"{full.seconds:.0f} s, {full.peak / 1e9:.1f} GB",
            "the first version, whole: 238 s, 11 GB; EDT + peaks + watershed: 166 s, 9.1 GB",
            f"{full.seconds / 166:.2f}",
            "<= 60 s, <= 6 GB",
            full.seconds <= 60 and full.peak <= 6e9,
        ),
        Row(
            "segmentation scale",
            "the same at 1/64, 1/8 and full size",
            f"{each} us a voxel; {bytes_each} bytes a voxel",
            goal="no size dearer a voxel than 1.5x a smaller one",
            met=growth <= 1.5,
        ),
    ]
