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
from benchmarks.boundaries.examples import Source, examples
from benchmarks.boundaries.volumes import FIRST_SEED, KINDS, Kind

from napari_unpack.segmentation.learned.boundary_network import CHANNELS


def test_a_trial_and_the_training_keep_checkpoints_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[list[str]] = []

    def process(command: list[str]) -> Any:
        begun.append(command[2:])
        return SimpleNamespace(wait=lambda: 0, kill=lambda: None)

    def run(*more: str) -> str:
        begun.clear()
        monkeypatch.setattr(sys, "argv", ["", "a.onnx", "--folder", str(tmp_path), *more])
        training.main()
        names = [command[0].removeprefix("benchmarks.boundaries.") for command in begun]
        assert names == ["volumes", "volumes", "train", "export"]
        checkpoint = begun[2][begun[2].index("--checkpoint") + 1]
        # What was trained is what is exported.
        assert begun[3][1:] == [checkpoint, "a.onnx"]
        return checkpoint

    monkeypatch.setattr(subprocess, "Popen", process)
    assert run("--shorten", "130") == run("--shorten", "130") != run()


def test_a_step_that_fails_ends_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        subprocess,
        "Popen",
        lambda command: SimpleNamespace(args=command, wait=lambda: 1, kill=lambda: None),
    )
    monkeypatch.setattr(sys, "argv", ["", "a.onnx", "--folder", str(tmp_path)])
    with pytest.raises(SystemExit, match="volumes"):
        training.main()


def test_a_volume_that_was_cut_short_by_a_stop_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(path: Path, array: np.ndarray) -> None:
        path.write_bytes(b"\x93NUMPY")
        if "labels" not in path.name:
            raise KeyboardInterrupt

    only = {"bags": Kind(lambda _: (np.ones((2, 2, 2), np.uint16),) * 2, 1, 1)}
    monkeypatch.setattr(volumes, "KINDS", only)
    monkeypatch.setattr(sys, "argv", ["", str(tmp_path)])
    with monkeypatch.context() as during:
        during.setattr(np, "save", stopped)
        with pytest.raises(KeyboardInterrupt):
            volumes.main()
    assert [path.name for path in tmp_path.iterdir()] == [f"bags-{FIRST_SEED}-labels.npy"]
    volumes.main()
    assert np.load(tmp_path / f"bags-{FIRST_SEED}-density.npy").shape == (2, 2, 2)


@pytest.mark.parametrize("kind", ["alike-solids", "metal-by-rays"])
def test_patches_hold_what_the_network_is_to_say_of_them(tmp_path: Path, kind: str) -> None:
    density_file, labels_file = volumes.files(tmp_path, kind, FIRST_SEED)
    density, labels = KINDS[kind].make(FIRST_SEED)
    np.save(density_file, density)
    np.save(labels_file, labels)
    source = Source(tmp_path, {kind: range(FIRST_SEED, FIRST_SEED + 1)})
    cells, wanted, weights = next(examples(source, 0, 32, 4.0))
    assert cells.shape == (8, 16, 16, 16)
    assert wanted.shape == weights.shape == (CHANNELS, 16, 16, 16)
    # Affinities of pairs beyond the patch, and of air with air, teach nothing.
    assert not weights[32, -1].any()
    assert set(np.unique(wanted)) == {0.0, 1.0}
    # The same patch again from the same seed.
    np.testing.assert_array_equal(next(examples(source, 0, 32, 4.0))[0], cells)
