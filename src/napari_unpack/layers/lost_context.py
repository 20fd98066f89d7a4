"""When a canvas's GL context is replaced: nothing of the old one is spoken to any more.

Qt makes a new context when its widget moves to another window, and takes the old one away with
all that was in it. vispy knows nothing of that: it would go on with names of programs and textures
that mean nothing now, or something else, and raise an error at every paint.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from qtpy.QtCore import QTimer

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
    lost = "The window lost what it had on the graphics card; "
    if compat.build_anew(viewer, others):
        return lost + "everything is drawn anew."
    return lost + "add your own layers anew to see them again."
