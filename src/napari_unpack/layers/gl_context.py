"""When a canvas's GL context is replaced: nothing of the old one is spoken to any more.

Qt makes a new context when its widget moves to another window, and takes the old one away with
all that was in it. vispy knows nothing of that: it would go on with names of programs and textures
that mean nothing now, or something else, and raise an error at every paint.

A canvas's GL commands run in its own GL context, also when napari flushes them unasked.

When layers go, napari calls `context.finish()` on their canvas so that the driver lets go of them
before the scene is rebuilt. It does not make the canvas current first. With two viewers open the
current context may be the other one's, and GL names are only numbers: the programs and textures
deleted there are the ones the other canvas draws with, which then stays empty.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from qtpy.QtCore import QTimer
from vispy.gloo.context import get_current_canvas

from napari_unpack.layers import compat

WAIT_MS = 50


class ContextWatch:
    """Calls back once a canvas has a new GL context in place of a lost one.

    Parameters
    ----------
    canvas : vispy.app.Canvas or None
        With a Qt backend. None, a viewer without a window, is never called back for.
    replaced : callable
        Called when the canvas can be drawn again.

    Notes
    -----
    The canvas's vispy context gets a parser without objects, to which those of the old context
    are known to be invalid: drawing with them does nothing, and no GL error comes of it. What
    keeps its objects by `framebuffer.namespace` makes them anew. napari's own layers do not
    (`compat.build_anew`).
    """

    def __init__(self, canvas: Any, replaced: Callable[[], None]) -> None:
        self._canvas, self._replaced = canvas, replaced
        self._context: Any = None
        self._follow()

    def close(self) -> None:
        """Call back no more."""
        if self._context is not None:
            # Qt deletes a context while Python still holds it: any call raises RuntimeError then.
            with suppress(RuntimeError, TypeError):
                self._context.aboutToBeDestroyed.disconnect(self._lost)
        self._context = self._canvas = None

    def _follow(self) -> None:
        """Listen to the context that the canvas has now, as soon as it has one."""
        with suppress(RuntimeError):
            current = getattr(getattr(self._canvas, "native", None), "context", lambda: None)()
            if current is not None:
                self._context = current
                current.aboutToBeDestroyed.connect(self._lost)

    def _lost(self) -> None:
        canvas = self._canvas
        if canvas is None:
            return
        compat.forget_objects(canvas.context)
        self._context = None
        QTimer.singleShot(0, self._look)

    def _look(self) -> None:
        """Wait for the new context; there is none while the widget is hidden, or if it is going."""
        canvas = self._canvas
        if canvas is None:
            return
        try:
            there = canvas.native.isValid()
        except RuntimeError:
            return
        if not there:
            QTimer.singleShot(WAIT_MS, self._look)
            return
        self._follow()
        self._replaced()
        canvas.update()


def drawn_anew(viewer: Any, ours: Sequence[Any]) -> str:
    """Have all layers but ours made anew, after a context was replaced; return what to say."""
    others = [layer for layer in viewer.layers if layer not in ours]
    lost = "The graphics card lost the contents of the window; "
    if compat.build_anew(viewer, others):
        return lost + "everything is drawn again."
    return lost + "add your own layers once more to see them."


GUARDED = "finishes_in_own_context"


def guard(canvas: Any) -> None:
    """Make `finish` of a canvas's context run in that context; once is enough.

    Parameters
    ----------
    canvas : vispy.app.Canvas or None
        With a Qt backend. None, a viewer without a window, is left alone.

    Notes
    -----
    It stays for the canvas's life: napari takes the layers of a closing window down last of all.
    Before the context is made, and after it went with its window, nothing runs: what is queued
    waits for the first draw, or has gone with the context. The canvas that was current is so
    again afterwards.
    """
    context = getattr(canvas, "context", None)
    if context is None or getattr(context, GUARDED, False):
        return
    finish = context.finish

    def finish_here() -> None:
        if not _has_context(canvas):
            return
        previous = get_current_canvas()
        canvas.set_current()
        try:
            finish()
        finally:
            if previous is not None and previous is not canvas and _has_context(previous):
                previous.set_current()

    context.finish = finish_here
    setattr(context, GUARDED, True)


def _has_context(canvas: Any) -> bool:
    """Return whether a canvas's widget lives and has been shown; other backends always have."""
    # Qt deletes a widget while Python still holds it: any call raises RuntimeError then.
    with suppress(RuntimeError):
        valid = getattr(canvas.native, "isValid", None)
        return valid is None or bool(valid())
    return False
