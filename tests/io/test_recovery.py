"""Copies of unsaved sessions: written whole, of one process each, and never more than may be."""

from __future__ import annotations

import errno
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import napari_unpack as nu
from napari_unpack.io import recovery
from napari_unpack.io.recovery import Leftover, UnsavedCopy, leftovers, locked
from napari_unpack.io.session_archive import Told
from napari_unpack.io.session_json import record_of, work_of
from napari_unpack.segmentation.confidence.features import FEATURES
from napari_unpack.segmentation.confidence.oracle import fit_features


def bag() -> nu.Session:
    """Return a session of four cubes."""
    labels = np.zeros((12, 12, 12), np.uint8)
    for k, corner in enumerate(((1, 1, 1), (1, 7, 1), (1, 1, 7), (7, 7, 7))):
        z, y, x = corner
        labels[z : z + 4, y : y + 4, x : x + 4] = k + 1
    return nu.Session(labels.astype(np.uint16) * 300, labels, (2.0, 1.0, 1.0))


def quiet(_fraction: float) -> None:
    """Report to nobody."""


def kept(home: Path, session: nu.Session, told: Told = quiet) -> UnsavedCopy:
    copy = UnsavedCopy(home)
    copy.keep(session, "bag", None, told)
    return copy


def only(home: Path) -> Leftover:
    (found,) = leftovers(home)
    return found


def test_what_is_kept_comes_back_after_the_process_has_ended(tmp_path: Path) -> None:
    session = bag()
    copy = kept(tmp_path, session)
    session.unpack(2)
    session.rename(3, "a knife")
    copy.keep(session, "bag", np.eye(4), quiet)
    # A process that lives is left alone, also by itself.
    assert leftovers(tmp_path) == []
    copy.close()
    found = only(tmp_path)
    assert found.name == "bag"
    again = nu.open_session(found.session)
    assert record_of(again) == record_of(session)
    np.testing.assert_array_equal(again.labels, session.labels)
    assert found.discard()
    assert list(tmp_path.iterdir()) == []


def test_arrays_are_written_once_for_each_state_of_the_labels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names: list[str] = []
    write = recovery.write_array

    def counted(stream: Any, array: Any, told: Told) -> Any:
        names.append(Path(stream.name).stem)
        return write(stream, array, told)

    monkeypatch.setattr(recovery, "write_array", counted)
    session = bag()
    copy = kept(tmp_path, session)
    session.unpack(1)
    copy.keep(session, "bag", None, quiet)
    assert names == ["volume", "labels"]
    session.restore(1)
    session.merge([1, 2])
    copy.keep(session, "bag", None, quiet)
    assert names == ["volume", "labels", "labels"]
    copy.close()
    assert len(list(only(tmp_path).folder.iterdir())) == 2
    assert nu.open_session(only(tmp_path).session).ids == session.ids


def test_cancelled_in_the_middle_the_state_before_is_what_comes_back(tmp_path: Path) -> None:
    session = bag()
    copy = kept(tmp_path, session)
    before = record_of(session)
    session.merge([1, 2])

    def full(_fraction: float) -> None:
        raise OSError("no space left")

    with pytest.raises(OSError, match="no space"):
        copy.keep(session, "bag", None, full)
    copy.close()
    assert record_of(nu.open_session(only(tmp_path).session)) == before


def full_while_the_manifest_is_written(
    copy: UnsavedCopy, session: nu.Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(recovery, "written_atomically", full_disk)
        with pytest.raises(OSError, match="No space left"):
            copy.keep(session, "bag", None, quiet)


@contextmanager
def full_disk(_path: Path) -> Iterator[Path]:
    raise OSError(errno.ENOSPC, "No space left on device")
    yield


def test_a_state_whose_manifest_failed_leaves_no_earlier_one_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = bag()
    copy = kept(tmp_path, session)
    session.merge([1, 2])
    full_while_the_manifest_is_written(copy, session, monkeypatch)
    copy.keep(session, "bag", None, quiet)
    assert len(list(tmp_path.glob("*/*/labels.npz"))) == 1
    session.merge([3, 4])
    full_while_the_manifest_is_written(copy, session, monkeypatch)
    # Saved elsewhere: no state may be offered, nor the scan stay on the disk.
    copy.forget()
    assert len(list(tmp_path.glob("*/*/labels.npz"))) == 1
    copy.close()
    assert leftovers(tmp_path) == []
    assert list(tmp_path.iterdir()) == []


def test_what_is_saved_or_ended_is_not_offered(tmp_path: Path) -> None:
    session = bag()
    copy = kept(tmp_path, session)
    copy.forget()
    assert leftovers(tmp_path) == []
    copy.close()
    assert list(tmp_path.iterdir()) == []
    copy = kept(tmp_path, session)
    copy.forget()
    # The next change needs no arrays.
    copy.keep(session, "bag", None, quiet)
    copy.close()
    assert only(tmp_path).discard()
    copy = kept(tmp_path, session)
    copy.forget()
    copy.close()
    assert list(tmp_path.iterdir()) == []


def test_a_process_that_was_killed_leaves_its_copy_and_one_that_lives_keeps_it(
    tmp_path: Path,
) -> None:
    code = (
        "import sys, time; from pathlib import Path; import test_recovery as t;"
        "copy = t.kept(Path(sys.argv[1]), t.bag()); print('kept', flush=True); time.sleep(60)"
    )
    other = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path)],
        cwd=Path(__file__).parent,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert other.stdout is not None
        assert other.stdout.readline().strip() == "kept"
        assert leftovers(tmp_path) == []
    finally:
        other.kill()
        other.wait()
    assert only(tmp_path).name == "bag"


