"""Whether the graphics driver survives our shaders, tried by another process before it draws here.

A driver that cannot compile or run them may end the process that asks it to.
"""

from __future__ import annotations

from collections.abc import Callable
from urllib.parse import quote

from qtpy.QtCore import QSettings

from napari_unpack.rendering.gl.trial import LATE, shaders_digest, tried
from napari_unpack.tasks import Task
from napari_unpack.viewer.scheduler import Scheduler, Worker

CHILD = "from napari_unpack.viewer.driver_probe import draw; draw()"


def probe_driver(driver: str, scheduler: Scheduler, answered: Callable[[str], None]) -> None:
    """Find out why a driver must not draw, "" where it may: from what is known, or by a child.

    Parameters
    ----------
    driver : str
        What it calls itself, its version included: another is tried anew, as with other shaders.
    scheduler : Scheduler
    answered : callable
        Given the reason, at once or later.
    """
    store = QSettings(
        QSettings.Format.IniFormat, QSettings.Scope.UserScope, "napari-unpack", "graphics"
    )
    key = quote(f"{shaders_digest()} {driver}", safe="")
    known = store.value(key)
    if known is not None:
        answered(str(known))
        return

    def done(reason: str) -> None:
        # The machine may have been busy: the next start tries again.
        if reason != LATE:
            store.setValue(key, reason)
        answered(reason)

    scheduler.submit(Task(("driver", driver), lambda _: tried(CHILD)), Worker.LONG, done)


def draw() -> None:
    """Cast a small bag with the shaders of the canvas, and say so; for the child.

    Raises
    ------
    RuntimeError
        If there is no context, or it has no textures to draw with.
    """
    from qtpy.QtGui import QGuiApplication, QOffscreenSurface, QOpenGLContext
    from vispy.gloo import gl
    from vispy.gloo.context import FakeCanvas, set_current_canvas

    from napari_unpack.rendering.gl import formats
    from napari_unpack.rendering.gl.trial import draw_bag

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
    draw_bag()
    context.doneCurrent()
    del app
