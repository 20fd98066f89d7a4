"""Segmentation of held-out bags and its cost, against EDT + watershed of the same foreground."""

from __future__ import annotations

import time

import numpy as np

from benchmarks.row import Row, ms
from benchmarks.scenes import Scenes
from benchmarks.segmentation.peers import watersheds
from napari_unpack import score, segment, simulate_bag

HELD_OUT = (9001, 9002, 9003)
"""Seeds that nobody may tune anything on."""

SHAPE, COUNT = (160, 176, 256), 30


def measure(scenes: Scenes) -> list[Row]:
    shape = scenes.shape(*SHAPE)
    seeds = HELD_OUT[: 1 if scenes.quick else None]
    ours: list[dict[str, float]] = []
    peers: dict[str, list[dict[str, float]]] = {}
    seconds, peer_seconds = 0.0, 0.0
    for seed in seeds:
        bag = simulate_bag(seed=seed, shape=shape, count=COUNT)
        start = time.perf_counter()
        found = segment(bag.volume, bag.spacing).labels
        seconds += time.perf_counter() - start
        ours.append(score(bag.labels, found))
        start = time.perf_counter()
        for name, labels in watersheds(bag.volume, bag.spacing):
            peer_seconds += time.perf_counter() - start
            peers.setdefault(name, []).append(score(bag.labels, labels))
            start = time.perf_counter()
    best = max(peers.values(), key=lambda scores: _mean(scores, "f1"))
    f1, voi = _mean(ours, "f1"), _mean(ours, "voi")
    peer_f1, peer_voi = _mean(best, "f1"), _mean(best, "voi")
    work = f"{len(seeds)} held-out bags of {COUNT} touching objects, {'x'.join(map(str, shape))}"
    return [
        Row(
            "segmentation accuracy",
            work,
            f"F1 {f1:.2f}, VOI {voi:.2f} bits",
            f"EDT + watershed, best of {len(peers)}: F1 {peer_f1:.2f}, VOI {peer_voi:.2f}",
            f"{f1 / peer_f1:.2f}" if peer_f1 else "",
            "F1 >= 0.85, VOI <= 0.40",
            f1 >= 0.85 and voi <= 0.40,
        ),
        _cost(seconds / len(seeds), peer_seconds / len(seeds) / len(peers)),
    ]


def _cost(ours: float, peer: float) -> Row:
    return Row(
        "segmentation time",
        "the same, one bag; what it costs at full size is below",
        ms(ours * 1e3),
        f"EDT + peaks + watershed: {ms(peer * 1e3)}",
        f"{ours / peer:.2f}",
    )


def _mean(scores: list[dict[str, float]], name: str) -> float:
    return float(np.mean([s[name] for s in scores]))
