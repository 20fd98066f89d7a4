"""The command that makes the network of boundaries anew goes on where it was stopped."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from benchmarks.boundaries import __main__ as training
from benchmarks.boundaries import volumes


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
    assert run("--shorten", "130") == [4, 3, 13, 9, 12, 14, 6]
    assert run("--shorten", "130") == []
    assert run() == [500, 300, 1650, 1100, 1450, 1700, 750]
    assert run() == []


def test_a_volume_that_was_cut_short_by_a_stop_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(path: Path, array: np.ndarray) -> None:
        path.write_bytes(b"\x93NUMPY")
        if "labels" not in path.name:
            raise KeyboardInterrupt

    monkeypatch.setattr(volumes, "bag", lambda _: (np.ones((2, 2, 2), np.uint16),) * 2)
    monkeypatch.setattr(sys, "argv", ["", str(tmp_path), "0", "1"])
    with monkeypatch.context() as during:
        during.setattr(np, "save", stopped)
        with pytest.raises(KeyboardInterrupt):
            volumes.main()
    assert [path.name for path in tmp_path.iterdir()] == ["bag0-labels.npy"]
    volumes.main()
    assert np.load(tmp_path / "bag0-density.npy").shape == (2, 2, 2)
