"""Every writer leaves the old file or the new one, whatever happens: see `saves_at_risk.py`."""

import copy
import errno
import json
import os
import re
import shutil
import stat
import subprocess
import sys
import tempfile
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import imageio.v3 as iio
import numpy as np
import pytest
import SimpleITK as sitk
import tifffile

import napari_unpack as nu
from napari_unpack.atomic import (
    check_space,
    check_writable,
    folder_written_atomically,
    recover_folder,
    written_atomically,
)
from napari_unpack.io import Scan, save_scan
from napari_unpack.io.movies import movie_writer

SCRIPT = Path(__file__).with_name("saves_at_risk.py")
FORMATS = 16


@pytest.fixture(scope="module")
def tried(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """Return what became of each format at every risk."""
    folder = tmp_path_factory.mktemp("saves")
    done = subprocess.run(
        [sys.executable, SCRIPT, "all", folder], capture_output=True, text=True, check=False
    )
    # Reading either of the two contents back is part of the script: anything else ends it.
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def at_risk(tried: list[dict[str, Any]], risk: str) -> list[dict[str, Any]]:
    found = [each for each in tried if each["risk"] == risk]
    assert len(found) == FORMATS
    return found


@pytest.mark.parametrize("risk", ["full", "small"])
def test_a_full_disk_is_told_and_keeps_the_old_file(tried: list[dict[str, Any]], risk: str) -> None:
    for found in at_risk(tried, risk):
        if found["said"] is None:
            pytest.skip("no disk can be mounted here")
        assert "\n" not in found["said"], found
        assert found["kept"], found
        assert found["alone"], found
        assert "could not be written: " in found["said"], found
        assert "what was there before is unchanged" in found["said"], found


def test_what_another_user_owns_is_told_and_left_as_it_is(tried: list[dict[str, Any]]) -> None:
    for found in at_risk(tried, "foreign"):
        assert found["kept"], found
        assert found["alone"], found
        for said in found["said"]:
            # Before long work the folder is told, after it the file.
            refused = r"(could not be written|cannot be written into \S+): Permission denied"
            assert re.search(refused, said) or "another user's" in said
            assert "bag" in said, found


def test_a_kill_at_any_moment_leaves_one_of_the_two_files_whole(
    tried: list[dict[str, Any]],
) -> None:
    for found in at_risk(tried, "killed"):
        assert sum(found["held"].values()) == 5, found
        assert found["last"] == 0, found
        assert found["alone"], "the next save sweeps what killed ones left"


def save(path: Path, text: str) -> None:
    with written_atomically(path) as temporary:
        temporary.write_text(text)


def test_a_link_is_followed_and_modes_are_kept(tmp_path: Path) -> None:
    real, link = tmp_path / "real.txt", tmp_path / "link.txt"
    save(real, "old")
    mask = os.umask(0o022)
    os.umask(mask)
    assert stat.S_IMODE(real.stat().st_mode) == 0o666 & ~mask
    real.chmod(0o640)
    link.symlink_to(real)
    save(link, "new")
    assert link.is_symlink()
    assert real.read_text() == "new"
    assert stat.S_IMODE(real.stat().st_mode) == 0o640


def test_a_read_only_file_is_not_replaced(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    save(path, "old")
    path.chmod(0o444)
    with pytest.raises(PermissionError, match="is read-only: choose another name"):
        check_writable(path)
    with pytest.raises(PermissionError, match="is read-only"):
        save(path, "new")
    assert path.read_text() == "old"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="named pipes are of Unix")
def test_a_pipe_or_a_device_is_not_replaced(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.csv"
    os.mkfifo(pipe)
    for write in (lambda: check_writable(pipe), lambda: save(pipe, "new")):
        with pytest.raises(ValueError, match=r"pipe\.csv is a pipe or a device: choose the name"):
            write()
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert list(tmp_path.iterdir()) == [pipe]


def test_a_name_that_is_too_long_is_told_in_a_sentence(tmp_path: Path) -> None:
    long = tmp_path / f"{'z' * 250}.unpack"
    labels = np.indices((4, 4, 4))[0] // 2
    session = nu.Session(1000.0 * labels, labels)
    for write in (
        lambda: check_writable(long),
        lambda: check_writable(long / "a.txt"),
        lambda: save(long, "new"),
        lambda: nu.save_session(session, long),
    ):
        with pytest.raises(OSError, match=r"cannot be written into|no folder") as told:
            write()
        assert "Errno" not in str(told.value)
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_may_not_be_looked_at_is_told_as_one_without_permission(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, stat = tmp_path / "a.npz", Path.stat

    def refused(self: Path, *, follow_symlinks: bool = True) -> os.stat_result:
        if self == path:
            raise PermissionError(errno.EACCES, "Permission denied", str(self))
        return stat(self, follow_symlinks=follow_symlinks)

    # As in a folder that may be listed and not entered, which stops no test run by root.
    monkeypatch.setattr(Path, "stat", refused)
    with pytest.raises(PermissionError, match=r"^Permission denied: a.npz cannot be written into"):
        check_writable(path)


def test_a_folder_that_is_missing_or_full_is_told_before_the_work(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no folder"):
        check_writable(tmp_path / "none" / "a.npz")
    check_space(tmp_path / "a.npz", 1000)
    with pytest.raises(OSError, match=r"needs about .* MB, but .* has .* MB free"):
        check_space(tmp_path / "a.npz", 10**18)
    assert list(tmp_path.iterdir()) == []


def test_less_than_a_megabyte_is_told_in_kilobytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=12_000))
    with pytest.raises(OSError, match=r"needs about 340 kB, but \S+ has 12 kB free"):
        check_space(tmp_path / "a.npz", 340_000)


@pytest.fixture
def film_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """Return the folder for temporary files, which is empty, and one to write films to."""
    temporary, there = tmp_path / "temporary", tmp_path / "there"
    temporary.mkdir()
    there.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    return temporary, there


def test_a_film_says_that_the_folder_for_temporary_files_is_full(
    film_folders: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    temporary, there = film_folders
    # As ffmpeg ends on a full disk, where its own words find no room.
    encoder = tmp_path / "ffmpeg"
    encoder.write_text(f"#!/bin/sh\ncat > /dev/null\nexit {256 - errno.ENOSPC}\n")
    encoder.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(encoder))

    def film() -> None:
        with movie_writer(there / "bag.mp4", (32, 48), 10) as write:
            write(np.zeros((32, 48, 3), np.uint8))

    where = f"No space left on device in {re.escape(str(temporary))}, the folder for temporary"
    with pytest.raises(OSError, match=f"could not be written: {where} files; what was there"):
        film()
    assert not any(there.iterdir())
    assert not any(temporary.iterdir())


def test_a_finished_film_that_cannot_take_its_place_stays_elsewhere_and_says_where(
    film_folders: tuple[Path, Path], tmp_path: Path
) -> None:
    temporary, there = film_folders
    frames = np.zeros((5, 32, 48, 3), np.uint8)
    frames[:, 8:24, 8:40] = 200

    def film() -> None:
        with movie_writer(there / "bag.mp4", (32, 48), 10) as write:
            for frame in frames:
                write(frame)
            # The folder goes while the work is done, as one on another machine may.
            there.rmdir()

    with pytest.raises(OSError, match="the finished file is") as told:
        film()
    kept = Path(str(told.value).rpartition("the finished file is ")[2])
    assert kept.name == "bag.mp4"
    assert list(temporary.iterdir()) == [kept.parent]
    assert len(iio.imread(kept)) == 5
    # One that can leaves nothing behind.
    shutil.rmtree(kept.parent)
    there.mkdir()
    with movie_writer(there / "bag.mp4", (32, 48), 10) as write:
        assert len(list(temporary.iterdir())) == 1
        for frame in frames:
            write(frame)
    assert len(iio.imread(there / "bag.mp4")) == 5
    assert not any(temporary.iterdir())
    with pytest.raises(FileNotFoundError, match="no folder"):
        movie_writer(tmp_path / "nowhere" / "bag.mp4", (32, 48), 10).__enter__()


def test_a_check_that_fails_keeps_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    save(path, "old")

    def refuse(written: Path) -> None:
        assert written.read_text() == "new"
        raise OSError("it is not whole")

    with (
        pytest.raises(OSError, match="it is not whole; what was there before is unchanged"),
        written_atomically(path, refuse) as temporary,
    ):
        temporary.write_text("new")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"given_ids": np.array([0, -(2**63)])}, "given_ids must be IDs from 0"),
        ({"most_objects": 70_000}, "slots and largest_id must be at most 65535"),
        ({"largest_id": 70_000}, "slots and largest_id must be at most 65535"),
    ],
)
def test_a_session_numbered_as_none_opens_keeps_the_old_file(
    tmp_path: Path, wrong: dict[str, Any], words: str
) -> None:
    ones = np.ones((4, 4, 4), np.uint16)
    session = nu.Session(ones, ones)
    kept = nu.save_session(session, tmp_path / "bag.unpack").read_bytes()
    data = replace(session.label_data, **wrong)
    rest = session.state, session.view_state, session.rules
    odd = nu.Session.of_parts(session.volume, session.spacing, data, *rest)
    with pytest.raises(ValueError, match=words):
        nu.save_session(odd, tmp_path / "bag.unpack")
    assert (tmp_path / "bag.unpack").read_bytes() == kept


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz", ".mha", ".nrrd", ".tif"])
@pytest.mark.parametrize("lost", ["first", "last", "fewer"])
def test_what_a_writer_loses_without_a_word_is_read_back_and_missed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, lost: str
) -> None:
    path = tmp_path / f"a{suffix}"
    volume = np.arange(1, 61, dtype=np.uint16).reshape(3, 4, 5)
    save_scan(Scan(volume, (1.0, 1.0, 1.0)), path)
    before = path.read_bytes()
    write_image, write_tiff = sitk.WriteImage, tifffile.imwrite

    def less(array: np.ndarray) -> np.ndarray:
        if lost == "fewer":
            return array[:-1]
        array = array.copy()
        array[0 if lost == "first" else -1, 2, 2] = 0
        return array

    def image(found: Any, *given: Any, **options: Any) -> None:
        write_image(sitk.GetImageFromArray(less(sitk.GetArrayFromImage(found))), *given, **options)

    def tiff(file: Any, array: np.ndarray, **options: Any) -> None:
        # Its axes are t, z, c, y, x and samples.
        write_tiff(file, less(array[0, :, 0, ..., 0])[None, :, None, ..., None], **options)

    monkeypatch.setattr(sitk, "WriteImage", image)
    monkeypatch.setattr(tifffile, "imwrite", tiff)
    with pytest.raises(OSError, match="it is not whole: is the disk full"):
        save_scan(Scan(volume + 1, (1.0, 1.0, 1.0)), path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_the_disk_has_the_data_before_the_name_is_taken_and_the_name_after(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[object] = []
    sync, replace = os.fsync, Path.replace

    def synced(handle: int) -> None:
        done.append(os.fstat(handle).st_ino)
        sync(handle)

    def replaced(self: Path, target: Path) -> Path:
        done.append("renamed")
        return replace(self, target)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(Path, "replace", replaced)
    save(tmp_path / "a.txt", "new")
    here = tmp_path.stat().st_ino
    assert done == [(tmp_path / "a.txt").stat().st_ino, "renamed", here]
    done.clear()
    save_folder(tmp_path / "bag", "new")
    folder = tmp_path / "bag"
    inside = [(folder / "a.txt").stat().st_ino, folder.stat().st_ino]
    assert done == [*inside, "renamed", here]


def test_a_folder_that_cannot_be_stored_on_demand_makes_no_save_fail(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = os.open

    def refused(path: Any, *given: Any, **options: Any) -> int:
        if Path(path) == tmp_path:
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return opened(path, *given, **options)

    # As of a folder that one may write into and not look into, which stops no test run by root.
    monkeypatch.setattr(os, "open", refused)
    save(tmp_path / "a.txt", "new")
    save_folder(tmp_path / "bag", "new")
    with monkeypatch.context() as patch:
        # Where names cannot be exchanged.
        patch.setattr(sys, "platform", "darwin")
        save_folder(tmp_path / "bag", "newer")
    assert (tmp_path / "a.txt").read_text() == "new"
    assert (tmp_path / "bag" / "a.txt").read_text() == "newer"


@pytest.mark.skipif(not Path("/proc/self/ns/pid").is_symlink(), reason="containers are of Linux")
def test_a_process_of_another_container_is_not_taken_for_one_that_was_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    with monkeypatch.context() as patch:
        # One that lives there has a number that is nobody's here.
        patch.setattr(os, "getpid", lambda: ended.pid)
        patch.setattr(os, "readlink", lambda _: "pid:[1]")
        writing = written_atomically(tmp_path / "a.txt")
        temporary = writing.__enter__()
    temporary.write_text("of an hour")
    save(tmp_path / "b.txt", "new")
    writing.__exit__(None, None, None)
    assert (tmp_path / "a.txt").read_text() == "of an hour"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.txt", "b.txt"]


def test_a_file_stays_its_owners(tmp_path: Path) -> None:
    path, owner = tmp_path / "a.txt", os.geteuid()
    save(path, "old")
    if owner == 0:
        # Root alone may give files away.
        owner = 65534
        os.chown(path, owner, owner)
    save(path, "new")
    assert path.read_text() == "new"
    assert path.stat().st_uid == owner


def save_folder(path: Path, text: str) -> None:
    with folder_written_atomically(path, lambda _: True) as temporary:
        (temporary / "a.txt").write_text(text)


@pytest.mark.skipif(sys.platform != "linux", reason="names are exchanged on Linux")
def test_at_no_moment_is_there_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, seen, done = tmp_path / "bag", [], threading.Event()
    save_folder(path, "old")

    def look() -> None:
        while not done.is_set():
            seen.append((path / "a.txt").exists())

    watching = threading.Thread(target=look)
    watching.start()
    monkeypatch.setattr(Path, "replace", lambda *_: pytest.fail("one of two renames"))
    for text in ("new", "newer") * 20:
        save_folder(path, text)
    done.set()
    watching.join()
    assert len(seen) > 20
    assert all(seen)
    assert (path / "a.txt").read_text() == "newer"
    assert [other.name for other in tmp_path.iterdir()] == ["bag"]


def test_a_folder_survives_a_kill_between_its_two_renames(tmp_path: Path, monkeypatch) -> None:
    path = tmp_path / "bag"
    save_folder(path, "old")
    replace, moved = Path.replace, []

    class KilledError(BaseException):
        """What no handler catches."""

    def killed(self: Path, target: Path) -> Path:
        # The first rename moves the old folder aside, the second never comes.
        if moved:
            raise KilledError
        moved.append(target)
        return replace(self, target)

    with monkeypatch.context() as patch:
        # Where names cannot be exchanged.
        patch.setattr(sys, "platform", "darwin")
        patch.setattr(Path, "replace", killed)
        with pytest.raises(KilledError):
            save_folder(path, "new")
    assert not path.exists()
    recover_folder(path)
    assert (path / "a.txt").read_text() == "old"
    # A kill after the second rename leaves the old folder behind: the next save removes it.
    (tmp_path / ".bag.before").mkdir()
    save_folder(path, "new")
    assert (path / "a.txt").read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_disk_is_told_once_of_a_file_in_a_folder(tmp_path: Path) -> None:
    with (
        pytest.raises(OSError, match=r"scan could not be written: No space left") as told,
        folder_written_atomically(tmp_path / "scan", lambda _: True) as folder,
        written_atomically(folder / "page.html"),
    ):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    sentence = f"{tmp_path / 'scan'} could not be written: No space left on device"
    assert str(told.value) == f"{sentence}; what was there before is unchanged"
    assert told.value.errno == errno.ENOSPC
    # As it comes from another process.
    assert str(copy.copy(told.value)) == str(told.value)
    assert not list(tmp_path.iterdir())
