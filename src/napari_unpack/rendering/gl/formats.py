"""What textures a driver can hold, asked before any is made."""

from __future__ import annotations

from functools import cache
from typing import Any
from weakref import WeakKeyDictionary

from napari_unpack.rendering.gl.framebuffer import forget_complaints, namespace

# Of images and tables, of depths, and of volumes; napari's own labels and images need them too.
FLOATS, CHANNEL = "float textures", "textures of one channel"
NEEDED = (
    (FLOATS, "GL_RGBA32F", "GL_RGBA"),
    (FLOATS, "GL_R32F", "GL_RED"),
    (CHANNEL, "GL_R16", "GL_RED"),
)


def lacking() -> str:
    """Return what the current context has not of what we draw with, in words; "" for nothing."""
    known, here = _known(), namespace()
    if here not in known:
        forget_complaints()
        missing = [what for what, internal, kind in NEEDED if not _holds(internal, kind)]
        known[here] = " and ".join(dict.fromkeys(missing))
    return known[here]


def _holds(internal: str, kind: str) -> bool:
    from OpenGL import GL
    from OpenGL.error import GLError

    # A proxy takes no memory, and says with a width of 0 what a texture says with an error.
    proxy = GL.GL_PROXY_TEXTURE_2D
    try:
        GL.glTexImage2D(
            proxy, 0, getattr(GL, internal), 4, 4, 0, getattr(GL, kind), GL.GL_FLOAT, None
        )
        return int(GL.glGetTexLevelParameteriv(proxy, 0, GL.GL_TEXTURE_WIDTH)) == 4
    except GLError:
        return False


@cache
def _known() -> WeakKeyDictionary[Any, str]:
    return WeakKeyDictionary()
