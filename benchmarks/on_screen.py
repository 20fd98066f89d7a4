"""Scripts with windows, each in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.scenes import Scenes

SCREEN = "NAPARI_UNPACK_SCREEN"
"""Where the display's name is kept from this process, in which VTK's GL and ours share EGL."""


def keep_screen_for_children() -> None:
    """Take the display away from this process, which draws offscreen, and remember it."""
    display = os.environ.pop("DISPLAY", None)
    if display:
        os.environ[SCREEN] = display
    os.environ["PYOPENGL_PLATFORM"], os.environ["EGL_PLATFORM"] = "egl", "surfaceless"


def screen_environment() -> dict[str, str] | None:
    """Return the environment for a process with windows, None where there is no screen."""
    if SCREEN not in os.environ:
        return None
    offscreen = ("PYOPENGL_PLATFORM", "EGL_PLATFORM", SCREEN)
    kept = {k: v for k, v in os.environ.items() if k not in offscreen}
    # What they leave unsaved is nobody's, and must not be offered at the next start.
    data = tempfile.mkdtemp(prefix="napari-unpack-")
    return kept | {"DISPLAY": os.environ[SCREEN], "XDG_DATA_HOME": data}


def run_script(script: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a script on the screen, and return what it printed.

    Parameters
    ----------
    script : str
        Python.
    *arguments : str
        Its sys.argv from 1 on.
    """
    return subprocess.run(
        [sys.executable, "-c", script, *arguments],
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
        env=screen_environment(),
    )


def run_on_packing(
    script: str, scenes: Scenes, *arguments: str
) -> subprocess.CompletedProcess[str]:
    """Run a script whose sys.argv[1] is a file of the packing's volume and labels."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "packing.npz"
        np.savez(path, volume=scenes.packing.volume, labels=scenes.packing.labels)
        return run_script(script, str(path), *arguments)


def numbers(done: subprocess.CompletedProcess[str], word: str) -> list[list[float]]:
    """Return the numbers of each printed line that begins with a word."""
    lines = (line.split() for line in done.stdout.splitlines())
    return [[float(v) for v in line[1:]] for line in lines if line[:1] == [word]]


def failure(done: subprocess.CompletedProcess[str]) -> str:
    """Return why a script printed nothing, short."""
    return (done.stderr.strip().splitlines() or ["no reason given"])[-1][:60]
