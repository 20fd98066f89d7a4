"""Save every kind of file on a full disk, while the process is killed, and where others own it.

Run as `python tests/io/saves_at_risk.py RISK FOLDER [ROUNDS [SEED]]`, of full, small, foreign,
killed or all; prints one line of JSON for each format and risk. A process of its own: limits and
signals would meet the tests' as well.
"""

from __future__ import annotations

import gc
import hashlib
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

# Some are imported late by the package: here, lest every child takes the time.
import imageio.v3 as iio
import imageio_ffmpeg  # noqa: F401
import numpy as np
import pandas as pd
import SimpleITK  # noqa: F401
import tifffile  # noqa: F401
import trimesh

from napari_unpack.io import (
    Scan,
    load_volume,
    open_session,
    report,
    save_objects_csv,
    save_objects_page,
    save_png,
    save_scan,
    save_session,
)
from napari_unpack.io.movies import movie_writer
from napari_unpack.io.surfaces import save_surfaces
from napari_unpack.segmentation.confidence.oracle import Oracle, default_oracle
from napari_unpack.session import Session

SHAPE = (16, 64, 64)

# Small pictures take less time to draw, and are written like large ones.
report.BAG, report.SIDE = (60, 96), 24


def noise(shape: tuple[int, ...], seed: int) -> Any:
    """Return what no format can make small."""
    return np.random.default_rng(seed).integers(0, 256, shape).astype(np.uint8)


@dataclass(frozen=True)
class Kind:
    """How a kind of file is written, and which of two contents a file of it holds."""

    write: Callable[[Path, int], object]
    read: Callable[[Path], int]


def _seed(array: Any, shape: tuple[int, ...]) -> int:
    (found,) = [seed for seed in (0, 1) if np.array_equal(array, noise(shape, seed))]
    return found


def _film(path: Path, seed: int) -> None:
    # The contents differ in length: what a lossy codec keeps of noise is no matter here.
    with movie_writer(path, (32, 32), 10) as write:
        for frame in noise((6 + 2 * seed, 32, 32, 3), seed):
            write(frame)


def _film_seed(path: Path) -> int:
    if path.is_dir():
        return (len(list(path.glob("frame-*.png"))) - 6) // 2
    frames = iio.imread(path, index=None) if path.suffix == ".gif" else iio.imread(path)
    return (len(frames) - 6) // 2


def _session(path: Path, seed: int) -> None:
    labels = np.zeros(SHAPE, np.uint16)
    labels[4:12, 10:50, 10:50] = 1
    save_session(Session(noise(SHAPE, seed), labels), path)


def _box(seed: int) -> Session:
    labels = np.zeros(SHAPE, np.uint16)
    labels[4 : 12 - 2 * seed, 10:22, 10:22] = 1
    return Session(noise(SHAPE, 0), labels)


def _surface_seed(path: Path) -> int:
    surface = trimesh.load(path)
    assert surface.is_watertight, "whole"
    return {8: 0, 6: 1}[round(surface.extents[2])]


def _page_seed(path: Path) -> int:
    text = path.read_text("utf-8")
    assert text.rstrip().endswith("</html>"), "whole"
    return int(text.partition("<title>bag ")[2][0])


_VOLUME = Kind(
    lambda path, seed: save_scan(Scan(noise(SHAPE, seed), (1.0, 1.0, 1.0)), path),
    lambda path: _seed(load_volume(path).volume, SHAPE),
)
_ORACLE = Kind(
    lambda path, seed: replace(default_oracle(), logistic=np.array([seed, 1.0])).save(path),
    lambda path: int(Oracle.load(path).logistic[0]),
)
_FILM = Kind(_film, _film_seed)
_SESSION = Kind(_session, lambda path: _seed(open_session(path).volume, SHAPE))
KINDS = {
    **dict.fromkeys((".npz", ".nii", ".nii.gz", ".mha", ".nrrd", ".tif"), _VOLUME),
    **dict.fromkeys((".mp4", ".gif", ""), _FILM),
    ".oracle.npz": _ORACLE,
    **dict.fromkeys((".unpack", ".folder"), _SESSION),
    ".csv": Kind(
        lambda path, seed: save_objects_csv(pd.DataFrame({"x": noise((4000,), seed)}), path),
        lambda path: _seed(pd.read_csv(path)["x"], (4000,)),
    ),
    ".stl": Kind(lambda path, seed: save_surfaces(_box(seed), path), _surface_seed),
    ".html": Kind(
        lambda path, seed: save_objects_page(_box(seed), path, f"bag {seed}", backend="cpu"),
        _page_seed,
    ),
    ".png": Kind(
        lambda path, seed: save_png(noise((200, 200, 3), seed), path),
        lambda path: _seed(iio.imread(path), (200, 200, 3)),
    ),
}


