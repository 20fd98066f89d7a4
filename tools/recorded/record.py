"""Record what must not change while modules are renamed, moved and put together anew.

`python tools/recorded/record.py --write FILE` writes fingerprints of what the public functions
return on three simulated bags, and what the public names take; `--check FILE` works them out
again, says which differ and exits with 1 where any does. Three minutes on two free cores, of
which segmentation takes two; with `--slow`, which `--write` implies, a minute and a half more.
`--only NAME ...` takes some bags or groups, such as `pictures`.

Fingerprints are of every bit, so a record holds for one machine and one set of packages; it says
which. `--keep FOLDER` saves the values themselves, to see how two checkouts differ.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any

# Before anything imports PyOpenGL, as the Makefile does.
os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
os.environ.setdefault("EGL_PLATFORM", "surfaceless")

import numpy as np
from digests import digest, plain
from measured import RAISED, entries
from signatures import command_line, library

import napari_unpack

PACKAGES = ("numpy", "numba", "scipy", "scikit-learn", "scikit-image", "onnxruntime", "pandas")


def processor() -> str:
    """Return the name of the processor, as far as the system tells."""
    known = Path("/proc/cpuinfo")
    lines = known.read_text().splitlines() if known.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def made_with() -> dict[str, str]:
    """Return the machine and the packages that fingerprints hang on."""
    return {
        "python": platform.python_version(),
        "processor": f"{processor()}, {os.cpu_count()} cores",
        "mesa": " ".join(sorted(path.name for path in Path("/usr/lib").glob("*/libgallium-*.so"))),
        **{name: version(name) for name in PACKAGES},
    }


def keep(folder: Path, name: str, value: Any) -> None:
    """Save a value where it can be looked at: .npy for arrays, .json for all else."""
    path = folder / name.replace("/", "__").replace(" ", "_")
    folder.mkdir(parents=True, exist_ok=True)
    if isinstance(value, np.ndarray):
        np.save(f"{path}.npy", value)
    else:
        Path(f"{path}.json").write_text(json.dumps(plain(value), indent=1, sort_keys=True))


def recorded(gl: bool, slow: bool, only: Sequence[str], folder: Path | None) -> dict[str, str]:
    """Work out all fingerprints, telling when each group begins."""
    found: dict[str, str] = {}
    group, start = "", perf_counter()
    for name, value in entries(gl, slow, only):
        found[name] = digest(value)
        if folder is not None:
            keep(folder, name, value)
        if not name.startswith(f"{group}/"):
            group = "/".join(name.split("/")[:2])
            print(f"{perf_counter() - start:6.1f} s  {group}", flush=True)
    print(f"{perf_counter() - start:6.1f} s  {len(found)} fingerprints", flush=True)
    return found


def differences(before: dict[str, str], now: dict[str, str], whole: bool = True) -> list[str]:
    """Return a line for every name whose text is another, is gone or has come.

    Parameters
    ----------
    before, now : dict of str to str
    whole : bool
        False: names that were not worked out now are passed over.
    """
    lines = []
    for name in sorted(before.keys() | now.keys()):
        if name not in now:
            if whole:
                lines.append(f"gone     {name}")
        elif name not in before:
            lines.append(f"new      {name}")
        elif before[name] != now[name]:
            lines.append(f"differs  {name}")
            if len(before[name]) != 64:
                lines.append(f"           was {before[name]}\n           now {now[name]}")
    return lines


def main() -> int:
    """Write or check a record; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    way = parser.add_mutually_exclusive_group(required=True)
    way.add_argument("--write", type=Path, metavar="FILE", help="write the record")
    way.add_argument("--check", type=Path, metavar="FILE", help="compare with a record")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="bags and groups")
    parser.add_argument("--no-gl", action="store_true", help="leave the graphics backend out")
    parser.add_argument("--slow", action="store_true", help="what takes minutes too")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="save the values too")
    told = parser.parse_args()
    print(f"of {Path(napari_unpack.__file__).parent}")
    gl, slow = not told.no_gl, told.slow or told.write is not None
    if told.write and (told.only or not gl):
        parser.error("a record is written whole: without --only and --no-gl")
    record = {
        "made_with": made_with(),
        "signatures": {**library(), **command_line()},
        "fingerprints": recorded(gl, slow, told.only, told.keep),
    }
    if told.write:
        broken = [name for name in record["fingerprints"] if name.endswith(f"/{RAISED}")]
        if broken:
            parser.error(f"nothing is written: {', '.join(broken)}")
        told.write.write_text(json.dumps(record, indent=1, sort_keys=True) + "\n")
        return 0
    before = json.loads(told.check.read_text())
    for name, was in before["made_with"].items():
        if was != record["made_with"][name]:
            print(f"note: {name} was {was}, is {record['made_with'][name]}")
    whole = gl and slow and not told.only
    lines = differences(before["signatures"], record["signatures"])
    lines += differences(before["fingerprints"], record["fingerprints"], whole)
    print("\n".join(lines) if lines else "all as recorded")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main())
