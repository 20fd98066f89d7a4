"""A GL context without a window: EGL, made on first use and then kept.

It is made beside whatever vispy shows in the process (an application of its own, never
`vispy.use`), and every use hands the previously current canvas back. PyOpenGL is bound to one
platform when it is imported, so EGL can only be had where nothing else has bound it first: on a
machine without a display, or under PYOPENGL_PLATFORM=egl. A desktop's napari draws in its own
canvas instead and never needs this.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from napari_unpack.rendering.gl.trial import refusal

# Several threads that ask first would each make a context.
TRYING = threading.RLock()


def _try_anew() -> None:
    """Let a forked process not wait for a thread of its parent's."""
    global TRYING
    TRYING = threading.RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_try_anew)


class Offscreen:
    """A headless canvas; get the process's one from `context()`.

    Raises
    ------
    RuntimeError
        If EGL cannot be had, with the reason.
    """

    def __init__(self) -> None:
        from vispy import app
        from vispy.gloo import gl

        from napari_unpack.rendering.gl import formats

        gl.use_gl("gl+")
        self._app = app.Application("egl")
        self.canvas: Any = app.Canvas(app=self._app, size=(1, 1), autoswap=False)
        # A process that was forked from ours has our context, and none to draw in.
        self._owner = os.getpid(), threading.get_ident()
        self.serves = True
        with self.use():
            from OpenGL import GL

            GL.glGetIntegerv(GL.GL_MAX_3D_TEXTURE_SIZE)
            self.renderer = _text(GL.glGetString(GL.GL_RENDERER))
            self.version = _text(GL.glGetString(GL.GL_VERSION))
            lacks = formats.lacking()
        if lacks:
            raise RuntimeError(f"the driver ({self.renderer}) has no {lacks}")

    @property
    def mine(self) -> bool:
        """Whether this thread of this process made it."""
        return self._owner == (os.getpid(), threading.get_ident())

    @contextmanager
    def use(self) -> Iterator[Any]:
        """Make the context current inside the `with`, then hand back the canvas before it.

        Raises
        ------
        RuntimeError
            In another thread than the one that made the context.
        """
        from vispy.gloo.context import get_current_canvas

        if not self.mine:
            raise RuntimeError(
                "the offscreen GL context belongs to the thread that first used it; "
                "use that thread or the CPU backend"
            )
        previous = get_current_canvas()
        self.canvas.set_current()
        try:
            yield self.canvas.context
        finally:
            # Another canvas may have become current meanwhile; it must not get our commands.
            self.canvas.set_current()
            self.canvas.context.flush_commands()
            if previous is not None and previous is not self.canvas:
                previous.set_current()


def unavailable_because() -> str | None:
    """Return why there is no offscreen GL here, in a sentence; None where there is."""
    reason = probe()[1]
    if reason is None and not context().mine:
        return "the offscreen GL context belongs to another thread"
    return reason


def available() -> bool:
    """Whether this thread can draw offscreen."""
    return unavailable_because() is None


def context() -> Offscreen:
    """Return the process's offscreen context; raise `RuntimeError` with the reason if none.

    Raises
    ------
    RuntimeError
        If there is no offscreen GL, with the reason.
    """
    made, reason = probe()
    if made is None:
        raise RuntimeError(f"no offscreen GL: {reason}")
    return made


def is_software() -> bool:
    """Whether the driver draws on the CPU, so that the CPU backend is the better choice."""
    return is_software_renderer(context().renderer)


def hardware() -> bool:
    """Whether this thread can draw offscreen on graphics hardware that serves; never raises."""
    return available() and not is_software() and context().serves


def give_up() -> None:
    """Take note that the driver refuses to draw: `hardware` is False from here on."""
    context().serves = False


def is_software_renderer(name: str) -> bool:
    """Whether a GL_RENDERER string names a software rasteriser."""
    return any(word in name.lower() for word in ("llvmpipe", "softpipe", "swrast", "swiftshader"))


def probe() -> tuple[Offscreen | None, str | None]:
    """Return the context, or why there is none; tried once a process, by one thread."""
    with TRYING:
        return first_context()


@cache
def first_context() -> tuple[Offscreen | None, str | None]:
    """Make the context, or tell why there is none; see `probe`."""
    reason = _claimed_by_another()
    if reason is not None:
        return None, reason
    if not _has_display():
        os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
        os.environ.setdefault("EGL_PLATFORM", "surfaceless")
    try:
        drawing = Offscreen()
    # Drivers, loaders and bindings fail in every way there is; each only means "not here".
    except Exception as error:
        return None, f"EGL failed: {error or type(error).__name__}"
    # A software rasteriser is one program with its shader compiler, and known to draw ours.
    if not is_software_renderer(drawing.renderer):
        reason = refusal(f"{drawing.renderer}, {drawing.version}")
    return (None, f"{drawing.renderer} cannot draw: {reason}") if reason else (drawing, None)


def _claimed_by_another() -> str | None:
    if not sys.platform.startswith("linux"):
        return f"EGL is not used on {sys.platform}"
    wanted = os.environ.get("PYOPENGL_PLATFORM")
    if wanted not in (None, "egl"):
        return f"PYOPENGL_PLATFORM is {wanted}"
    if wanted is None and _has_display():
        return "a display is present, so PyOpenGL is left to its windows"
    if wanted is None and "OpenGL.platform" in sys.modules:
        return "PyOpenGL was imported before, for another platform"
    return None


def _has_display() -> bool:
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _text(value: bytes | str | None) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)
