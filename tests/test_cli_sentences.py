"""What the command line says of mistakes: which file, why, and only what its options can mend."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from typer.testing import CliRunner

import napari_unpack as nu
from napari_unpack.appearance import Background
from napari_unpack.cli import app
from napari_unpack.io import Scan, save_scan


def run(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(a) for a in arguments])


@pytest.fixture
def scan() -> Scan:
    labels = np.zeros((16, 16, 30), np.uint8)
    labels[4:12, 4:12, 4:12], labels[4:12, 4:12, 18:26] = 1, 2
    volume = (1000 * (labels > 0) + np.arange(30)).astype(np.uint16)
    return Scan(volume, (1.0, 1.0, 1.0), labels)


@pytest.fixture
def bag(scan: Scan, tmp_path: Path) -> Path:
    return save_scan(scan, tmp_path / "bag.npz")[0]


def test_a_volume_taken_for_labels_is_told_where_its_labels_lie_beside_it(
    scan: Scan, bag: Path
) -> None:
    volume, labels = save_scan(scan, bag.with_name("ct.tif"))
    for command in (("score", bag), ("order", bag, "--backend", "cpu", "--labels")):
        note = f"note: {volume} is taken for labels, and ct.labels.tif lies beside it"
        assert note in run(*command, volume).stderr
        right = run(*command, labels)
        assert (right.exit_code, "note: " in right.stderr) == (0, False)


def test_labels_that_lie_beside_a_volume_are_used_unless_they_do_not_fit(
    scan: Scan, bag: Path
) -> None:
    volume, labels = save_scan(scan, bag.with_name("ct.tif"))
    lines = run("order", volume, "--backend", "cpu")
    assert (lines.exit_code, len(lines.stdout.splitlines())) == (0, 3)
    assert "note: ct.tif: its labels are those beside it, ct.labels.tif; --lab" in lines.stderr
    assert "%" not in lines.stderr
    # Whoever names labels means those.
    one = (scan.labels == 1).astype(np.uint8)
    mine = save_scan(Scan(one, scan.spacing), bag.with_name("mine.tif"))[0]
    named = run("order", volume, "--backend", "cpu", "--labels", mine)
    assert (len(named.stdout.splitlines()), "beside" in named.stderr) == (2, False)
    # As `cp` may leave them.
    os.utime(labels, (1, 1))
    lines = run("order", volume, "--backend", "cpu")
    assert "beside it, ct.labels.tif, which are older than it; --labels takes" in lines.stderr
    assert (lines.exit_code, len(lines.stdout.splitlines())) == (0, 3)
    save_scan(Scan(scan.labels[1:], scan.spacing), labels)
    lines = run("order", volume, "--backend", "cpu")
    why = "ct.labels.tif beside it is left out: labels must have the volume's shape"
    assert f"note: ct.tif: {why}" in lines.stderr
    assert "; it is segmented anew, unless --labels names labels" in lines.stderr
    assert (lines.exit_code, "%" in lines.stderr) == (0, True)


def test_segment_says_where_a_turned_volume_loses_how_it_lies(scan: Scan, tmp_path: Path) -> None:
    sitk = pytest.importorskip("SimpleITK")
    source = save_scan(Scan(scan.volume, scan.spacing), tmp_path / "ct.nii.gz")[0]
    note = "note: out.tif: the volume was turned when it was read, and TIFF does not say how it"
    # As this package writes it, nothing has to be turned.
    assert "was turned" not in run("segment", source, tmp_path / "first.tif").stderr
    sitk.WriteImage(sitk.DICOMOrient(sitk.ReadImage(str(source)), "RAS"), str(source))
    told = run("segment", source, tmp_path / "out.tif")
    assert (told.exit_code, note in told.stderr) == (0, True)
    assert "was turned" not in run("segment", source, tmp_path / "out.npz").stderr


def test_train_learns_from_labels_that_lie_beside(scan: Scan, bag: Path) -> None:
    volume, labels = save_scan(scan, bag.with_name("ct.tif"))
    told = run("train", bag.with_name("mine.npz"), volume)
    assert "note: ct.tif: its labels are those beside it, ct.labels.tif\n" in told.stderr
    assert "an oracle needs at least 8 objects" in told.stderr
    save_scan(Scan(scan.labels[1:], scan.spacing), labels)
    told = run("train", bag.with_name("mine.npz"), volume)
    assert "beside it is left out: labels must have the volume's shape" in told.stderr
    assert "needs labels to learn from: segment it first" in told.stderr


def test_simulate_takes_no_table_of_anothers_for_its_own(tmp_path: Path) -> None:
    table = tmp_path / "bag.csv"
    table.write_text("mine")
    asked = ("simulate", tmp_path / "bag.npz", "--shape", 32, 40, 40, "--count", 2)
    told = run(*asked)
    assert (told.exit_code, table.read_text()) == (1, "mine")
    assert "bag.csv is there and would be overwritten by the table of the bag" in told.stderr
    table.unlink()
    # Another bag in place of the first.
    assert [run(*asked).exit_code for _ in range(2)] == [0, 0]


def test_segment_writes_over_no_labels_that_nobody_named(
    scan: Scan, bag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(nu, "segment")
    volume, labels = save_scan(scan, bag.with_name("out.nrrd"))
    before = labels.read_bytes()
    # Of another program alone, and as after the same command, when somebody has corrected them.
    for there in (True, False):
        told = run("segment", bag, volume)
        assert told.exit_code == 1
        assert f"error: {labels} is there and would be overwritten by the labels" in told.stderr
        assert "choose another output, or move or remove that file first" in told.stderr
        assert (labels.read_bytes(), volume.exists()) == (before, there)
        volume.unlink(missing_ok=True)


def test_the_table_of_segment_is_a_csv(bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(nu, "segment")
    for name in ("um.xlsx", "um"):
        told = run("segment", bag, bag.with_name("out.npz"), "--csv", bag.with_name(name))
        assert (told.exit_code, bag.with_name(name).exists()) == (1, False)
        assert f"{name}: the output must end in .csv" in told.stderr


def test_the_version_is_told() -> None:
    assert nu.__version__ == metadata.version("napari-unpack")
    assert "__version__" in dir(nu)
    told = run("--version")
    assert (told.exit_code, told.stdout) == (0, f"napari-unpack {nu.__version__}\n")
    # As before there was an option of its own.
    assert "See into packed things" in run("--help").stdout
    assert "See into packed things" in run().output


def test_advice_where_nothing_is_found_is_of_options_and_not_of_python(bag: Path) -> None:
    told = run("segment", bag, bag.with_name("out.npz"), "--smallest", "1e30")
    assert told.exit_code == 1
    assert told.stderr.endswith("voxels; `segment` takes a smaller --smallest\n")


def test_train_says_which_file_has_no_labels(
    bag: Path, scan: Scan, monkeypatch: pytest.MonkeyPatch
) -> None:
    bare = bag.with_name("bare.npz")
    np.savez(bare, volume=scan.volume)
    told = run("train", bag.with_name("mine.npz"), bag, bare)
    assert told.exit_code == 1
    assert f"error: {bare} needs labels" in told.stderr
    assert run("train", bag.with_name("mine.npz"), bag, "--seed", -3).exit_code == 2


def test_a_background_that_may_not_be_read_is_not_called_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    picture = tmp_path / "secret.png"
    picture.touch()

    opened = Path.open

    def refuse(path: Path, *given: Any, **named: Any) -> Any:
        if path == picture:
            raise PermissionError(13, "Permission denied", str(path))
        return opened(path, *given, **named)

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(PermissionError, match=r"secret\.png may not be read by you"):
        Background.of(picture)


def test_large_is_not_ignored_of_zarr_to_zarr(tmp_path: Path) -> None:
    zarr.create_array(str(tmp_path / "in.zarr"), shape=(9, 9, 9), dtype="u2")
    told = run("segment", tmp_path / "in.zarr", tmp_path / "out.zarr", "--large")
    assert told.exit_code == 1
    assert "error: --large is not for Zarr outputs" in told.stderr


@pytest.mark.skipif(os.name != "posix", reason="pipes of a shell")
def test_head_ends_a_command_without_a_word_and_a_run_of_many_not_at_all(
    bag: Path, scan: Scan, tmp_path: Path
) -> None:
    pytest.importorskip("distributed")
    begin = [sys.executable, "-c", "from napari_unpack.cli import main; main()"]

    def headed(*words: object) -> tuple[int, str]:
        work = subprocess.Popen(
            [*begin, *map(str, words)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        assert work.stdout is not None
        assert work.stderr is not None
        work.stdout.readline()
        work.stdout.close()
        said = work.stderr.read()
        work.stderr.close()
        return work.wait(), said

    assert headed("order", bag, "--backend", "cpu") == (1, "")
    (tmp_path / "in").mkdir()
    for n in range(3):
        scan.volume[0, 0, 0] = n
        save_scan(scan, tmp_path / "in" / f"{n}.npz")
    out = tmp_path / "out"
    more = ("--workers", 1, "--no-pictures", "--json")
    code, said = headed("batch", tmp_path / "in", "--output", out, *more)
    assert (code, said.splitlines()[-1]) == (0, f"3 of 3 scans done; wrote {out}/index.html")


@pytest.mark.skipif(sys.platform != "linux", reason="where nobody can write")
def test_a_folder_that_takes_no_results_is_told_before_a_cluster_is_asked(bag: Path) -> None:
    pytest.importorskip("distributed")
    for output in ("/proc", "/proc/out"):
        with pytest.raises(PermissionError, match="cannot be written into /proc"):
            nu.batch(bag, output, client=object(), force=True)
