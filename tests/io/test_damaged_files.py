"""What is damaged is opened or refused in one sentence; `make fuzz` tries as long as it is let."""

from itertools import islice
from pathlib import Path

import damaged_files
import pytest

from napari_unpack.io import load_volume
from napari_unpack.read_errors import read_errors_told
from napari_unpack.tasks import Cancelled


def test_three_hundred_damaged_files_are_opened_or_refused_in_one_sentence(tmp_path: Path) -> None:
    wrong = [
        f"seed {seed}, {path.name}: {error!r}"
        for seed, path, error in islice(damaged_files.cases(0, tmp_path), 300)
        if not damaged_files.is_told(error, path)
    ]
    assert wrong == []


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


def test_a_volume_larger_than_the_memory_is_refused(tmp_path: Path) -> None:
    # A header alone: the numbers it promises would fill a petabyte.
    path = tmp_path / "huge.npy"
    header = "{'descr': '<f8', 'fortran_order': False, 'shape': (50000, 50000, 50000), }"
    header = header.ljust(117) + "\n"
    path.write_bytes(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode())
    with pytest.raises(ValueError, match=r"huge.npy"):
        load_volume(path)
