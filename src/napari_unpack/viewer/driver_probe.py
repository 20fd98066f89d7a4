"""Whether the graphics driver survives our shaders, tried by another process before it draws here.

A driver that cannot compile or run them may end the process that asks it to.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from urllib.parse import quote

from qtpy.QtCore import QSettings

from napari_unpack.tasks import Task
from napari_unpack.viewer.scheduler import Scheduler, Worker

# A driver compiles all shaders anew; one that hangs must not keep us waiting for ever.
SECONDS = 60
DRAWN = "the driver has drawn"
CHILD = "from napari_unpack.viewer.driver_probe import draw; draw()"


def probe_driver(driver: str, scheduler: Scheduler, answered: Callable[[str], None]) -> None:
    """Find out why a driver must not draw, "" where it may: from what is known, or by a child.

    Parameters
    ----------
    driver : str
        What it calls itself, its version included: another is tried anew.
    scheduler : Scheduler
    answered : callable
        Given the reason, at once or later.
    """
    store = QSettings(
        QSettings.Format.IniFormat, QSettings.Scope.UserScope, "napari-unpack", "graphics"
    )
    key = quote(f"{version('napari-unpack')} {driver}", safe="")
    known = store.value(key)
    if known is not None:
        answered(str(known))
        return

    def done(reason: str) -> None:
        store.setValue(key, reason)
        answered(reason)

    scheduler.submit(Task(("driver", driver), lambda _: tried()), Worker.LONG, done)


def tried(command: str = CHILD) -> str:
    """Return why a child process could not draw with the driver, "" where it could.

    Parameters
    ----------
    command : str
        What the child does, in Python.
    """
    # An application packed into one file has no interpreter to start.
    if getattr(sys, "frozen", False) or not sys.executable:
        return ""
    try:
        child = subprocess.run(
            [sys.executable, "-c", command], capture_output=True, text=True, timeout=SECONDS
        )
    except subprocess.TimeoutExpired:
        return f"it did not draw within {SECONDS} s"
    except OSError:
        return ""
    if DRAWN in child.stdout:
        return ""
    if child.returncode < 0:
        return f"it ends the process with signal {-child.returncode}"
    errors = [line for line in child.stderr.splitlines() if "Error" in line]
    return errors[-1].strip() if errors else "it draws nothing"


def draw() -> None:
    """Cast a small bag with the shaders of the canvas, and say so; for the child.

    Raises
    ------
    RuntimeError
        If there is no context, or it has no textures to draw with.
    """
    import numpy as np
    from qtpy.QtGui import QGuiApplication, QOffscreenSurface, QOpenGLContext
    from vispy.gloo import gl
    from vispy.gloo.context import FakeCanvas, set_current_canvas

    from napari_unpack.appearance import TransferFunction
    from napari_unpack.geometry.shading import Shading
    from napari_unpack.geometry.view import View
    from napari_unpack.rendering.casting import TABLE_ENTRIES, rays_for
    from napari_unpack.rendering.gl import formats, framebuffer
    from napari_unpack.rendering.gl.cached_pass import TintedCaster
    from napari_unpack.rendering.gl.tinted_pass import Appearance
    from napari_unpack.rendering.gl.volume_store import VolumeStore

    app = QGuiApplication([])
    surface, context = QOffscreenSurface(), QOpenGLContext()
    surface.create()
    if not (context.create() and context.makeCurrent(surface)):
        raise RuntimeError("Qt makes no context")
    gl.use_gl("gl+")
    canvas = FakeCanvas()
    set_current_canvas(canvas)
    if formats.lacking():
        raise RuntimeError(f"it has no {formats.lacking()}")
    labels = np.zeros((8, 9, 10), np.uint16)
    labels[2:6, 2:7, 2:8] = 1
    store = VolumeStore(labels, labels * np.uint16(1000))
    while not store.send(2**20):
        pass
    spacing = np.ones(3)
    look = TransferFunction.default_for(labels * np.uint16(1000))
    shown = Appearance(
        spacing, look.table(TABLE_ENTRIES), look.domain, np.ones((2, 4), np.float32), Shading()
    )
    camera, caster = View((0.2, 0.3, 1.0)).camera(labels.shape, spacing), TintedCaster(store)
    caster.cast(rays_for(camera, (24, 32), spacing), shown)
    framebuffer.finish()
    if caster.targets.get((24, 32)).read()[..., 3].max() > 0.5:
        sys.stdout.write(DRAWN)
    context.doneCurrent()
    del app
