"""No kernel outlives an edit of what it inlines; where none can be kept, all works as ever."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

TOOL = Path(__file__).parents[1] / "tools" / "fresh_kernels.py"

KERNEL = """
from numba import njit
from room.helper import twice

@njit(cache=True)
def asked(x):
    return twice(x)
"""
HELPER = """
from numba import njit
from room.amount import TIMES

@njit
def twice(x):
    return TIMES * x
"""


@pytest.fixture
def room(tmp_path):
    folder = tmp_path / "room"
    folder.mkdir()
    for name, text in {"kernel": KERNEL, "helper": HELPER, "amount": "TIMES = 2\n"}.items():
        write(folder / f"{name}.py", text, 1000)
    (folder / "__init__.py").touch()
    os.utime(folder / "__init__.py", (1000, 1000))
    return folder


def write(path, text, when):
    path.write_text(text)
    os.utime(path, (when, when))


def answer(room):
    command = "from room.kernel import asked; print(asked(21))"
    told = subprocess.run(
        [sys.executable, "-c", command], cwd=room.parent, check=True, capture_output=True, text=True
    )
    return int(told.stdout)


def freshen(room):
    subprocess.run([sys.executable, TOOL, room.parent], check=True)


def kernels(room):
    return sorted(p.name for p in (room / "__pycache__").glob("kernel.asked*.nb?"))


def test_a_kernel_lasts_until_code_two_imports_away_changes(room):
    freshen(room)
    assert answer(room) == 42
    kept = kernels(room)
    assert len(kept) == 2
    # Younger than its modules it is kept, whatever imports it.
    write(room / "another.py", "from room import kernel\n", 4e9)
    freshen(room)
    assert kernels(room) == kept
    # A comment or a file written again costs no kernel.
    later = (room / "__pycache__" / kept[0]).stat().st_mtime + 5
    write(room / "amount.py", '"""How often."""\n\nTIMES = 2  # As was asked for.\n', later)
    write(room / "kernel.py", KERNEL, later)
    freshen(room)
    assert kernels(room) == kept
    assert (room / "kernel.py").stat().st_mtime == 1000
    write(room / "amount.py", "TIMES = 3\n", later + 5)
    assert answer(room) == 42, "numba notices this by itself now: the tool can go"
    freshen(room)
    assert answer(room) == 63


def test_what_was_compiled_between_an_edit_and_its_undoing_goes(room):
    freshen(room)
    now = (room.parent / "__pycache__" / "kernel_sources.json").stat().st_mtime
    write(room / "amount.py", "TIMES = 3\n", now + 1)
    assert answer(room) == 63
    for name in kernels(room):
        os.utime(room / "__pycache__" / name, (now + 2, now + 2))
    write(room / "amount.py", "TIMES = 2\n", now + 3)
    freshen(room)
    assert answer(room) == 42


TWO_KERNELS = """
from napari_unpack.kernels import njit

@njit(cache=True)
def once(n):
    return n + 1

@njit(cache=True)
def twice(n):
    return once(once(n))
"""


def told_by(code, **options):
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, **options
    )


def test_on_a_full_disk_kernels_are_compiled_and_not_kept(tmp_path):
    (tmp_path / "two_kernels.py").write_text(TWO_KERNELS)
    # As on a full disk, no file takes a byte.
    full = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0)); "
    told = told_by(full + "from two_kernels import twice; print(twice(40))", cwd=tmp_path)
    assert told.stdout == "42\n", told.stderr
    assert told.stderr.count("Compiled code is not kept") == 1
    assert "NUMBA_CACHE_DIR" in told.stderr
    # With room they are, by numba's own rules.
    told = told_by("from two_kernels import twice; print(twice(40))", cwd=tmp_path)
    assert (told.stdout, told.stderr) == ("42\n", "")
    assert len(list((tmp_path / "__pycache__").glob("two_kernels.*.nbc"))) == 2


def test_where_no_folder_takes_kernels_they_are_compiled_all_the_same():
    # For what stands in no file numba has no folder, as where code and home are read-only.
    told = told_by(TWO_KERNELS + "print(twice(40))")
    assert told.stdout == "42\n", told.stderr
    assert told.stderr.count("Compiled code is not kept") == 1
