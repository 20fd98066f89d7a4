"""When a canvas's GL context is replaced: nothing of the old one is used any more.

Qt makes a new context when its widget moves to another window, and takes the old one away with
all that was in it. vispy knows nothing of that: it would go on with names of programs and textures
that mean nothing now, or something else, and raise an error at every paint.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from napari.layers import Layer

from napari_unpack.layers import compat

if TYPE_CHECKING:
    import napari
    from vispy.scene import SceneCanvas

# How often a canvas without a context is looked at; it has none while its widget is hidden.
POLL_MS = 50


class ContextWatch:
    """Calls back once a canvas has a new GL context in place of a lost one.

    Parameters
    ----------
    canvas : vispy.app.Canvas or None
        With a Qt backend. None, a viewer without a window, is never called back for.
    replaced : callable
        Called when the canvas can be drawn again.
    later : callable
        Given milliseconds and what to call then.

    Notes
    -----
    The canvas's vispy context gets a parser without objects, to which those of the old context
    are known to be invalid: drawing with them does nothing, and no GL error comes of it. What
    keeps its objects by `framebuffer.namespace` makes them anew. napari's own layers do not
    (`compat.build_anew`).
    """

    def __init__(
        self,
        canvas: SceneCanvas | None,
        replaced: Callable[[], None],
        later: Callable[[int, Callable[[], None]], None],
    ) -> None:
        self._canvas, self._replaced, self._later = canvas, replaced, later
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
        # Before anything draws: names of the old context mean other things in the next.
        compat.forget_objects(canvas.context)
        self._context = None
        self._later(0, self._look)

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
            self._later(POLL_MS, self._look)
            return
        self._follow()
        self._replaced()
        canvas.update()


def rebuild_layers(viewer: napari.Viewer, ours: Sequence[Layer]) -> str:
    """Have all layers but ours made anew, after a context was replaced; return what to say.

    Parameters
    ----------
    viewer : napari.Viewer
    ours : sequence of napari layers
        They rebuild themselves.
    """
    others = [layer for layer in viewer.layers if layer not in ours]
    lost = "The graphics card lost the contents of the window; "
    if compat.build_anew(viewer, others):
        return lost + "everything is drawn again."
    return lost + "add your own layers once more to see them."
