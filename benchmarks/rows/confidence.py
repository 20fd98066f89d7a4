"""How well the shipped confidence tells true objects of unseen bags from false ones."""

from __future__ import annotations

from benchmarks.row import Row
from benchmarks.scenes import Scenes
from benchmarks.train_oracle import UNSEEN, quality
from napari_unpack.segmentation.confidence.oracle import default_oracle

GOAL = 0.95


def measure(scenes: Scenes) -> list[Row]:
    seeds = UNSEEN[: 1 if scenes.quick else len(UNSEEN)]
    found = quality(default_oracle(), seeds)
    return [
        Row(
            "confidence",
            f"objects, merged pairs and halves of {len(seeds)} unseen bags",
            f"AUROC {found['auroc']:.3f}",
            f"one class, as the paper: {found['auroc_one_class']:.3f}",
            f"{found['auroc'] / found['auroc_one_class']:.2f}",
            f"AUROC >= {GOAL}",
            found["auroc"] >= GOAL,
        ),
        Row(
            "confidence of what was found",
            "the segmentation of the same bags",
            f"Spearman with IoU {found['spearman']:.2f}",
            f"calibration error {found['calibration_error']:.3f}",
        ),
    ]