@pytest.mark.parametrize("numbered", [True, False])
def test_the_oldest_go_first_and_what_is_too_large_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, numbered: bool
) -> None:
    if not numbered:
        # As of a file system that tells no file from another by a number.
        monkeypatch.setattr(
            Path, "lstat", lambda file: SimpleNamespace(st_ino=0, st_size=file.stat().st_size)
        )
    session = bag()
    size = session.volume.nbytes + session.labels.nbytes
    for k in range(3):
        copy = UnsavedCopy(tmp_path, 100 * size)
        copy.keep(session, f"bag {k}", None, quiet)
        copy.close()
        (manifest,) = (one for one in leftovers(tmp_path) if one.name == f"bag {k}")
        time = 1000.0 + k
        recovery.os.utime(manifest.session / "session.json", (time, time))
    taken = sum(f.stat().st_size for f in tmp_path.rglob("*") if f.is_file())
    copy = UnsavedCopy(tmp_path, taken * 2 // 3 + size + 1)
    copy.keep(session, "new", None, quiet)
    copy.close()
    assert [one.name for one in leftovers(tmp_path)] == ["new", "bag 2", "bag 1"]
    with pytest.raises(OSError, match="more than"):
        UnsavedCopy(tmp_path, size - 1).keep(session, "large", None, quiet)
    assert len(leftovers(tmp_path)) == 3


def noisy_bag() -> nu.Session:
    """Return a session whose volume, unlike its labels, hardly deflates."""
    labels = np.kron(bag().labels, np.ones((4, 4, 4), np.uint8))
    numbers = np.random.default_rng(0).integers(0, 60_000, labels.shape)
    return nu.Session(numbers.astype(np.uint16), labels, (1.0, 1.0, 1.0))


def test_another_state_of_the_labels_needs_room_for_them_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept(tmp_path, bag()).close()
    session = noisy_bag()
    taken = sum(f.stat().st_size for f in tmp_path.rglob("*") if f.is_file())
    volume, labels = session.volume.nbytes, session.labels.nbytes
    # Both copies, the volume once, and some kB of manifests.
    copy = UnsavedCopy(tmp_path, taken + volume + 2 * labels + 20_000)
    copy.keep(session, "new", None, quiet)
    free = recovery.SPARE_BYTES + labels
    monkeypatch.setattr(recovery.shutil, "disk_usage", lambda _: SimpleNamespace(free=free))
    for pair in ([1, 2], [1, 3]):
        session.merge(pair)
        copy.keep(session, "new", None, quiet)
    assert only(tmp_path).name == "bag"
    copy.close()
    assert [one.name for one in leftovers(tmp_path)] == ["new", "bag"]


def test_without_hard_links_another_state_needs_room_for_the_volume_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_links(*_: object) -> None:
        raise OSError

    session = noisy_bag()
    copy = UnsavedCopy(tmp_path, 100 * session.volume.nbytes)
    copy.keep(session, "new", None, quiet)
    monkeypatch.setattr(recovery.os, "link", no_links)
    volume = next(tmp_path.rglob("volume.npz")).stat().st_size
    session.merge([1, 2])
    room = {"free": recovery.SPARE_BYTES + volume}
    monkeypatch.setattr(recovery.shutil, "disk_usage", lambda _: SimpleNamespace(**room))
    with pytest.raises(OSError, match="nearly full"):
        copy.keep(session, "new", None, quiet)
    room["free"] += session.labels.nbytes
    copy.keep(session, "new", None, quiet)
    copy.close()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows removes no file that is open")
def test_a_copy_whose_folder_was_removed_is_made_anew(tmp_path: Path) -> None:
    home, session = tmp_path / "unsaved", bag()
    copy = kept(home, session)
    shutil.rmtree(home)
    session.rename(1, "a knife")
    copy.keep(session, "bag", None, quiet)
    shutil.rmtree(home)
    copy.forget()
    copy.keep(session, "bag", None, quiet)
    copy.close()
    assert record_of(nu.open_session(only(home).session)) == record_of(session)


def test_a_copy_in_hand_is_not_taken_away(tmp_path: Path) -> None:
    kept(tmp_path, bag()).close()
    found = only(tmp_path)
    lock = locked(found.folder)
    assert lock is not None
    assert not found.discard()
    lock.close()
    assert found.discard()


def test_work_is_what_a_person_did_and_undo_takes_it_back() -> None:
    session = bag()
    before = work_of(session)
    session.recolor()
    session.select([1])
    session.inspect(2)
    session.view = nu.View((0.0, 1.0, 0.0))
    assert work_of(session) == before
    session.unpack(1)
    assert work_of(session) != before
    session.undo()
    assert work_of(session) == before
    session.merge([1, 2])
    session.undo()
    assert work_of(session) == before
    session.tint_mode = "safe"
    assert work_of(session) != before


def test_a_copy_holds_the_model_that_scored_the_objects(tmp_path: Path) -> None:
    session = bag()
    oracle = fit_features(np.random.default_rng(0).normal(size=(40, len(FEATURES))))
    session.use_oracle(oracle, dict.fromkeys(session.ids, 0.5))
    kept(tmp_path, session).close()
    found = nu.open_session(only(tmp_path).session)
    assert isinstance(found.label_editor.oracle, nu.Oracle)
    np.testing.assert_array_equal(found.label_editor.oracle.axes, oracle.axes)
    assert set(found.objects["confidence"]) == {0.5}
