"""Whether windows can be opened, and whether Qt and PyOpenGL mean the same screen."""

from __future__ import annotations

import os
import subprocess
import sys

CHILD = """
from qtpy.QtGui import QGuiApplication
print("platform", QGuiApplication([]).platformName())
"""


def check_screen() -> None:
    """Try in a child whether Qt finds a screen, and let PyOpenGL take the same one.

    Raises
    ------
    OSError
        If there is none: Qt would end the process instead.
    """
    child = subprocess.run([sys.executable, "-c", CHILD], capture_output=True, text=True)
    words = child.stdout.split()
    if "platform" not in words:
        raise OSError(
            "napari finds no screen here: run this on a desktop, or with `xvfb-run -a` before it; "
            "`napari-unpack render` and `movie` need no screen"
        )
    # By Wayland's variables PyOpenGL takes EGL, whatever Qt does: nothing could be drawn.
    if words[words.index("platform") + 1] == "xcb":
        os.environ.setdefault("PYOPENGL_PLATFORM", "glx")


def screen_notice() -> str:
    """Return what to say if Qt and PyOpenGL mean different screens, "" where they agree."""
    from OpenGL import platform
    from qtpy.QtGui import QGuiApplication

    taken = type(platform.PLATFORM).__name__
    if QGuiApplication.platformName() != "xcb" or taken != "EGLPlatform":
        return ""
    return (
        "Nothing can be drawn: Qt shows its windows through X11, and PyOpenGL draws for Wayland. "
        "Start napari as `PYOPENGL_PLATFORM=glx napari`."
    )
