"""What is damaged is opened or refused in one sentence; `make fuzz` tries as long as it is let."""

import logging
import os
import re
from collections.abc import Callable
from pathlib import Path
from random import Random

import damaged_files
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from napari_unpack.appearance import Background
from napari_unpack.io import load_volume, open_session
from napari_unpack.io.label_names import load_label_names
from napari_unpack.io.napari_reader import get_reader
from napari_unpack.io.scoring import score_report
from napari_unpack.io.session_archive import holds_session
from napari_unpack.read_errors import read_errors_told
from napari_unpack.segmentation import Oracle
from napari_unpack.tasks import Cancelled


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return damaged_files.good_files(tmp_path_factory.mktemp("files"))


# As many for each reader: which one is drawn as well would leave some out.
@pytest.mark.parametrize("reader", range(damaged_files.READERS))
@settings(max_examples=20, deadline=None, derandomize=True, database=None)
@given(source=st.randoms(use_true_random=False))
def test_damaged_files_are_opened_or_refused_in_one_sentence(
    whole: list[Path], reader: int, source: Random
) -> None:
    file = whole[reader]
    path, error = damaged_files.one_case(file, file.parent.parent, damaged_files.Drawn(source))
    assert damaged_files.is_told(error, path), repr(error)


def test_files_that_once_ended_otherwise_are_told(tmp_path: Path) -> None:
    wrong = [
        f"seed {seed}, {path.name}: {error!r}"
        for seed, path, error in damaged_files.cases(damaged_files.KEPT, tmp_path)
        if not damaged_files.is_told(error, path)
    ]
    assert wrong == []
    assert len(list((tmp_path / "good").iterdir())) == damaged_files.READERS


@pytest.mark.parametrize(
    "error",
    [
        ZeroDivisionError("division"),
        RuntimeError("a\nb"),
        KeyError("x"),
        OverflowError(),
        OSError(),
    ],
)
def test_any_error_of_a_reader_names_the_file(error: Exception) -> None:
    with (
        pytest.raises(ValueError, match=rf"bag.tif is damaged, .*{type(error).__name__}") as told,
        read_errors_told(Path("bag.tif")),
    ):
        raise error
    assert "\n" not in str(told.value)
    with (
        pytest.raises(ValueError, match=r"bag.tif asks for more memory"),
        read_errors_told(Path("bag.tif")),
    ):
        raise MemoryError
    with pytest.raises(Cancelled), read_errors_told(Path("bag.tif")):
        raise Cancelled


@pytest.mark.parametrize("path", ["there/data", "b"])
def test_a_file_is_named_by_its_path_whatever_words_the_reason_has(path: str) -> None:
    with (
        pytest.raises(ValueError, match=rf"^{path}: the number of data is odd$"),
        read_errors_told(Path(path)),
    ):
        raise ValueError("the number of data is odd")


@pytest.mark.parametrize(
    ("told", "damaged"),
    [(rb"0.5\0.75", rb"0.5\0?75"), (b"1.2.840.10008.1.2.1\0", b"1.2.840.10008.1.2.9\0")],
)
def test_of_a_series_the_damaged_slice_is_named(
    tmp_path: Path, told: bytes, damaged: bytes
) -> None:
    pytest.importorskip("pydicom")
    from test_dicom import write_series

    write_series(tmp_path / "scan")
    file = tmp_path / "scan" / "b"
    whole = file.read_bytes()
    assert whole.count(told) == 1
    file.write_bytes(whole.replace(told, damaged))
    with pytest.raises(ValueError, match=f"^{re.escape(str(file))}"):
        load_volume(tmp_path / "scan")


def test_readers_at_once_leave_the_logs_of_libraries_as_they_were() -> None:
    log = logging.getLogger("pydicom")
    before = log.level
    first, second = read_errors_told(Path("a")), read_errors_told(Path("b"))
    first.__enter__()
    second.__enter__()
    assert not log.isEnabledFor(logging.CRITICAL)
    first.__exit__(None, None, None)
    second.__exit__(None, None, None)
    assert log.level == before


SUFFIXES = (".npz", ".npy", ".nii", ".nii.gz", ".mha", ".mhd", ".nrrd", ".nhdr", ".tif", ".dcm", "")
SUFFIXES += (".zarr", ".unpack", ".ctbl", ".seg.nrrd", ".csv")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes")
@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("read", [load_volume, open_session, load_label_names, Oracle.load])
def test_what_is_no_file_is_refused_at_once(
    tmp_path: Path, read: Callable[[Path], object], suffix: str
) -> None:
    names = ("empty", "folder", "pipe", "device", "circle", "a\udcffb", "n" * 300, "a\0b")
    files = [tmp_path / f"{name}{suffix}" for name in names]
    empty, folder, pipe, device, circle, odd, *_ = files
    empty.touch()
    folder.mkdir()
    os.mkfifo(pipe)
    device.symlink_to("/dev/zero")
    circle.symlink_to(circle)
    odd.write_bytes(b"this is none of them")
    for file in files:
        with pytest.raises((ValueError, FileNotFoundError)) as told:
            read(file)
        assert file.name in str(told.value)
        assert "\n" not in str(told.value)
        # Neither waits for a pipe, nor fails on a name.
        get_reader(str(file))
        holds_session(file)


def scored_by(table: Path) -> str:
    labels = np.ones((2, 2, 2), np.uint16)
    return score_report(labels, labels, (1.0, 1.0, 1.0), table, "kind", False)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes")
@pytest.mark.parametrize(("read", "suffix"), [(Background.of, ".png"), (scored_by, ".csv")])
def test_pictures_and_tables_that_are_none_are_told(
    tmp_path: Path, read: Callable[[Path], object], suffix: str
) -> None:
    names = ("empty", "folder", "pipe", "noise", "nowhere")
    empty, folder, pipe, noise, nowhere = (tmp_path / f"{name}{suffix}" for name in names)
    empty.touch()
    folder.mkdir()
    os.mkfifo(pipe)
    noise.write_bytes(np.random.default_rng(0).bytes(3000))
    for file in (empty, folder, pipe, noise, nowhere):
        with pytest.raises((ValueError, FileNotFoundError)) as told:
            read(file)
        assert file.name in str(told.value)
        assert "\n" not in str(told.value)


def test_what_a_person_may_not_read_is_told() -> None:
    with (
        pytest.raises(PermissionError, match=r"^a.npz may not be read by you: "),
        read_errors_told(Path("a.npz")),
    ):
        raise PermissionError(13, "Permission denied", "a.npz")
    with (
        pytest.raises(ValueError, match=r"^a.npz cannot be read: Input/output error$"),
        read_errors_told(Path("a.npz")),
    ):
        raise OSError(5, "Input/output error", "a.npz")


def test_a_volume_larger_than_the_memory_is_refused(tmp_path: Path) -> None:
    # A header alone: the numbers it promises would fill a petabyte.
    path = tmp_path / "huge.npy"
    header = "{'descr': '<f8', 'fortran_order': False, 'shape': (50000, 50000, 50000), }"
    header = header.ljust(117) + "\n"
    path.write_bytes(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode())
    with pytest.raises(ValueError, match=r"huge.npy"):
        load_volume(path)
