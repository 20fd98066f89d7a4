"""Where commands read and write: one's own folder, and a place that takes the table elsewhere."""

import shutil
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from napari_unpack.cli import app
from napari_unpack.io import Scan, load_volume, save_scan


def run(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(a) for a in arguments])


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A person's own folder with a bag of two boxes and a picture in it."""
    labels = np.zeros((16, 16, 24), np.uint8)
    labels[4:12, 4:12, 2:10], labels[4:12, 4:12, 13:21] = 1, 2
    save_scan(Scan(labels * np.uint16(1000), (1.0, 1.0, 1.0), labels), tmp_path / "bag.npz")
    iio.imwrite(tmp_path / "photo.png", np.full((30, 40, 3), 90, np.uint8))
    for name in ("HOME", "USERPROFILE"):
        monkeypatch.setenv(name, str(tmp_path))
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    return tmp_path


def test_an_input_in_ones_own_folder_is_not_overwritten_however_it_is_spelled(home: Path) -> None:
    (home / "link.csv").symlink_to(home / "bag.npz")
    before = {file: file.read_bytes() for file in home.glob("*.*")}
    for source, output, *more in (
        ("~/bag.npz", home / "bag.npz"),
        (home / "bag.npz", "~/bag.npz"),
        (home / "bag.npz", home / "other.npz", "--csv", "~/link.csv"),
    ):
        result = run("segment", source, output, *more)
        assert result.exit_code == 1
        assert "is the input and would be overwritten" in " ".join(result.output.split())
    result = run("train", "~/bag.npz", home / "bag.npz")
    assert "is the input and would be overwritten" in " ".join(result.output.split())
    for ground, output in (
        ("~/photo.png", home / "photo.png"),
        (home / "photo.png", "~/photo.png"),
    ):
        result = run("render", "~/bag.npz", output, "--size", 32, 32, "--background", ground)
        assert "is the input and would be overwritten" in " ".join(result.output.split())
    assert {file: file.read_bytes() for file in home.glob("*.*")} == before


def test_all_commands_write_into_ones_own_folder(home: Path) -> None:
    for command, output, *more in (
        ("render", "p.png", "--size", 32, 32, "--background", "~/photo.png", "--backend", "cpu"),
        ("movie", "m.gif", "--count", 1, "--size", 32, 32, "--fps", 5, "--backend", "cpu"),
        ("table", "t.csv"),
        ("web", "w.html", "--backend", "cpu"),
        ("segment", "o.npz", "--csv", "~/o.csv"),
    ):
        result = run(command, "~/bag.npz", f"~/{output}", *more)
        assert result.exit_code == 0, result.output
        assert (home / output).is_file()
    assert (home / "o.csv").is_file()
    assert not any((home / "work").iterdir())


def test_the_table_of_a_zarr_that_cannot_be_saved_goes_elsewhere_and_says_where(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    zarr = pytest.importorskip("zarr")
    zarr.create_array("in.zarr", data=load_volume(home / "bag.npz").volume, chunks=(8, 8, 8))
    (home / "tables").mkdir()

    def segment_zarr(*_: object) -> pd.DataFrame:
        # The folder goes while the work is done.
        (home / "tables").rmdir()
        return pd.DataFrame({"volume": [7.0]}, index=pd.Index([1], name="id"))

    monkeypatch.setattr("napari_unpack.batches.large_files.segment_zarr", segment_zarr)
    result = run("segment", "in.zarr", "out.zarr", "--csv", home / "tables" / "objects.csv")
    assert result.exit_code == 1
    assert "no folder" in result.output
    table = Path(result.output.split("wrote ")[-1].splitlines()[0])
    assert pd.read_csv(table)["volume"].tolist() == [7.0]
    shutil.rmtree(table.parent)


def test_all_is_saved_before_a_reader_that_has_gone_is_told_of_it(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone(text: object = "", **_: object) -> None:
        if str(text).startswith("wrote"):
            raise BrokenPipeError

    monkeypatch.setattr("typer.echo", gone)
    run("simulate", home / "new.npz", "--shape", "24", "24", "32", "--count", "2")
    assert (home / "new.csv").is_file()


@pytest.mark.parametrize("labels", ["n" * 240 + ".npz", "."])
def test_labels_of_any_name_are_looked_at(home: Path, labels: str) -> None:
    from napari_unpack.cli_options import tell_labels_beside

    tell_labels_beside(Path(labels))