def digest(path: Path) -> str:
    """Return what tells the bytes of a file, or of all files of a folder."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    return hashlib.sha256(b"".join(map(Path.read_bytes, files))).hexdigest()


def size(path: Path) -> int:
    """Return the bytes of a file, or of the largest of a folder."""
    return max(file.stat().st_size for file in (path.iterdir() if path.is_dir() else [path]))


def saved(kind: Kind, path: Path) -> str:
    """Save the other content and return what was said against it, nothing where all went well."""
    try:
        kind.write(path, 1)
    except OSError as error:
        return str(error)
    return ""


def on_a_full_disk(kind: Kind, path: Path) -> dict[str, Any]:
    """Save over a good file where files may grow to a half of what is needed."""
    kind.write(path, 0)
    before, limits = digest(path), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size(path) // 2, limits[1]))
    try:
        said = saved(kind, path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    return {
        "said": said,
        "kept": digest(path) == before,
        "alone": [other.name for other in path.parent.iterdir()] == [path.name],
    }


def while_killed(kind: Kind, path: Path, rounds: int, chance: random.Random) -> dict[str, Any]:
    """Save over a good file in children that are killed at any moment."""
    kind.write(path, 0)
    # Once to the end, for how long it takes; in a child, as libraries start threads.
    seconds, held = _child(kind, path, 1, None), {0: 0, 1: 0}
    for _ in range(rounds):
        before = kind.read(path)
        _child(kind, path, 1 - before, chance.uniform(0.0, 1.1 * seconds))
        held[kind.read(path)] += 1
    # The next save sweeps what the killed ones left.
    _child(kind, path, 0, None)
    alone = [other.name for other in path.parent.iterdir()] == [path.name]
    return {"held": held, "alone": alone, "last": kind.read(path)}


def _child(kind: Kind, path: Path, seed: int, after: float | None) -> float:
    start = time.perf_counter()
    child = os.fork()
    # A group of its own, so that the encoder it starts is killed with it. On both sides: neither
    # may go on before it is so.
    with suppress(OSError):
        os.setpgid(child, child)
    if child == 0:
        kind.write(path, seed)
        os._exit(0)
    if after is not None:
        time.sleep(after)
        os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return time.perf_counter() - start


def on_a_small_disk(kind: Kind, path: Path) -> dict[str, Any]:
    """Save over a good file where half of what is needed is free; said is None without a disk."""
    room = path.parent
    mount = ("mount", "-t", "tmpfs", "-o", "size=8m", "tmpfs", str(room))
    if not shutil.which("mount") or subprocess.run(mount, capture_output=True).returncode:
        return {"said": None}
    try:
        kind.write(path, 0)
        before, free = digest(path), shutil.disk_usage(room).free
        (room / "filler").write_bytes(bytes(max(free - size(path) // 2, 0)))
        said = saved(kind, path)
        (room / "filler").unlink()
        alone = [other.name for other in room.iterdir()] == [path.name]
        return {"said": said, "kept": digest(path) == before, "alone": alone}
    finally:
        # Lazily: an encoder that still ends may hold it.
        subprocess.run(("umount", "-l", str(room)), check=True)


# Of the folder and of what lies in it: closed to others, open but for the file, and as /tmp is.
FOREIGN = ((0o755, 0o777), (0o777, 0o755), (0o1777, 0o777))
NOBODY = 65534


def of_another_user(kind: Kind, path: Path) -> dict[str, Any]:
    """Save over a good file of another user; where this one is not root, into a closed folder."""
    room, is_root = path.parent, os.geteuid() == 0
    # Where every user can look, unlike the folders of tests.
    with tempfile.TemporaryDirectory() as outside:
        os.chmod(outside, 0o755)
        path = Path(outside) / room.name / path.name
        path.parent.mkdir()
        kind.write(path, 0)
        before, said = digest(path), []
        for folder_mode, mode in FOREIGN if is_root else ((0o555, 0o777),):
            path.chmod(mode if path.is_dir() else mode & 0o666)
            path.parent.chmod(folder_mode)
            coming, going = os.pipe()
            if not os.fork():
                if is_root:
                    os.setgid(NOBODY)
                    os.setuid(NOBODY)
                os.write(going, saved(kind, path).encode())
                os._exit(0)
            os.wait()
            os.close(going)
            with open(coming, "rb") as told:
                said.append(told.read().decode())
        path.parent.chmod(0o755)
        alone = [other.name for other in path.parent.iterdir()] == [path.name]
        return {"said": said, "kept": digest(path) == before, "alone": alone}


def main(risk: str, folder: Path, rounds: int = 5, seed: int = 0) -> None:
    """Try every kind of file."""
    # Without this the system ends the process, where a full disk gives an error.
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    # Else every child copies the memory of all modules when its collector first looks at them.
    gc.collect()
    gc.freeze()
    risks = ("full", "small", "foreign", "killed") if risk == "all" else (risk,)
    ways = {"full": on_a_full_disk, "small": on_a_small_disk, "foreign": of_another_user}
    for (suffix, kind), each in product(KINDS.items(), risks):
        room = folder / each / (suffix.replace(".", "-") or "-images")
        room.mkdir(parents=True)
        path = room / f"bag{suffix}"
        # Where a finished film stays that finds no room; no other user may look into it.
        tempfile.tempdir = None if each == "foreign" else str(folder)
        if each == "killed":
            found = while_killed(kind, path, rounds, random.Random(seed))
        else:
            found = ways[each](kind, path)
        print(json.dumps({"risk": each, "format": suffix, **found}), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), *map(int, sys.argv[3:]))
