"""Every script in examples/ writes and prints what its first lines promise."""

from __future__ import annotations

import csv
import re
import runpy
import sys
from collections.abc import Callable
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

import napari_unpack as nu

EXAMPLES = Path(__file__).parents[1] / "examples"
Run = Callable[..., list[str]]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Run an example as a person does, but in this process, and return the lines it prints."""
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()

    def run(name: str, *more: Path) -> list[str]:
        monkeypatch.chdir(elsewhere)
        monkeypatch.setattr(sys, "argv", [name, *map(str, (tmp_path / "out", *more))])
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        assert list(elsewhere.iterdir()) == []
        return capsys.readouterr().out.splitlines()

    return run


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_the_list_of_examples_is_whole() -> None:
    text = (EXAMPLES / "README.md").read_text("utf-8")
    named = set(re.findall(r"^- `(\w+\.py)`:", text, re.MULTILINE))
    assert named == {path.name for path in EXAMPLES.glob("*.py")}


def test_a_volume_of_ones_own_is_segmented(tmp_path: Path, run: Run) -> None:
    volume = np.random.default_rng(0).normal(20, 8, (40, 44, 60))
    volume[8:32, 8:34, 6:26] += 1200
    volume[10:30, 10:30, 32:54] += 700
    np.save(tmp_path / "volume.npy", volume.clip(0).astype(np.uint16))
    lines = run("segment_a_volume.py", tmp_path / "volume.npy")
    labels, table = np.load(tmp_path / "out/labels.npy"), rows(tmp_path / "out/objects.csv")
    assert labels.shape == volume.shape
    assert labels[20, 20, 15] != labels[20, 20, 43]
    assert {labels[20, 20, 15], labels[20, 20, 43]} == {int(row["id"]) for row in table}
    told = [re.match(r"object \d+: confidence (\d\.\d\d), ", line) for line in lines[:-1]]
    assert len(told) == len(table) == 2
    shown = [float(match[1]) for match in told if match]
    assert shown == sorted((round(float(row["confidence"]), 2) for row in table), reverse=True)


def test_everybody_leaves_once_and_who_is_unpackable_leads(tmp_path: Path, run: Run) -> None:
    lines = run("unpack_in_order.py")
    table = rows(tmp_path / "out/order.csv")
    assert sorted(int(row["id"]) for row in table) == list(range(1, 11))
    steps = [int(row["step"]) for row in table]
    assert steps == sorted(steps)
    unpackable = lines[0].removeprefix("Unpackable now: ").split(", ")
    assert unpackable[0] == table[0]["name"]
    assert lines[1] == f"1. {table[0]['name']}"
    assert len(lines) == 1 + steps[-1]


def test_a_tinted_image_has_many_colours_and_neighbours_apart(tmp_path: Path, run: Run) -> None:
    lines = run("tinted_picture.py")
    image = iio.imread(tmp_path / "out/tinted.png")
    assert image.shape == (360, 480, 3)
    vivid = image[np.ptp(image.astype(int), axis=2) > 100]
    assert len(vivid) > 5000
    assert len(np.unique(vivid // 64, axis=0)) > 8
    pairs = re.fullmatch(r"(\d+) objects in view, (\d+) pairs interfere", lines[0])
    assert pairs is not None
    assert int(pairs[1]) > 8
    assert int(pairs[2]) > 8
    assert float(lines[1].split(": ")[1]) > 0.03


def test_labels_of_another_tool_are_asked_about(tmp_path: Path, run: Run) -> None:
    lines = run("own_labels.py")
    table = rows(tmp_path / "out/objects.csv")
    near = {int(row["id"]): {int(i) for i in row["interferes_with"].split()} for row in table}
    assert len(near) == 12
    assert all(a in near[b] for a in near for b in near[a])
    exact = {int(row["id"]): float(row["exact"]) for row in table}
    assert min(exact.values()) == 0.0
    assert max(exact.values()) > 0.5
    # What a straight pull allows, the paper's rule allows too.
    assert all(float(row["first_hit"]) == 0.0 for row in table if float(row["exact"]) == 0.0)
    *_, last = lines
    unpackable = [int(i) for i in last.split(":")[1].split()]
    assert unpackable == sorted(i for i, ratio in exact.items() if ratio == 0.0)


def test_a_movie_shows_objects_on_their_way(tmp_path: Path, run: Run) -> None:
    lines = run("movie_of_unpacking.py")
    frames = iio.imread(tmp_path / "out/unpacking.mp4").astype(int)
    assert frames.shape[1:] == (240, 320, 3)
    assert len(frames) > 20
    assert np.abs(frames[-1] - frames[0]).mean() > 2
    assert len(lines[0].removeprefix("leave in this order: ").split(", ")) == 3
    assert lines[1] == f"wrote {tmp_path / 'out/unpacking.mp4'}"


def test_a_trained_confidence_is_saved_and_used(tmp_path: Path, run: Run) -> None:
    lines = run("train_confidence.py")
    assert nu.Oracle.load(tmp_path / "out/oracle.npz").bad is not None
    shown = "\n".join(lines)
    assert "Learning from volume 2: 9 objects so far" in shown
    assert "100%  Learning from 18 objects" in shown
    told = [line for line in lines if line.startswith("object ")]
    assert len(told) > 4
    numbers = [float(n) for line in told for n in re.findall(r"\d\.\d\d", line)]
    assert len(numbers) == 2 * len(told)
    assert all(0 <= n <= 1 for n in numbers)
    assert numbers[0::2] != numbers[1::2]
