"""What options say of a volume: which time point it is, and how large its voxels are."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
import zarr
from typer.testing import CliRunner

import napari_unpack as nu
from napari_unpack.cli import app
from napari_unpack.io import Scan, save_scan, save_session

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


@pytest.fixture
def bare(tmp_path: Path) -> tuple[Path, Path]:
    """A volume and its labels, of which neither file says how large voxels are."""
    for name, array in (("v", (LABELS[0] > 0) * np.uint16(1000)), ("l", LABELS[0])):
        np.save(tmp_path / f"{name}.npy", array)
    return tmp_path / "v.npy", tmp_path / "l.npy"


def volumes(result: Any) -> set[str]:
    return {line.split()[4] for line in result.stdout.splitlines()[1:]}


def test_a_voxel_size_that_is_given_is_not_assumed(bare: tuple[Path, Path]) -> None:
    volume, labels = bare
    told = order(volume, "--labels", labels)
    note = "note: v.npy: it gives no voxel size: 1 mm was assumed; --spacing 'Z Y X' gives it in mm"
    assert (volumes(told), told.stderr) == ({"288"}, f"{note}\n")
    for size in ("2 0.5 0.5", "2,.5,.5", "[2, 0.5, 0.5]", "2 x 0.5 x 0.5"):
        told = order(volume, "--labels", labels, "--spacing", size)
        assert (volumes(told), told.stderr) == ({"144"}, "")
    # One number is that of all three, and a file's own size counts no more.
    sized = save_scan(Scan(np.load(volume), (3, 3, 3), LABELS[0]), volume.with_name("sized.npz"))[0]
    assert volumes(order(sized, "--spacing", "0.5")) == {"36.0"}


def test_every_command_on_one_volume_takes_its_voxel_size(
    bare: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    volume, labels = bare

    def opened(scan: Scan, *_: object) -> None:
        raise ValueError(f"opened with {scan.spacing} and {scan.assumed}")

    def segmented(array: np.ndarray, spacing: tuple[float, ...], **_: object) -> None:
        raise ValueError(f"opened with {tuple(spacing)} and ()")

    monkeypatch.setattr("napari_unpack.io.headless.open_scan", opened)
    monkeypatch.setattr(nu, "segment", segmented)
    monkeypatch.setattr("napari_unpack.segmentation.segment", segmented)
    image = volume.with_name("image.zarr")
    zarr.create_array(str(image), data=np.load(volume))
    named = ("--labels", labels)
    for words in (
        ("segment", volume, volume.with_name("o.npz")),
        ("segment", image, volume.with_name("o.zarr")),
        ("order", volume, *named),
        ("render", volume, volume.with_name("o.png"), *named),
        ("movie", volume, volume.with_name("o.gif"), *named),
        ("table", volume, volume.with_name("o.csv"), *named),
        ("web", volume, volume.with_name("o.html"), *named),
        ("surfaces", volume, volume.with_name("o.stl"), *named),
    ):
        told = run(*words, "--spacing", "2 1 0.5")
        assert told.stderr == "error: opened with (2.0, 1.0, 0.5) and ()\n"
        for wrong in ("x", "1 2", "0", "1 nan 1", "-1 1 1", ""):
            told = run(*words, "--spacing", wrong)
            assert told.exit_code == 1
            assert told.stderr == (
                "error: --spacing must give the voxel size as 'z y x' in mm, or as one number for "
                f"all three, got {wrong!r}\n"
            )


def test_a_saved_session_keeps_its_voxel_size(bare: tuple[Path, Path]) -> None:
    saved = bare[0].with_name("bag.unpack")
    save_session(nu.Session(np.load(bare[0]), LABELS[0]), saved)
    told = run("order", saved, "--spacing", "2")
    assert told.exit_code == 1
    assert "a session has a voxel size of its own: leave --spacing out" in told.stderr


def test_a_voxel_size_that_labels_alone_have_is_told(bare: tuple[Path, Path]) -> None:
    pytest.importorskip("SimpleITK")
    volume = bare[0]
    labels = save_scan(Scan(LABELS[0], (2.0, 0.5, 0.5)), volume.with_name("mine.nrrd"))[0]
    told = order(volume, "--labels", labels)
    note = "note: v.npy: its labels (mine.nrrd) give 2 x 0.5 x 0.5 mm where 1 mm was assumed\n"
    assert told.stderr.endswith(note)
    assert order(volume, "--labels", labels, "--spacing", "2 0.5 0.5").stderr == ""
