"""A run that goes on: what is kept can be opened, and what was lost is there again."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from dask_pair import make_bag

import napari_unpack as nu
from napari_unpack.batches.results import results_in, session_in
from napari_unpack.batches.run_settings import Settings, check_folder, claim_folder
from napari_unpack.io import load_labels, load_volume

pytest.importorskip("distributed")
QUICK: dict[str, Any] = {"pictures": False}


def test_sessions_without_copies_open_whatever_became_of_the_names_of_their_volumes(
    client: Any, tmp_path: Path
) -> None:
    scans, output = tmp_path / "in", tmp_path / "out"
    scans.mkdir()
    for seed, name in enumerate("ab"):
        make_bag(scans / f"{name}.npz", seed)

    def done() -> dict[str, str]:
        report = nu.batch(scans, output, client, copies=False, **QUICK)
        for one in report.results:
            opened = nu.open_session(session_in(output, one.scan))
            assert np.array_equal(opened.volume, load_volume(one.source).volume)
        return {one.scan: one.status for one in report.results}

    assert done() == {"a": "done", "b": "done"}
    # What a person did with it since stays.
    session = nu.open_session(session_in(output, "a"))
    session.annotations.set_note(2, "a note")
    nu.save_session(session, session_in(output, "a"), copy=False, volume_path=scans / "a.npz")
    (scans / "a.npz").rename(scans / "renamed.npz")
    assert done() == {"b": "kept", "renamed": "kept"}
    assert nu.open_session(session_in(output, "renamed")).annotations.notes[2] == "a note"
    # Each has the other's name now.
    for here, there in (("renamed", "t"), ("b", "renamed"), ("t", "b")):
        (scans / f"{here}.npz").rename(scans / f"{there}.npz")
    assert done() == {"b": "kept", "renamed": "kept"}
    # A copy is no reason to write anything.
    times = {file: file.stat().st_mtime_ns for file in output.glob("scans/*/*")}
    shutil.copy(scans / "b.npz", scans / "copy.npz")
    nu.batch(scans / "copy.npz", output, client, copies=False, **QUICK)
    assert {file: file.stat().st_mtime_ns for file in output.glob("scans/*/*")} == times


def test_what_a_moved_file_held_under_another_name_is_no_scan_of_its_own(
    client: Any, tmp_path: Path
) -> None:
    scans, output, table = tmp_path / "in", tmp_path / "out", tmp_path / "scans.csv"
    scans.mkdir()
    make_bag(scans / "b.npz", 0)
    table.write_text("volume,name\nin/b.npz,other\n")
    nu.batch(table, output, client, **QUICK)
    make_bag(scans / "b.npz", 1)
    nu.batch(scans, output, client, **QUICK)
    (scans / "b.npz").rename(scans / "moved.npz")
    nu.batch(scans, output, client, **QUICK)
    assert pd.read_parquet(output / "scans.parquet")["scan"].tolist() == ["moved"]


@pytest.mark.parametrize("labels", ["npz", "zarr"])
def test_lost_labels_and_a_lost_session_are_made_again(
    client: Any, bags: Path, tmp_path: Path, labels: str
) -> None:
    output, named = tmp_path / "out", "labels.npz" if labels == "npz" else "labels.ome.zarr"
    scan = tmp_path / "a.npz"
    shutil.copy(bags / "a.npz", scan)
    (first,) = nu.batch(scan, output, client, labels=labels, **QUICK).results
    folder = output / first.folder
    true = load_labels(folder / named)[0]
    session = nu.open_session(folder / "session.unpack")
    session.annotations.set_note(2, "a note")
    nu.save_session(session, folder / "session.unpack")
    shutil.rmtree(folder / named) if labels == "zarr" else (folder / named).unlink()
    (again,) = nu.batch(scan, output, client, labels=labels, **QUICK).results
    assert np.array_equal(load_labels(folder / named)[0], true)
    # Not at the cost of what a person did since.
    assert nu.open_session(folder / "session.unpack").annotations.notes[2] == "a note"
    assert again.status == "kept"
    (folder / "session.unpack").unlink()
    scan.rename(tmp_path / "renamed.npz")
    report = nu.batch(tmp_path / "renamed.npz", output, client, labels=labels, **QUICK)
    assert report.results[0].status == "done"
    assert nu.open_session(session_in(output, "renamed")).step == 0
    # In its place, and not beside it.
    assert [one.scan for one in results_in(output)] == ["renamed"]


def test_lost_pages_and_pictures_are_drawn_again_of_the_bag_as_it_was(
    client: Any, tmp_path: Path
) -> None:
    scan, output = make_bag(tmp_path / "a.npz", 0), tmp_path / "out"
    (first,) = nu.batch(scan, output, client).results
    drawn = [output / first.folder / name for name in ("objects.html", "picture.png")]
    before = [file.read_bytes() for file in drawn]
    file = output / first.folder / "session.unpack"
    session = nu.open_session(file)
    session.unpack(2)
    nu.save_session(session, file)
    left = file.read_bytes()
    for lost in drawn:
        lost.unlink()
    (again,) = nu.batch(scan, output, client).results
    assert (again.status, again.notes) == ("kept", first.notes)
    assert [file.read_bytes() for file in drawn] == before
    assert file.read_bytes() == left
    assert "picture.png" in (output / "index.html").read_text("utf-8")


def test_files_of_one_name_that_come_one_after_another_are_two_scans(
    client: Any, tmp_path: Path
) -> None:
    output = tmp_path / "out"
    for seed, day in enumerate(("monday", "tuesday")):
        (tmp_path / day).mkdir()
        make_bag(tmp_path / day / "scan.npz", seed)
    names = {"monday": "scan", "tuesday": "tuesday-scan"}
    for day in ("monday", "tuesday", "tuesday", "monday"):
        report = nu.batch(tmp_path / day, output, client, **QUICK)
        assert [one.scan for one in report.results] == [names[day]]
    assert report.objects.groupby("scan").size().to_dict() == {"scan": 3, "tuesday-scan": 3}
    for day, name in names.items():
        volume = load_volume(tmp_path / day / "scan.npz").volume
        assert np.array_equal(nu.open_session(session_in(output, name)).volume, volume)


def test_scans_keep_their_names_when_their_folder_is_moved(client: Any, tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    make_bag(tmp_path / "in" / "a.npz", 0)
    assert [
        one.scan for one in nu.batch(tmp_path / "in", tmp_path / "out", client, **QUICK).results
    ]
    (tmp_path / "in").rename(tmp_path / "moved")
    for _ in range(2):
        report = nu.batch(tmp_path / "moved", tmp_path / "out", client, **QUICK)
        assert [(one.scan, one.status) for one in report.results] == [("a", "kept")]


def test_a_folder_in_which_a_run_of_the_same_settings_begins_is_taken_too(tmp_path: Path) -> None:
    output = tmp_path / "out"
    (output / "scans").mkdir(parents=True)
    for _ in range(2):
        claim_folder(output, Settings())
    check_folder(output, Settings())


def test_of_two_runs_that_begin_together_with_other_settings_one_is_refused(tmp_path: Path) -> None:
    output, mine, theirs = tmp_path / "out", Settings(), Settings(labels="zarr")
    for settings in (mine, theirs):
        check_folder(output, settings)
    claim_folder(output, theirs, force=False)
    with pytest.raises(ValueError, match=r"other settings \(labels zarr there and npz now\)"):
        claim_folder(output, mine, force=False)
    check_folder(output, theirs)
    claim_folder(output, theirs, force=False)
    claim_folder(output, mine, force=True)
    check_folder(output, mine)


def test_scans_of_one_content_have_folders_of_their_own_whatever_letters_their_names_have(
    client: Any, tmp_path: Path
) -> None:
    scans, output = tmp_path / "in", tmp_path / "out"
    scans.mkdir()
    names = ["ö", "ü", "x" * 70 + "1", "x" * 70 + "2", "a b", "a_b"]
    for name in names:
        make_bag(scans / f"{name}.npz", 0)
    report = nu.batch(scans, output, client, **QUICK)
    assert len({one.folder for one in report.results}) == len(names)
    assert sorted(one.scan for one in results_in(output)) == sorted(names)
    for name in names:
        assert session_in(output, name).is_file()
    # Folders that earlier versions made, without these letters, are kept.
    (folder,) = {one.folder for one in report.results if one.scan == "ü"}
    rest = [output / one.folder for one in report.results if one.scan != "ü"]
    for other in rest:
        shutil.rmtree(other)
    done = output / folder / "done.json"
    done.write_text(done.read_text().replace(folder, "scans/scan-25fef92407"))
    (output / folder).rename(output / "scans" / "scan-25fef92407")
    (again,) = nu.batch(scans / "ü.npz", output, client, **QUICK).results
    assert (again.status, again.folder) == ("kept", "scans/scan-25fef92407")


def test_a_lost_session_of_one_of_two_equal_scans_is_made_again_in_its_own_folder(
    client: Any, tmp_path: Path
) -> None:
    scans, output = tmp_path / "in", tmp_path / "out"
    scans.mkdir()
    for name in ("first", "second"):
        make_bag(scans / f"{name}.npz", 0)
    report = nu.batch(scans, output, client, **QUICK)
    folders = {one.scan: one.folder for one in report.results}
    for lost in ("first", "second"):
        (output / folders[lost] / "session.unpack").unlink()
        for order in (["first"], ["second"]):
            again = nu.batch([scans / f"{name}.npz" for name in order], output, client, **QUICK)
            assert again.results[0].folder == folders[order[0]]
        for name in folders:
            assert session_in(output, name).is_file()


def test_a_damaged_session_leaves_its_scan_among_those_done(client: Any, tmp_path: Path) -> None:
    make_bag(tmp_path / "bag.npz", 0)
    output = tmp_path / "out"
    nu.batch(tmp_path / "bag.npz", output, client, copies=False, **QUICK)
    session = session_in(output, "bag")
    session.write_bytes(session.read_bytes()[:200])
    (again,) = nu.batch(tmp_path / "bag.npz", output, client, copies=False, **QUICK).results
    assert again.status == "kept"
    assert "session.unpack" in " ".join(again.notes)
