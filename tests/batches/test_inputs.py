"""What a person names becomes scans, each once, with names of their own."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
import pytest
import tifffile
import zarr

import napari_unpack as nu
from napari_unpack.batches.inputs import find_inputs
from napari_unpack.batches.large_files import segment_zarr


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in (
        "one/scan.npz",
        "two/scan.nii.gz",
        "two/scan.labels.nii.gz",
        "series/1.dcm",
        "series/2.dcm",
        "image.zarr/zarr.json",
        ".unpack-half/a.npz",
        "run/run.json",
        "run/scans/x/labels.npz",
        "readme.txt",
    ):
        (tmp_path / name).parent.mkdir(exist_ok=True, parents=True)
        (tmp_path / name).write_bytes(b"-")
    return tmp_path


def test_a_folder_gives_its_volumes_with_the_labels_beside_them(folder: Path) -> None:
    found = {str(one.volume.relative_to(folder)): one for one in find_inputs([folder])}
    # Neither results, nor what is half written, nor slices of a series one by one.
    assert sorted(found) == ["image.zarr", "one/scan.npz", "series", "two/scan.nii.gz"]
    assert found["two/scan.nii.gz"].labels == folder / "two" / "scan.labels.nii.gz"
    assert found["one/scan.npz"].labels is None
    assert sorted(one.name for one in found.values()) == ["image", "one-scan", "series", "two-scan"]


def test_slices_hide_neither_the_volumes_beside_them_nor_the_folders_below(folder: Path) -> None:
    (folder / "series" / "a.npz").write_bytes(b"-")
    (folder / "series" / "more").mkdir()
    (folder / "series" / "more" / "b.npz").write_bytes(b"-")
    found = [one.volume.relative_to(folder) for one in find_inputs([folder / "series"])]
    assert sorted(map(str, found)) == ["series", "series/a.npz", "series/more/b.npz"]
    # A folder of slices stands for them also where those below are a scan of their own.
    (folder / "series" / "more" / "3.dcm").write_bytes(b"-")
    names = [one.name for one in find_inputs([folder / "series"])]
    assert sorted(names) == ["a", "b", "more", "series"]


def test_a_folder_of_slices_in_tiff_is_a_scan_and_stacks_beside_pictures_are_many(
    tmp_path: Path,
) -> None:
    plane = np.zeros((4, 5), np.uint8)
    for number in (1, 2, 10):
        tifffile.imwrite(tmp_path / f"{number}.tif", plane)
    np.save(tmp_path / "other.npy", plane)
    assert {one.volume.name for one in find_inputs([tmp_path])} == {tmp_path.name, "other.npy"}
    tifffile.imwrite(tmp_path / "10.tif", np.stack([plane] * 3), photometric="minisblack")
    found = {one.volume.name for one in find_inputs([tmp_path])}
    assert found == {"1.tif", "2.tif", "10.tif", "other.npy"}


def test_the_directory_of_a_disc_is_no_slice(folder: Path) -> None:
    for name in ("DICOMDIR", "patient/IM1"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(bytes(128) + b"DICM")
    names = [one.name for one in find_inputs([folder])]
    assert sorted(names) == ["image", "one-scan", "patient", "series", "two-scan"]


def test_what_is_named_twice_is_one_scan(folder: Path) -> None:
    found = find_inputs([folder / "one" / "scan.npz", f"{folder}/**/*.npz"])
    assert [one.volume.parent.name for one in found] == ["one"]


def test_the_results_of_a_run_are_no_scans_of_the_next(folder: Path) -> None:
    zarr_labels = folder / "run" / "scans" / "x" / "labels.ome.zarr"
    (zarr_labels / "zarr.json").parent.mkdir()
    (zarr_labels / "zarr.json").write_bytes(b"-")
    (folder / "run" / "objects.parquet").write_bytes(b"-")
    names = ["image", "one-scan", "series", "two-scan"]
    # A pattern, and what a shell makes of it.
    (folder / "readme.txt").unlink()
    for asked in ([f"{folder}/*"], sorted(folder.glob("[!.]*"))):
        assert sorted(one.name for one in find_inputs(asked)) == names
    (folder / "new.npz").write_bytes(b"-")
    found = find_inputs([folder / "new.npz", f"{folder}/run/*", f"{folder}/run/*/*/*"])
    assert [one.name for one in found] == ["new"]
    # Who names nothing else means them.
    assert [one.volume for one in find_inputs([zarr_labels])] == [zarr_labels]
    # A run among its scans, as --force allows.
    (folder / "run.json").write_bytes(b"-")
    (folder / "scans" / "y").mkdir(parents=True)
    (folder / "scans" / "y" / "labels.npz").write_bytes(b"-")
    assert sorted(one.name for one in find_inputs([folder])) == sorted([*names, "new"])
    (folder / "run" / "elsewhere.npz").write_bytes(b"-")
    assert [one.name for one in find_inputs([folder / "run"])] == ["elsewhere"]
    # What is named beside it is taken, whatever lies above, and its results are not.
    named = find_inputs([folder / "new.npz", folder / "series", folder / "run" / "elsewhere.npz"])
    assert [one.name for one in named] == ["new", "series", "elsewhere"]
    assert "labels" not in {one.name for one in find_inputs([f"{folder}/*", f"{folder}/*/*/*"])}


def test_a_file_is_one_scan_however_its_path_is_spelled(tmp_path: Path) -> None:
    for name in ("in/a.npz", "disk/in/a.npz"):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).write_bytes(b"-")
    here, there = tmp_path / "in", tmp_path / "disk" / "in"
    found = find_inputs([here / "a.npz", here / ".." / "in" / "a.npz", here / ".."])
    assert [one.volume for one in found] == [here / "a.npz", there / "a.npz"]
    # Above a link is what is above the folder that it leads to.
    (tmp_path / "link").symlink_to(there)
    (there / "b.npz").symlink_to(there / "a.npz")
    above = find_inputs([tmp_path / "link" / ".." / "in" / "a.npz"])
    assert [one.volume for one in above] == [there / "a.npz"]
    # A link to a file has a name of its own.
    found = find_inputs([there, tmp_path / "link"])
    assert [one.name for one in found] == ["a", "b"]


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_table_gives_volume_labels_spacing_and_name(tmp_path: Path, suffix: str) -> None:
    rows = pd.DataFrame(
        {
            "volume": ["a.npz", "b.npz", "b.npz"],
            "labels": ["mine.npz", None, "mine.npz"],
            "spacing": ["2 1 0.5", None, "3 3"],
            "name": ["first", np.nan, np.nan],
        }
    )
    table = tmp_path / f"list{suffix}"
    rows.to_csv(table, index=False) if suffix == ".csv" else rows.to_parquet(table)
    if suffix == ".csv":
        # Two numbers are no size of three sides.
        with pytest.raises(ValueError, match=r"row 3 of .*list.csv must .* size .* got '3 3'"):
            find_inputs([table])
        rows.assign(spacing="x").to_csv(table, index=False)
        with pytest.raises(ValueError, match=r"row 1 of .*list.csv must .* size .* got 'x'"):
            find_inputs([table])
    for same in ("[3, 3, 3]", "3"):
        rows["spacing"] = ["2 1 0.5", None, same]
        rows.to_csv(table, index=False) if suffix == ".csv" else rows.to_parquet(table)
        first, second, third = find_inputs([table])
        assert (first.spacing, second.spacing, third.spacing) == ((2, 1, 0.5), None, (3, 3, 3))
    assert (first.name, first.volume, first.labels) == (
        "first",
        tmp_path / "a.npz",
        tmp_path / "mine.npz",
    )
    assert (second.labels, second.name != third.name) == (None, True)


def test_what_cannot_be_meant_is_told(tmp_path: Path) -> None:
    for asked in ("missing.npz", "*.npz"):
        with pytest.raises(FileNotFoundError, match="no such file or folder"):
            find_inputs([tmp_path / asked])
    with pytest.raises(ValueError, match="no scans"):
        find_inputs([tmp_path])
    (tmp_path / "bad.csv").write_text("file\na.npz\n")
    with pytest.raises(ValueError, match="must have a column 'volume', got"):
        find_inputs([tmp_path / "bad.csv"])


def test_a_missing_package_is_named_with_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ImportError, match=r"pip install distributed \(or 'napari-unpack\[batch\]'"):
        nu.batch(tmp_path, tmp_path / "out")
    zarr.save_array(tmp_path / "a.zarr", np.zeros((4, 4, 4), np.uint16))
    with pytest.raises(ImportError, match=r"pip install distributed \(or 'napari-unpack\[batch\]'"):
        segment_zarr(tmp_path / "a.zarr", tmp_path / "out.zarr", workers=2)


def test_a_table_keeps_zeros_of_names_and_rows_of_one_volume(tmp_path: Path) -> None:
    table = tmp_path / "list.csv"
    table.write_text("volume,spacing,name\n001,1 1 1,0007\n001,3 1 1,thick\n")
    found = find_inputs([table])
    assert [(one.volume.name, one.spacing, one.name) for one in found] == [
        ("001", (1, 1, 1), "0007"),
        ("001", (3, 1, 1), "thick"),
    ]


def test_a_table_as_a_person_types_it_is_read(tmp_path: Path) -> None:
    table = tmp_path / "list.csv"
    table.write_text("Volume, labels , SPACING, Name\na.npz, mine.npz, 2 1 0.5, 0007\nb.npz, , ,\n")
    first, second = find_inputs([table])
    assert (first.labels, first.spacing, first.name) == (
        tmp_path / "mine.npz",
        (2, 1, 0.5),
        "0007",
    )
    assert (second.labels, second.spacing, second.name) == (None, None, "b")
    for twice in ("volume,Volume\na.npz,b.npz\n", "volume,labels,labels\na.npz,b.npz,c.npz\n"):
        table.write_text(twice)
        with pytest.raises(ValueError, match="must have each column once, got"):
            find_inputs([table])
    table.write_text("volume,mine,mine,,\na.npz,1,2,,\n")
    assert len(find_inputs([table])) == 1


def test_a_name_may_be_what_elsewhere_means_missing(tmp_path: Path) -> None:
    table = tmp_path / "list.csv"
    table.write_text("volume,labels,spacing,name\na.npz,NA,NA,NA\nb.npz,,,null\nc.npz,,\n,,,d\n")
    with pytest.raises(ValueError, match=r"row 4 of .* names no volume"):
        find_inputs([table])
    table.write_text(table.read_text().removesuffix(",,,d\n"))
    found = find_inputs([table])
    assert [one.name for one in found] == ["NA", "null", "c"]
    assert {(one.labels, one.spacing) for one in found} == {(None, None)}


def test_numbers_are_names_without_a_fraction(tmp_path: Path) -> None:
    rows = pd.DataFrame({"volume": ["a.npz", "b.npz"], "name": [1, None]})
    rows.to_parquet(tmp_path / "list.parquet")
    assert [one.name for one in find_inputs([tmp_path / "list.parquet"])] == ["1", "b"]


def test_a_table_may_lead_above_its_folder_and_down_again(tmp_path: Path) -> None:
    (tmp_path / "lists").mkdir()
    table = tmp_path / "lists" / "list.csv"
    table.write_text("volume,labels\n../a.npz,../mine.npz\n")
    (found,) = find_inputs([table])
    # As it is called wherever else it is named: a run that goes on knows it by that.
    assert (found.volume, found.labels) == (tmp_path / "a.npz", tmp_path / "mine.npz")


def test_a_name_that_is_made_is_nobodys(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "t.csv").write_text("volume,name\n1.npz,s\n2.npz,s\n3.npz,in-s-2\n4.npz,s\n")
    names = [one.name for one in find_inputs([folder / "t.csv"])]
    assert len(set(names)) == 4
    assert names[2] == "in-s-2"


def test_links_to_folders_are_followed_and_round_in_a_circle_once(tmp_path: Path) -> None:
    folder, elsewhere = tmp_path / "study", tmp_path / "disk"
    folder.mkdir()
    elsewhere.mkdir()
    (folder / "a.npz").write_bytes(b"-")
    (elsewhere / "b.npz").write_bytes(b"-")
    (folder / "self").symlink_to(folder)
    (folder / "patient").symlink_to(elsewhere)
    (elsewhere / "back").symlink_to(folder)
    assert [one.volume.name for one in find_inputs([folder])] == ["a.npz", "b.npz"]


@pytest.mark.skipif(os.name != "posix", reason="rights of POSIX")
def test_folders_that_may_not_be_looked_into_are_scans_whose_work_says_why() -> None:
    user = os.geteuid()
    # Not pytest's, which its user alone may look into.
    with TemporaryDirectory() as place:
        folder = Path(place)
        folder.chmod(0o755)
        for name, mode in (("closed", 0), ("listed", 0o444), ("open", 0o755)):
            (folder / name).mkdir()
            (folder / name / "a.npz").write_bytes(b"-")
            (folder / name).chmod(mode)
        (folder / "list.csv").write_text("volume\nopen/a.npz\nclosed/a.npz\n")
        try:
            # Rights do not hold the superuser.
            os.seteuid(user or 65534)
            scans, rows = find_inputs([folder]), find_inputs([folder / "list.csv"])
        finally:
            os.seteuid(user)
            for name in ("closed", "listed"):
                (folder / name).chmod(0o755)
    found = [str(one.volume.relative_to(folder)) for one in scans]
    assert found == ["closed", "listed", "open/a.npz"]
    assert [one.volume.parent.name for one in rows] == ["open", "closed"]
