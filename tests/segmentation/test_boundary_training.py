"""What the network of boundaries learns from, and the command that makes it anew."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from benchmarks.boundaries import __main__ as training
from benchmarks.boundaries import volumes
from benchmarks.boundaries.examples import Source, examples


def test_a_trial_leaves_no_checkpoints_of_the_training(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps: list[int] = []

    def begun(command: list[str]) -> Any:
        """Stand in for a process, which leaves the checkpoint that is asked for."""
        if "--rank=1" not in command and "benchmarks.boundaries.train" in command:
            Path(command[4]).touch()
            steps.append(int(next(a for a in command if a.startswith("--steps="))[8:]))
        return SimpleNamespace(wait=lambda: 0, kill=lambda: None)

    def run(*more: str) -> list[int]:
        steps.clear()
        monkeypatch.setattr(sys, "argv", ["", "a.onnx", "--folder", str(tmp_path), *more])
        training.main()
        return [*steps]

    monkeypatch.setattr(subprocess, "Popen", begun)
    assert run("--shorten", "130") == [4, 3, 13, 9, 12, 14, 6, 14, 31]
    assert run("--shorten", "130") == []
    assert run() == [500, 300, 1650, 1100, 1450, 1700, 750, 1800, 4000]
    assert run() == []


def test_a_volume_that_was_cut_short_by_a_stop_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(path: Path, array: np.ndarray) -> None:
        path.write_bytes(b"\x93NUMPY")
        if "labels" not in path.name:
            raise KeyboardInterrupt

    kind = volumes.Kind(lambda _: (np.ones((2, 2, 2), np.uint16),) * 2, range(1))
    monkeypatch.setitem(volumes.KINDS, "bag", kind)
    monkeypatch.setattr(sys, "argv", ["", str(tmp_path), "bag", "0", "1"])
    with monkeypatch.context() as during:
        during.setattr(np, "save", stopped)
        with pytest.raises(KeyboardInterrupt):
            volumes.main()
    assert [path.name for path in tmp_path.iterdir()] == ["bag0-labels.npy"]
    volumes.main()
    assert np.load(tmp_path / "bag0-density.npy").shape == (2, 2, 2)


def test_patches_are_drawn_by_share_and_what_is_scanned_is_not_scanned_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    labels = np.zeros((64, 64, 64), np.uint16)
    labels[8:56, 8:56, 8:32], labels[8:56, 8:56, 32:56] = 1, 2
    density = np.where(labels > 0, 1000, 0).astype(np.uint16)
    for kind in ("bag", "bag-by-rays"):
        seed = volumes.KINDS[kind].seeds[0]
        np.save(tmp_path / f"{kind}{seed}-density.npy", density)
        np.save(tmp_path / f"{kind}{seed}-labels.npy", labels)
    rng = np.random.default_rng(0)
    source = Source(tmp_path, {"bag": 0.25, "bag-by-rays": 0.75})
    scanned = [source.cube(rng, 16).kind.scanned for _ in range(400)]
    assert 0.65 < np.mean(scanned) < 0.85

    def quiet(kind: str) -> list[bool]:
        """Return of ten patches whether most voxels of matter have the value of another."""
        made = examples(Source(tmp_path, {kind: 1.0}), 3, 32, 4.0)
        cells = [next(made)[0] for _ in range(10)]
        matter = [c[c > c.max() / 2] for c in cells]
        return [len(np.unique(values)) < len(values) / 2 for values in matter]

    # No noise is added to half of those that are scanned already.
    assert not any(quiet("bag"))
    assert any(quiet("bag-by-rays"))
    assert not all(quiet("bag-by-rays"))
