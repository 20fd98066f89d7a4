"""A bag in the 3D view of napari; for scripts of `on_screen.run_script`."""

from __future__ import annotations

from typing import Any

import napari
import numpy as np
from numpy.typing import NDArray

from napari_unpack import Session
from napari_unpack.layers import compat
from napari_unpack.viewer.controller import SessionController

# Of textures and of buffers; names begin at 1.
MOST_NAMES = 1024


def opened_in_napari(
    volume: NDArray[Any], labels: NDArray[Any], size: int, **settings: Any
) -> tuple[napari.Viewer, SessionController]:
    """Show a bag in a square window, and wait until all of it is drawn.

    Parameters
    ----------
    volume : (Z, Y, X) ndarray
        Density.
    labels : (Z, Y, X) ndarray of int
        Object IDs.
    size : int
        Side of the window, pixels.
    **settings
        Attributes of the controller to set before it opens.
    """
    viewer = napari.Viewer(ndisplay=3, show=True)
    viewer.window.resize(size, size)
    controller = SessionController(viewer, Session(volume, labels))
    for name, value in settings.items():
        setattr(controller, name, value)
    controller.open()
    controller.settle(300)
    return viewer, controller


def unpack_at_once(controller: SessionController, count: int) -> None:
    """Have so many objects outside the bag, and wait until all is drawn."""
    controller.unpack(count)
    controller.finish()
    controller.settle(300)


def on_the_card(viewer: Any) -> dict[tuple[str, int], int]:
    """Return the bytes of every texture and buffer of the viewer's context, as GL knows them."""
    from OpenGL import GL

    scene_canvas = compat.native_canvas(viewer)
    scene_canvas.set_current()
    scene_canvas.context.flush_commands()
    found = {}
    sides = GL.GL_TEXTURE_WIDTH, GL.GL_TEXTURE_HEIGHT, GL.GL_TEXTURE_DEPTH
    colors = (
        GL.GL_TEXTURE_RED_SIZE,
        GL.GL_TEXTURE_GREEN_SIZE,
        GL.GL_TEXTURE_BLUE_SIZE,
        GL.GL_TEXTURE_ALPHA_SIZE,
    )

    def asked(name: int, words: tuple[int, ...]) -> list[int]:
        told = np.zeros(len(words), np.int32)
        for i, word in enumerate(words):
            GL.glGetTextureLevelParameteriv(name, 0, word, told[i : i + 1])
        return [int(n) for n in told]

    for name in range(1, MOST_NAMES):
        if GL.glIsTexture(name):
            bits = sum(asked(name, colors))
            found["texture", name] = int(np.prod(asked(name, sides))) * bits // 8
        if GL.glIsBuffer(name):
            size = np.zeros(1, np.int32)
            GL.glGetNamedBufferParameteriv(name, GL.GL_BUFFER_SIZE, size)
            found["buffer", name] = int(size[0])
    return found


def of_qt(viewer: Any) -> int:
    """Return what Qt draws into: the canvas, and the window it is composed in."""
    native = compat.native_canvas(viewer).native
    sizes = [widget.size() for widget in (native, native.window())]
    return round(sum(4 * s.width() * s.height() for s in sizes) * native.devicePixelRatioF() ** 2)
