"""A canvas's GL commands run in its own GL context, also when napari flushes them unasked.

When layers go, napari calls `context.finish()` on their canvas so that the driver lets go of them
before the scene is rebuilt. It does not make the canvas current first. With two viewers open the
current context may be the other one's, and GL names are only numbers: the programs and textures
deleted there are the ones the other canvas draws with, which then stays empty.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from vispy.gloo.context import get_current_canvas

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
