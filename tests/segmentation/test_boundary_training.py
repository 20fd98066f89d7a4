"""The command that makes the network of boundaries anew goes on where it was stopped."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from benchmarks.boundaries import __main__ as training


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
