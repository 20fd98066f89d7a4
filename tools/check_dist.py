"""Try what was built as a person gets it: `make dist`.

Each file of a folder is installed into a fresh environment, outside the repository, with the
versions of `requirements/dev.txt`; there the plugin unpacks its sample bag (`sample_bag.py`).
`--lowest` takes the lowest versions that `pyproject.toml` allows instead.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
LARGEST_WHEEL = 5e6
"""Bytes."""


def main(folder: Path, lowest: bool) -> None:
    """Check every wheel and sdist of a folder.

    Parameters
    ----------
    folder : Path
        Holds one wheel and one sdist.
    lowest : bool
        Install the lowest versions allowed, of the wheel alone.
    """
    (wheel,), (sdist,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    size = wheel.stat().st_size
    print(f"{wheel.name}: {size / 1e6:.2f} MB; {sdist.name}: {sdist.stat().st_size / 1e6:.2f} MB")
    if size > LARGEST_WHEEL:
        raise SystemExit(f"a wheel is to have at most {LARGEST_WHEEL / 1e6:.0f} MB")
    versions = ["--constraint", ROOT / "requirements" / "dev.txt"]
    if lowest:
        versions = ["--resolution", "lowest-direct"]
    for built in (wheel,) if lowest else (wheel, sdist):
        began = time.monotonic()
        with tempfile.TemporaryDirectory() as place:
            told = _unpack_sample(built.resolve(), Path(place), versions)
        print(f"{built.name}: {told.strip()} ({time.monotonic() - began:.0f} s)")


def _unpack_sample(built: Path, place: Path, versions: list[str | Path]) -> str:
    """Install a file into a new environment, unpack the sample there; return what was printed."""
    uv = Path(sys.executable).with_name("uv")
    environment = place / "environment"
    _run(place, uv, "venv", "--quiet", "--python", sys.executable, environment)
    python = environment / ("Scripts" if os.name == "nt" else "bin") / "python"
    into = ("pip", "install", "--quiet", "--python", python)
    _run(place, uv, *into, *versions, built, "napari[pyqt6]")
    shutil.copy(ROOT / "tools" / "sample_bag.py", place)
    return _run(place, python, "sample_bag.py")


def _run(place: Path, *command: str | Path) -> str:
    # A path to the repository, or a kernel compiled there, would hide what the file lacks.
    mine = {"PYTHONPATH", "NUMBA_CACHE_DIR", "VIRTUAL_ENV"}
    environment = {key: value for key, value in os.environ.items() if key not in mine}
    environment |= {"XDG_DATA_HOME": str(place / "data"), "NAPARI_CONFIG": ""}
    done = subprocess.run(
        [str(part) for part in command],
        cwd=place,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise SystemExit(f"{command[0]} failed:\n{done.stdout}{done.stderr}")
    return done.stdout


if __name__ == "__main__":
    main(Path(sys.argv[1]), lowest="--lowest" in sys.argv[2:])
