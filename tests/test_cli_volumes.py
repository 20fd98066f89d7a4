"""What options say of a volume: which time point it is, and how large its voxels are."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from typer.testing import CliRunner

from napari_unpack.cli import app

LABELS = np.zeros((2, 12, 14, 20), np.uint8)
LABELS[0, 3:9, 3:11, 3:9], LABELS[0, 3:9, 3:11, 11:17] = 1, 2
LABELS[1] = np.where(LABELS[0] == 1, 7, 0)


def run(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(a) for a in arguments])


def tiff(path: Path, array: np.ndarray, axes: str = "TZYX") -> Path:
    tifffile.imwrite(path, array, metadata={"axes": axes})
    return path


def order(*arguments: object) -> Any:
    result = run("order", *arguments, "--backend", "cpu")
    assert result.exit_code == 0, result.output
    return result


@pytest.mark.parametrize(("at", "ids"), [("t=0", ["1", "2"]), ("t=1", ["7"])])
def test_a_time_point_is_that_of_the_labels_too(tmp_path: Path, at: str, ids: list[str]) -> None:
    volume = tiff(tmp_path / "v.tif", (LABELS > 0) * np.uint16(1000))
    labels = tiff(tmp_path / "mine.tif", LABELS)
    named = order(volume, "--labels", labels, "--at", at)
    assert sorted(line.split()[1] for line in named.stdout.splitlines()[1:]) == ids
    # Beside the volume as well, and labels without time go for each time point.
    labels.rename(tmp_path / "v.labels.tif")
    beside = order(volume, "--at", at)
    assert beside.stdout == named.stdout
    one = tiff(tmp_path / "one.tif", LABELS[int(at[-1])], "ZYX")
    assert order(volume, "--labels", one, "--at", at).stdout == named.stdout


def test_a_score_is_of_the_time_point_that_is_chosen(tmp_path: Path) -> None:
    true, found = tiff(tmp_path / "t.tif", LABELS), tiff(tmp_path / "f.tif", LABELS[::-1])
    one = tiff(tmp_path / "one.tif", LABELS[1], "ZYX")
    assert "choose one, from 0 to 1, such as t=0" in run("score", true, found).stderr
    for files, at, f1 in (
        ((true, found), "t=1", "0.6667"),
        ((true, true), "t=1", "1.0000"),
        # It goes for whichever has time points.
        ((one, true), "t=1", "1.0000"),
        ((one, true), "t=0", "0.6667"),
    ):
        assert run("score", *files, "--at", at).stdout.split()[1] == f1
    for files, at, sentence in (
        ((true, found), "t=2", "t.tif holds 2 time points, numbered from 0: there is no t=2"),
        ((one, one), "t=1", f"neither {one} nor {one} has an axis t"),
        ((true, found), "t", "--at must be like c=1 or t=0,c=1, got 't'"),
    ):
        told = run("score", *files, "--at", at)
        assert (told.exit_code, sentence in told.stderr) == (1, True)
