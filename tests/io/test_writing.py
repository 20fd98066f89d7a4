"""Tables, pictures, and files that are written wholly or not at all."""

import csv
import stat
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pandas as pd
import pytest

from napari_unpack import Session
from napari_unpack.atomic import written_atomically
from napari_unpack.io import (
    Scan,
    load_labels,
    load_volume,
    open_session,
    save_objects_csv,
    save_png,
    save_scan,
    save_session,
)
from napari_unpack.io.arrays import write_labels_npz
from napari_unpack.io.movies import checked_movie_path
from napari_unpack.io.surfaces import checked_surfaces_path
from napari_unpack.segmentation.confidence.oracle import Oracle, default_oracle


def test_the_table_of_objects_has_the_id_first(tmp_path: Path) -> None:
    objects = pd.DataFrame({"name": ["soap", "shoe, left"], "voxels": [12, 34]}, index=[3, 7])
    path = save_objects_csv(objects, tmp_path / "objects.csv")
    with path.open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows == [["id", "name", "voxels"], ["3", "soap", "12"], ["7", "shoe, left", "34"]]


def test_a_name_is_no_formula_in_a_spreadsheet(tmp_path: Path) -> None:
    names = ["=1+1", "@now", "-2", "+3", "a=b", "soap"]
    objects = pd.DataFrame({"name": names, "z": [-1.5] * 6}, index=range(1, 7))
    with save_objects_csv(objects, tmp_path / "a.csv").open(newline="") as file:
        rows = list(csv.reader(file))[1:]
    assert [row[1] for row in rows] == ["'=1+1", "'@now", "'-2", "'+3", "a=b", "soap"]
    assert {row[2] for row in rows} == {"-1.5"}, "numbers stay numbers"


def test_the_folder_of_a_person_may_be_called_by_its_sign(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("HOME", "USERPROFILE"):
        monkeypatch.setenv(name, str(tmp_path))
    objects = pd.DataFrame({"name": ["soap"]}, index=[1])
    assert save_objects_csv(objects, "~/a.csv") == tmp_path / "a.csv"
    assert save_png(np.zeros((2, 3, 3), np.uint8), "~/a.png") == tmp_path / "a.png"
    assert checked_movie_path("~/a.mp4", (16, 24)) == tmp_path / "a.mp4"
    assert checked_surfaces_path("~/a.stl") == tmp_path / "a.stl"
    scan = Scan(np.zeros((2, 3, 4), np.uint16), (1.0, 1.0, 1.0))
    assert save_scan(scan, "~/a.tif") == [tmp_path / "a.tif"]
    oracle = default_oracle()
    oracle.save("~/a.npz")
    np.testing.assert_array_equal(Oracle.load("~/a.npz").logistic, oracle.logistic)
    assert {p.name for p in tmp_path.iterdir()} == {"a.csv", "a.png", "a.npz", "a.tif"}
    # Of nobody's folder: a name as any other.
    monkeypatch.chdir(tmp_path)
    assert save_objects_csv(objects, "~draft.csv").exists()
    save_scan(scan, "~draft.npz")
    assert load_volume("~draft.npz").volume.shape == (2, 3, 4)
    volume = np.arange(24, dtype=np.uint16).reshape(2, 3, 4)
    session = Session(volume, np.ones((2, 3, 4), np.uint8), (1.0, 1.0, 1.0))
    save_session(session, "~draft.unpack")
    assert open_session("~draft.unpack").ids == (1,)


def test_a_png_holds_straight_colours(tmp_path: Path) -> None:
    image = np.zeros((2, 3, 4), np.float32)
    image[0, 0] = (0.25, 0.5, 0.0, 0.5)
    image[1, 2] = (1.5, 0.0, 1.0, 1.0)
    save_png(image, tmp_path / "a.png")
    back = iio.imread(tmp_path / "a.png")
    assert back.shape == (2, 3, 4)
    np.testing.assert_array_equal(back[0, 0], (128, 255, 0, 128))
    np.testing.assert_array_equal(back[1, 2], (255, 0, 255, 255))
    np.testing.assert_array_equal(back[1, 1], (0, 0, 0, 0))
    with pytest.raises(ValueError, match=r"\(H, W, 3\) or \(H, W, 4\)"):
        save_png(image[..., 0], tmp_path / "b.png")
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")

    def fail() -> None:
        with written_atomically(target) as temporary:
            temporary.write_text("half")
            raise RuntimeError("the disk is full")

    with pytest.raises(RuntimeError, match="the disk is full"):
        fail()
    # As a writer leaves it that puts its file beside the one that it was given.
    with pytest.raises(OSError, match="nothing was written"), written_atomically(target):
        pass
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("a.txt", "old")]
    with written_atomically(target) as temporary:
        temporary.write_text("new")
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("a.txt", "new")]
    assert target.stat().st_mode & stat.S_IRUSR


@pytest.mark.parametrize("suffix", [".NPZ", ".NII", ".NII.GZ", ".MHA", ".NRRD", ".TIF"])
def test_a_name_in_upper_case_is_a_name_as_any_other(tmp_path: Path, suffix: str) -> None:
    volume = np.arange(24, dtype=np.uint16).reshape(2, 3, 4)
    path = tmp_path / f"SCAN{suffix}"
    path.write_bytes(b"old")
    save_scan(Scan(volume, (1.0, 1.0, 1.0)), path)
    np.testing.assert_array_equal(load_volume(path).volume, volume)
    if suffix == ".NPZ":
        write_labels_npz(path, volume, (1.0, 1.0, 1.0))
        np.testing.assert_array_equal(load_labels(path)[0], volume)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("suffix", [".npz", ".nii.gz", ".mha", ".nrrd", ".tif"])
def test_arrays_in_the_other_byte_order_are_written(tmp_path: Path, suffix: str) -> None:
    volume = np.arange(24).reshape(2, 3, 4)
    scan = Scan(volume.astype(">u2"), (1, 1, 1), (volume // 6).astype(">i4"))
    files = save_scan(scan, tmp_path / f"bag{suffix}")
    np.testing.assert_array_equal(load_volume(files[0]).volume, volume)
    np.testing.assert_array_equal(load_labels(files[-1])[0], volume // 6)
