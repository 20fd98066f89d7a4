"""The command that makes the network of boundaries anew goes on where it was stopped."""

import subprocess
import sys
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from benchmarks.boundaries import __main__ as training
from benchmarks.boundaries import volumes
from benchmarks.boundaries.examples import (
    AIR_ALONE,
    APART,
    BESIDE_AIR,
    NOTHING,
    SAME,
    Source,
    examples,
    targets,
)
from benchmarks.boundaries.volumes import FIRST_SEED, KINDS, Kind, hollow

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
    run("--batch", "8")
    assert begun[2][-2:] == ["--batch", "8"]


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
def test_patches_hold_what_the_network_is_to_say_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    smaller = partial(volumes.metal_among_cloth, shape=(80, 80, 80))
    monkeypatch.setattr(volumes, "metal_among_cloth", smaller)
    density_file, labels_file = volumes.files(tmp_path, kind, FIRST_SEED)
    density, labels = KINDS[kind].make(FIRST_SEED)
    np.save(density_file, density)
    np.save(labels_file, labels)
    source = Source(tmp_path, {kind: range(FIRST_SEED, FIRST_SEED + 1)})
    cells, answers = next(examples(source, 0, 32))
    assert cells.shape == (8, 16, 16, 16)
    assert answers.shape == (CHANNELS, 16, 16, 16)
    assert set(np.unique(answers[:8])) == {SAME, AIR_ALONE}
    assert set(np.unique(answers[8:])) == {NOTHING, SAME, APART, BESIDE_AIR}
    # The same patch again from the same seed.
    np.testing.assert_array_equal(next(examples(source, 0, 32))[0], cells)


def test_answers_say_which_voxels_and_cells_are_of_one_object() -> None:
    labels = np.zeros((4, 4, 32), np.int32)
    labels[..., 4:16], labels[..., 16:28] = 7, 9
    answers = targets(labels)
    matter, along_x = answers[:8], answers[24:32]
    np.testing.assert_array_equal(matter[0, 0, 0], [AIR_ALONE] * 2 + [SAME] * 12 + [AIR_ALONE] * 2)
    # The second voxel of each cell with the first of the next.
    assert along_x[1, 0, 0].tolist() == [
        NOTHING, BESIDE_AIR, *[SAME] * 5, APART, *[SAME] * 5, BESIDE_AIR, NOTHING, NOTHING,
    ]  # fmt: skip
    # Of a cell with the next, and with the third beyond it.
    near, third = answers[34, 0, 0], answers[37, 0, 0]
    assert near.tolist() == along_x[1, 0, 0].tolist()
    assert third.tolist() == [
        BESIDE_AIR, BESIDE_AIR, *[SAME] * 3, *[APART] * 3, *[SAME] * 3, *[BESIDE_AIR] * 2,
        *[NOTHING] * 3,
    ]  # fmt: skip
    # Pairs beyond the patch teach nothing.
    assert not answers[40, ..., -6:].any()


def test_air_inside_objects_is_no_object_s_but_for_the_voids_of_cloth() -> None:
    density, labels = np.full((9, 9, 9), 500.0, np.float32), np.ones((9, 9, 9), np.int32)
    density[2:6, 2:5, 3:6] = 0
    density[7, 7, 1:7] = 0
    hollow(density, labels)
    wanted = np.ones((9, 9, 9), np.int32)
    wanted[2:6, 2:5, 3:6] = 0
    np.testing.assert_array_equal(labels, wanted)
